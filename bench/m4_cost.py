"""What a frame costs generated C++ on a Cortex-M4, in instructions: counted under emulation, difference of two runs.

Decoding: a frame's bytes lie in a ring of 512 bytes, one frame in eight across its end; each frame is handed to
``Receiver::feed`` when it has come; it is found, its checks are made, its message's struct is filled and its handler
called. Encoding: from the filled struct to the bytes on the wire. On two messages; the larger is the figure. The loop
that hands over frames is counted with them. At -Os beside it, where no goal is set.
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from pathlib import Path

from tests.streams import random_values

import wirebond
from bench.collateral import PROTOCOL, SEED
from bench.cortex_m4 import Program, compile_program
from bench.figures import Figure

RING = 512
PLACES = 8  # of frames in the ring
LEAD = 5  # bytes before the payload
MESSAGES = {"field_msg": "encode_field", "sentry_gimbal_msg": "encode_sentry_gimbal"}
GOALS = {
    "-O2": {"m4_decode_instructions": 400.0, "m4_encode_instructions": 330.0},
    "-Os": {"m4_decode_instructions_os": None, "m4_encode_instructions_os": None},
}
ROUNDS = (40, 200)
SOURCE = Path(__file__).with_name("m4_cost.cpp")


def places(frame_bytes: int) -> list[int]:
    """Where in the ring m4_cost.cpp looks for its eight frames: half of the last one lies behind the ring's end."""
    return [RING // PLACES * (index + 1) - frame_bytes // 2 for index in range(PLACES)]


def ring_of(frames: list[bytes]) -> bytes:
    ring = bytearray(RING)
    for frame, at in zip(frames, places(len(frames[0])), strict=True):
        for i, byte in enumerate(frame):
            ring[(at + i) % RING] = byte
    return bytes(ring)


def example_frames(name: str) -> list[bytes]:
    proto = wirebond.load(PROTOCOL)
    message = next(m for m in proto.model.messages if m.name == name)
    source = random.Random(SEED)
    return [proto.encode(name, random_values(message, source)) for _ in range(PLACES)]


def difference(program: Program, function: str, argument: int, wanted: dict[int, int]) -> float:
    """Instructions per round of a function whose second argument is its rounds; ``wanted``: what it answers to each."""
    counts = []
    for rounds, answer in wanted.items():
        found = program.call(function, argument, rounds)
        assert found == answer, f"{function} answers {found}, not {answer}"
        counts.append(program.counts.total())
    short, long = wanted
    return (counts[1] - counts[0]) / (long - short)


def cost(program: Program, name: str) -> dict[str, float]:
    """Instructions a frame. Fails where the emulated code does anything else than the host's engine."""
    frames = example_frames(name)
    size = len(frames[0])
    program.write("ring", ring_of(frames))
    for place, frame in enumerate(frames):
        assert program.call("receive_and_encode", size, place) == size, f"frame {place} of {name} is not received"
        assert program.read("out", size) == frame, f"frame {place} of {name} comes out as another"
    payload = places(size)[0] + LEAD
    found = {
        "decode": difference(program, "receive", size, {rounds: rounds for rounds in ROUNDS}),
        "encode": difference(program, MESSAGES[name], payload, dict.fromkeys(ROUNDS, size)),
    }
    assert program.read("out", size) == frames[0]
    return found


def measure(flags: Sequence[str] = tuple(GOALS)) -> list[Figure]:
    figures = []
    for flag in flags:
        program = Program(compile_program(SOURCE, flag))
        costs = {name: cost(program, name) for name in MESSAGES}
        for work, (key, goal) in zip(("decode", "encode"), GOALS[flag].items(), strict=True):
            values = {name: costs[name][work] for name in MESSAGES}
            print(f"{flag} {work}: " + ", ".join(f"{n} {value:.1f} instructions" for n, value in values.items()))
            figures.append(Figure(key, max(values.values()), "instructions", goal, "make bench ONLY=m4_cost"))
    return figures
