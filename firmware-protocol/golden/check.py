#!/usr/bin/env python3
"""Packs and unpacks every frame of v1.json by hand: an outside witness of the wire format. Standard library only."""
import json, pathlib, struct, sys

KINDS = {  # name: (kind, struct format of the payload, little-endian)
    "hello": (0x01, "BB"), "move_to": (0x02, "iI"), "status": (0x03, ""), "home": (0x04, "I"), "stop": (0x05, ""),
    "set_lamp": (0x06, "HI"), "clear_fault": (0x07, ""), "hello_ack": (0x81, "BBBBHBBIIii"), "accepted": (0x82, ""),
    "status_report": (0x83, "IIiHHBB"), "error": (0x84, "B"),
}

def crc16(data, crc=0xFFFF):  # CRC-16/IBM-3740
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (0x1021 if crc & 0x8000 else 0)) & 0xFFFF
    return crc

def cobs(data):  # frames are shorter than 254 bytes
    return b"".join(bytes([len(run) + 1]) + run for run in data.split(b"\0"))

def uncobs(data):
    runs, at = [], 0
    while at < len(data):
        runs.append(data[at + 1:at + data[at]])
        at += data[at]
    return b"\0".join(runs)

def pack(frame):
    kind, layout = KINDS[frame["message"]]
    body = struct.pack("<BBHI" + layout, 1, kind, frame["seq"], frame["session"], *frame["fields"].values())
    return b"\0" + cobs(body + struct.pack("<H", crc16(body))) + b"\0"

def unpack(wire, message):
    raw = uncobs(wire.strip(b"\0"))
    assert crc16(raw[:-2]) == struct.unpack("<H", raw[-2:])[0], "CRC"
    return struct.unpack("<BBHI" + KINDS[message][1], raw[:-2])

assert crc16(b"123456789") == 0x29B1 and crc16(b"") == 0xFFFF and crc16(b"\0") == 0xE1F0
golden = json.loads(pathlib.Path(__file__).with_name("v1.json").read_text())
for frame in golden["frames"]:
    wire, kind = bytes.fromhex(frame["wire"]), KINDS[frame["message"]][0]
    assert pack(frame) == wire, (frame["name"], pack(frame).hex())
    assert unpack(wire, frame["message"]) == (1, kind, frame["seq"], frame["session"], *frame["fields"].values()), frame["name"]
assert {frame["message"] for frame in golden["frames"]} == set(KINDS), "a message has no golden frame"
print(len(golden["frames"]), "frames agree", file=sys.stderr)
