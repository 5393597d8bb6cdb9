#!/usr/bin/env python3
"""Runs the cross-built firmware in QEMU and asks it, over its UART, with the wire format packed by hand: hello, home, move, status.

Usage: check.py ELF QEMU. Standard library only. Exit status 0 when every answer is right.
"""
import contextlib, io, pathlib, runpy, selectors, subprocess, sys, time

with contextlib.redirect_stderr(io.StringIO()):  # it checks its own frames and says so
    wire = runpy.run_path(str(pathlib.Path(__file__).resolve().parents[2] / "firmware-protocol/golden/check.py"))
NAMES = {kind: name for name, (kind, _) in wire["KINDS"].items()}
SESSION = 0xA1B2C3D4
HOMED, MOVING = 1, 2
# What the arm in arm-logic/src/rig.rs must do: homing ends clear_mdeg above the edge.
HOME_MDEG, TARGET_MDEG = -50_000 + 2_000, -45_000
STEP_MDEG = 360_000 / 16_000


class Board:
    def __init__(self, elf, qemu):
        machine = [qemu, "-M", "lm3s6965evb", "-display", "none", "-monitor", "none", "-serial", "stdio", "-kernel", elf]
        self.process = subprocess.Popen(machine, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0)
        self.waiter = selectors.DefaultSelector()
        self.waiter.register(self.process.stdout, selectors.EVENT_READ)
        self.seq, self.heard, self.trips_ms = 0, b"", []

    def send(self, data):
        self.process.stdin.write(data)

    def receive(self, patience_s):
        """The next frame, without its zero bytes; none after patience_s."""
        end = time.monotonic() + patience_s
        while True:
            self.heard = self.heard.lstrip(b"\0")
            frame, zero, rest = self.heard.partition(b"\0")
            if zero:
                self.heard = rest
                return frame
            if not self.waiter.select(max(0.0, end - time.monotonic())):
                return None
            data = self.process.stdout.read(256)
            if not data:
                sys.exit("qemu/check.py: QEMU ended")
            self.heard += data

    def ask(self, message, patience_s=2.0, **fields):
        self.seq += 1
        began = time.monotonic()
        self.send(wire["pack"]({"message": message, "seq": self.seq, "session": SESSION, "fields": fields}))
        answer = self.receive(patience_s)
        if answer is None:
            return None, ()
        self.trips_ms.append((time.monotonic() - began) * 1e3)
        name = NAMES[wire["uncobs"](answer)[1]]
        version, _, seq, session, *values = wire["unpack"](answer, name)
        assert (version, seq, session) == (1, self.seq, SESSION), "the answer belongs to another request"
        return name, tuple(values)

    def hello(self):
        # A frame sent before the firmware has started its UART is lost.
        for _ in range(20):
            name, values = self.ask("hello", 0.5, proto_min=1, proto_max=1)
            if name == "hello_ack":
                return values
        sys.exit("qemu/check.py: no answer to 20 hellos")

    def done(self, message, **fields):
        """Sends a command and polls until the motor stands; the last status."""
        assert self.ask(message, **fields) == ("accepted", ())
        end = time.monotonic() + 120
        while time.monotonic() < end:
            name, status = self.ask("status")
            assert name == "status_report", name
            if not status[6] & MOVING:
                return status
            time.sleep(0.1)
        sys.exit(f"qemu/check.py: {message} did not end within two minutes")


def check(board):
    *_, homed, nonce, uptime_ms, lower, upper = board.hello()
    assert (homed, lower, upper) == (0, -90_000, 170_000), (homed, lower, upper)
    assert board.ask("move_to", target_mdeg=0, move_id=1) == ("error", (6,)), "a move before homing"

    began = time.monotonic()
    move_id, _, position, _, faults, state, flags = board.done("home", move_id=2)
    # Edge and clear_mdeg are whole steps each.
    assert abs(position - HOME_MDEG) <= STEP_MDEG, position
    assert (move_id, faults, state, flags) == (2, 0, 0, HOMED), (faults, state, flags)
    home_s = time.monotonic() - began

    began = time.monotonic()
    move_id, _, position, _, faults, state, flags = board.done("move_to", target_mdeg=TARGET_MDEG, move_id=3)
    assert abs(position - TARGET_MDEG) <= STEP_MDEG / 2 + 1, position
    assert (move_id, faults, state, flags) == (3, 0, 0, HOMED), (faults, state, flags)
    move_s = time.monotonic() - began

    board.send(bytes(range(1, 200)))
    assert board.ask("move_to", target_mdeg=170_001, move_id=4) == ("error", (5,)), "a move out of the travel, behind noise"
    assert board.ask("set_lamp", level_permille=500, ttl_ms=60_000) == ("accepted", ())
    time.sleep(3.5)
    _, _, _, lamp, faults, state, _ = board.ask("status")[1]
    assert (lamp, faults, state) == (0, 1 << 3, 4), "a silent host costs the lamp"

    board.trips_ms.clear()
    for _ in range(200):
        board.ask("status")
    trips = sorted(board.trips_ms)
    print(f"homed in {home_s:.1f} s, moved 3 degrees in {move_s:.1f} s; "
          f"200 round trips: median {trips[100]:.2f} ms, longest {trips[-1]:.2f} ms")


if len(sys.argv) != 3:
    sys.exit(__doc__)
board = Board(sys.argv[1], sys.argv[2])
try:
    check(board)
finally:
    board.process.kill()
    board.process.wait()
