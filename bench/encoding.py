"""Frames a second from values to bytes in Python, against Python's struct with a CRC in native code.

``encode_per_s``: ``codec.encode(name, values)`` for the nine enterprize messages in equal shares.
``encode_over_struct``: the same over an engineer's own ``struct.pack`` and two CRCs, which know the layout and check
nothing. Both take turns; medians over the rounds, the ratio within a round.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from statistics import median
from sys import intern

import wirebond
from bench.collateral import PROTOCOL
from bench.figures import Figure
from bench.peers.struct_codec import FORMATS, StructCrc
from bench.peers.work import elements, samples

FRAMES = 9_000
ROUNDS = 9
LEAST_SECONDS = 0.1  # of one measurement
COMMAND = "make bench ONLY=encoding"


def rate(work: Callable[[], object], frames: int, least_seconds: float) -> float:
    """Frames a second."""
    times, seconds = 0, 0.0
    gc.collect()
    start = time.perf_counter()
    while times == 0 or seconds < least_seconds:
        work()
        times, seconds = times + 1, time.perf_counter() - start
    return frames * times / seconds


def measure(frames: int = FRAMES, rounds: int = ROUNDS, least_seconds: float = LEAST_SECONDS) -> list[Figure]:
    """:raises RuntimeError: the two do not make the same bytes."""
    content = samples(frames)
    # As names in a program's source are: Python then finds them without comparing their letters.
    named = [
        (intern(message.name), {intern(name): value for name, value in values.items()}) for message, values in content
    ]
    packed = [(message.id, FORMATS[message.id].pack, tuple(elements(values))) for message, values in content]
    encode, frame = wirebond.load(PROTOCOL).encode, StructCrc().frame

    def ours() -> list[bytes]:
        return [encode(name, values) for name, values in named]

    def by_hand() -> list[bytes]:
        return [frame(number, pack(*values)) for number, pack, values in packed]

    if ours() != by_hand():
        raise RuntimeError("the frames are not the same")
    found, ratios = [], []
    for _ in range(rounds):
        found.append(rate(ours, frames, least_seconds))
        ratios.append(found[-1] / rate(by_hand, frames, least_seconds))
    return [
        Figure("encode_per_s", median(found), "frames/s", 1e6, COMMAND, at_most=False),
        Figure("encode_over_struct", median(ratios), "times", None, COMMAND, at_most=False),
    ]
