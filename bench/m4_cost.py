"""Counts the instructions of a frame in generated code on a Cortex-M4, under emulation, as the difference of two runs.

Decoding: a frame's bytes lie in a ring of 512 bytes, one frame in eight across its end; each is handed over when it has
come; it is found, its checks are made, its message's struct is filled and its handler called. Encoding: from the filled
struct to the bytes on the wire. On two messages; the larger is the figure. The loop that hands over frames is counted
with them. At -Os beside it, where no goal is set. MAVLink's generated C does the same for comparison.
"""

from __future__ import annotations

import importlib
import random
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

from tests.streams import random_values

import wirebond
from bench.collateral import PROTOCOL, SEED
from bench.cortex_m4 import Program, compile_program
from bench.figures import Figure
from bench.native import BUILD
from bench.peers.wirebond_codec import Wirebond
from bench.peers.work import MODEL, Codec, Sample
from bench.report import Comparison, write_comparison
from wirebond.generate.code import generate_cpp

RING = 512
PLACES = 8  # of frames in the ring
FIRST_PLACE = 40
MESSAGES = ("field_msg", "sentry_gimbal_msg")  # in the order of ring.hpp's Which
ROUNDS = (40, 200)  # each a multiple of PLACES, so that every place counts alike
SHORT_ROUNDS = (PLACES, 2 * PLACES)
FOLDER = Path(__file__).with_name("firmware")
GOALS = {
    "-O2": {"m4_decode_instructions": 400.0, "m4_encode_instructions": 330.0},
    "-Os": {"m4_decode_instructions_os": None, "m4_encode_instructions_os": None},
}


def samples(name: str) -> list[Sample]:
    message = next(m for m in MODEL.messages if m.name == name)
    source = random.Random(SEED)
    return [(message, random_values(message, source)) for _ in range(PLACES)]


def put_into_ring(program: Program, frames: list[bytes]) -> None:
    ring = bytearray(RING)
    for place, frame in enumerate(frames):
        for i, byte in enumerate(frame):
            ring[(FIRST_PLACE + RING // PLACES * place + i) % RING] = byte
    program.write("ring", bytes(ring))
    program.write("frame_bytes", b"".join(len(frame).to_bytes(4, "little") for frame in frames))


def difference(program: Program, function: str, arguments: Sequence[int], wanted: dict[int, int]) -> float:
    """Instructions per round of a function whose last argument is its rounds; ``wanted``: what it answers to each."""
    counts = []
    for rounds, answer in wanted.items():
        found = program.call(function, *arguments, rounds)
        assert found == answer, f"{function} answers {found}, not {answer}"
        counts.append(program.counts.total())
    short, long = wanted
    return (counts[1] - counts[0]) / (long - short)


def cost(program: Program, codec: Codec, which: int, rounds: tuple[int, int]) -> dict[str, float]:
    """Instructions a frame. Fails where the emulated code does anything else than the codec in Python."""
    name = MESSAGES[which]
    frames = [codec.stream([sample]) for sample in samples(name)]
    put_into_ring(program, frames)
    for place, frame in enumerate(frames):
        size = program.call("receive_and_encode", place)
        assert size == len(frame), f"frame {place} of {name} comes out with {size} bytes, not {len(frame)}"
        assert program.read("out", size) == frame, f"frame {place} of {name} comes out as another"
    return {
        "decode": difference(program, "receive", (), {times: times for times in rounds}),
        "encode": difference(program, "encode_again", (which,), {times: len(frames[0]) for times in rounds}),
    }


def costs(program: Program, codec: Codec, rounds: tuple[int, int] = ROUNDS) -> dict[str, float]:
    """The larger of both messages."""
    found = [cost(program, codec, which, rounds) for which in range(len(MESSAGES))]
    return {work: max(one[work] for one in found) for work in ("decode", "encode")}


def wirebond_program(optimise: str) -> Program:
    generated = BUILD / "generated"
    generate_cpp(wirebond.load(PROTOCOL).model, generated)
    return Program(compile_program(FOLDER / "wirebond.cpp", optimise, [generated]))


def mavlink(optimise: str) -> tuple[Codec, dict[str, float]]:
    """ImportError or RuntimeError where pymavlink cannot make its C."""
    module = importlib.import_module("bench.peers.mavlink_codec")
    program = Program(compile_program(FOLDER / "mavlink.cpp", optimise, [module.generate("C")]))
    codec: Codec = module.Mavlink()
    return codec, costs(program, codec)


def measure() -> list[Figure]:
    ours = Wirebond()
    found = {flag: costs(wirebond_program(flag), ours) for flag in GOALS}
    compare(ours, found["-O2"])
    return [figure for flag, own in found.items() for figure in _figures(flag, own)]


def measure_shortly() -> list[Figure]:
    """At -O2, in fewer rounds, without the peer."""
    return _figures("-O2", costs(wirebond_program("-O2"), Wirebond(), SHORT_ROUNDS))


def _figures(flag: str, found: dict[str, float]) -> list[Figure]:
    return [
        Figure(key, found[work], "instructions", goal, "make bench ONLY=m4_cost")
        for work, (key, goal) in zip(("decode", "encode"), GOALS[flag].items(), strict=True)
    ]


def compare(ours: Codec, found: dict[str, float]) -> None:
    rows = {ours.name: found}
    notes = {ours.name: f"{ours.package} {version(ours.package)}, {ours.licence}"}
    try:
        codec, theirs = mavlink("-O2")
        rows["MAVLink 2 (C)"] = theirs
        notes["MAVLink 2 (C)"] = f"pymavlink {version(codec.package)}; the generated C is MIT"
    except (ImportError, RuntimeError) as reason:
        print(f"MAVLink is left out: {reason}. Its package is listed in requirements-dev.txt.")
    for work, title in (("decode", "to receive a frame"), ("encode", "to make a frame")):
        write_comparison(
            Comparison(
                key=f"m4_{work}",
                title=f"Instructions {title} on a Cortex-M4, -O2",
                unit="instructions",
                rows={name: value[work] for name, value in rows.items()},
                notes=notes,
                more_is_better=False,
            )
        )
