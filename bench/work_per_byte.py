"""``worst_ir_per_byte``: instructions that the run-time engine spends on a received byte, worst of three inputs.

Callgrind counts a small program that feeds the enterprize format (compiled from its generated description, read at run
time) in 64-byte chunks; the figure is the difference of two runs of different length over the difference of bytes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bench.collateral import SEED, START
from bench.figures import Figure
from bench.native import build, instructions

SHORT, LONG = 50_000, 150_000  # bytes
GOAL = 400


def crafted(size: int) -> bytes:
    """Headers whose own check holds, as densely as they can overlap, each claiming the longest payload it can.

    A header is AA, length, id and two check bytes. Where the check's high byte is AA it is the next header's start, so
    that a valid header begins at every fourth byte, and each makes the engine run the check over a whole frame in vain.
    """
    best: tuple[int, bytes] | None = None
    for length in range(42):
        for message_id in range(256):
            low, high = _crc(bytes([START, length, message_id])).to_bytes(2, "little")
            if high == START and (best is None or length > best[0]):
                best = length, bytes([START, length, message_id, low])
    assert best is not None
    return (best[1] * (size // 4 + 1))[:size]


def _crc(data: bytes) -> int:
    register = 0xFFFF
    for byte in data:
        register ^= byte
        for _ in range(8):
            register = (register >> 1) ^ (0x8408 if register & 1 else 0)
    return register


INPUTS = {
    "random": lambda size: np.random.default_rng(SEED).integers(0, 256, size, dtype=np.uint8).tobytes(),
    "all-magic": lambda size: bytes([START]) * size,
    "crafted false headers": crafted,
}


def per_run(program: Path, stream: bytes) -> int:
    path = program.with_name("stream.bin")
    path.write_bytes(stream)
    return instructions([str(program), str(path)])


def measure() -> list[Figure]:
    program = build("work_per_byte")
    worst = 0.0
    for name, make in INPUTS.items():
        per_byte = (per_run(program, make(LONG)) - per_run(program, make(SHORT))) / (LONG - SHORT)
        print(f"{name}: {per_byte:.1f} instructions per byte")
        worst = max(worst, per_byte)
    return [Figure("worst_ir_per_byte", worst, "instructions", GOAL, "make bench ONLY=work_per_byte")]
