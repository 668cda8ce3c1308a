"""A round trip in Python over an idle pty, with Wirebond and with pyserial. The rules: bench/README.md.

With Wirebond a Python program sends a message and waits until it has the message that comes back, with its checks and
its values. With pyserial it writes the same bytes and reads as many, and nothing more. The far end is the same C++
program, which sends back what it reads. Each end has a processor of its own, and the two take turns, pyserial before
and behind.
"""

from __future__ import annotations

import time
from pathlib import Path
from statistics import median

import serial

import wirebond
from bench.figures import Figure
from bench.round_trip import FEW, PROTOCOL, TRIPS, VALID, Percentiles, far_end, in_turns, percentiles

COMMAND = "make bench ONLY=python_round_trip"
GOAL = 1.2
_VALUES = {"values": [0.5 * i for i in range(8)], "flags": 7}


def measure() -> list[Figure]:
    rows = in_turns("pyserial", with_pyserial, with_wirebond)
    control = median(behind[0] / before[0] for before, _, behind in rows)
    if not VALID[0] <= control <= VALID[1]:
        raise RuntimeError(f"void: pyserial against itself is {control:.2f}; run it on a quiet machine")
    ratio = median(2 * ours[0] / (before[0] + behind[0]) for before, ours, behind in rows)
    return [
        Figure("python_round_trip_over_pyserial", ratio, "times", GOAL, COMMAND),
        Figure("python_round_trip_us", median(ours[0] for _, ours, _ in rows) / 1000, "µs", None, COMMAND),
        Figure("python_round_trip_control", control, "times", None, COMMAND),
    ]


def with_wirebond(program: Path, far: set[int], trips: int = TRIPS) -> Percentiles:
    took = []
    with far_end(program, "echo-bytes", far) as path, wirebond.open(PROTOCOL, path, paced=False) as link:
        for number in range(FEW + trips):
            began = time.monotonic()
            link.send("probe", number=number, **_VALUES)
            [message] = link.receive(10)
            took.append((time.monotonic() - began) * 1e9)
            assert message.fields["number"] == number
    return percentiles(took)


def with_pyserial(program: Path, far: set[int], trips: int = TRIPS) -> Percentiles:
    codec = wirebond.load(PROTOCOL)
    link = codec.model.link
    took = []
    with (
        far_end(program, "echo-bytes", far) as path,
        serial.Serial(path, link.baud, stopbits=serial.STOPBITS_TWO, timeout=10) as port,
    ):
        for number in range(FEW + trips):
            frame = codec.encode("probe", number=number, **_VALUES)
            began = time.monotonic()
            port.write(frame)
            back = port.read(len(frame))
            took.append((time.monotonic() - began) * 1e9)
            assert back == frame
    return percentiles(took)
