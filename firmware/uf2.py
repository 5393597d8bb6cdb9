#!/usr/bin/env python3
"""Turns the Pico's ELF file into the UF2 file that its boot loader takes: uf2.py ELF UF2. Standard library only.

Formats: the ELF specification (32-bit program headers) and https://github.com/microsoft/uf2.
"""
import pathlib, struct, sys

RP2040_FAMILY = 0xE48BFF56
FLASH = range(0x10000000, 0x10200000)
PAGE = 256

if len(sys.argv) != 3:
    sys.exit(__doc__)
elf = pathlib.Path(sys.argv[1]).read_bytes()
assert elf[:6] == b"\x7fELF\x01\x01", "not a 32-bit little-endian ELF file"
(headers_at,) = struct.unpack_from("<I", elf, 28)
header_size, header_count = struct.unpack_from("<HH", elf, 42)

pages = {}
for n in range(header_count):
    kind, offset, _, address, size = struct.unpack_from("<IIIII", elf, headers_at + n * header_size)
    if kind != 1:  # only what is loaded
        continue
    for i in range(size):
        assert address + i in FLASH, f"{address + i:#x} is not in flash"
        page = pages.setdefault((address + i) // PAGE * PAGE, bytearray(PAGE))
        page[(address + i) % PAGE] = elf[offset + i]

blocks = []
for number, address in enumerate(sorted(pages)):
    header = (0x0A324655, 0x9E5D5157, 0x2000, address, PAGE, number, len(pages), RP2040_FAMILY)
    blocks.append(struct.pack("<8I", *header) + bytes(pages[address]) + bytes(476 - PAGE) + struct.pack("<I", 0x0AB16F30))
pathlib.Path(sys.argv[2]).write_bytes(b"".join(blocks))
print(f"{sys.argv[2]}: {len(blocks)} pages")
