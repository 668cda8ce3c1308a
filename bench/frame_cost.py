"""Measures the cost of a frame in the run-time engine, against goals in instructions and against the machine's limit in
time.

``decode_ir_per_frame``, ``decode_ir_per_frame_table``, ``encode_ir_per_frame``: callgrind's count, difference of two
runs. ``decode_over_limit``: decoding against both checks of each frame by the fastest CRC of this processor and one
copy of its bytes; median of nine interleaved pairs. Each on two frames of 48 and 45 bytes; the larger is the figure.
"""

from __future__ import annotations

import random
import re
import subprocess
from pathlib import Path

from tests.streams import random_values

import wirebond
from bench.collateral import PROTOCOL, SEED
from bench.figures import Figure
from bench.native import build, instructions

FRAMES = 1000
MESSAGES = {"field_msg": 48, "sentry_gimbal_msg": 45}
COMMAND = "make bench ONLY=frame_cost"
GOALS = {"decode": 250.0, "decode_table": 360.0, "encode": 250.0}
KEYS = {
    "decode": "decode_ir_per_frame",
    "decode_table": "decode_ir_per_frame_table",
    "encode": "encode_ir_per_frame",
}
ROUNDS_OF_A_PAIR = 300


def streams(folder: Path) -> dict[str, Path]:
    """A file of frames for each message."""
    proto = wirebond.load(PROTOCOL)
    source = random.Random(SEED)
    paths = {}
    for name, size in MESSAGES.items():
        message = next(m for m in proto.model.messages if m.name == name)
        frames = [proto.encode(name, random_values(message, source)) for _ in range(FRAMES)]
        assert {len(frame) for frame in frames} == {size}
        paths[name] = folder / f"{name}.bin"
        paths[name].write_bytes(b"".join(frames))
    return paths


def count(program: Path, work: str, stream: Path, size: int) -> float:
    """Instructions per frame: two runs that differ in their rounds only."""
    frames = 1 if work == "encode" else FRAMES
    rounds = (1000, 3000) if work == "encode" else (4, 12)
    short, long = (instructions([str(program), work, str(stream), str(size), str(n)]) for n in rounds)
    return (long - short) / (frames * (rounds[1] - rounds[0]))


def over_limit(program: Path, stream: Path, size: int) -> float:
    command = [str(program), "over_limit", str(stream), str(size), str(ROUNDS_OF_A_PAIR)]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    print("  " + result.stdout.strip().replace("\n", "\n  "))
    found = re.search(r"ratio ([0-9.]+)", result.stdout)
    assert found is not None
    return float(found.group(1))


def measure() -> list[Figure]:
    program = build("frame_cost")
    files = streams(program.parent)
    figures = []
    for work, goal in GOALS.items():
        counts = {name: count(program, work, files[name], size) for name, size in MESSAGES.items()}
        print(f"{work}: " + ", ".join(f"{name} {value:.1f} instructions" for name, value in counts.items()))
        figures.append(Figure(KEYS[work], max(counts.values()), "instructions", goal, COMMAND))
    ratios = {}
    for name, size in MESSAGES.items():
        print(f"{name}, time against the limit:")
        ratios[name] = over_limit(program, files[name], size)
    figures.append(Figure("decode_over_limit", max(ratios.values()), "times", 1.5, COMMAND))
    return figures
