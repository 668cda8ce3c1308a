"""Simulates a UART with another rate or parity than the sender's: bits are sampled in their middle."""

from __future__ import annotations

import math
from collections.abc import Sequence

from wirebond.protocol.model import Parity


def misread(data: bytes, sent: tuple[float, Parity], heard: tuple[float, Parity], gaps: Sequence[int] = ()) -> bytes:
    """Return the bytes that a receiver gets, framing and parity errors ignored as a tty in raw mode does.

    :param sent: rate and parity of the sender; ``heard``: those of the receiver.
    :param gaps: offsets of bytes in front of which the line rests for two bytes.
    """
    pauses = set(gaps)
    levels = [1, 1]
    for offset, byte in enumerate(data):
        if offset in pauses:
            levels += [1] * 20
        bits = [byte >> bit & 1 for bit in range(8)]
        levels += [0, *bits, *_parity(bits, sent[1]), 1]
    levels += [1] * 4
    step = sent[0] / heard[0]  # bits of the sender for one of the receiver
    width = 9 + (heard[1] != Parity.NONE)
    out = bytearray()
    at = 0.0
    while True:
        begin = _falling_edge(levels, at)
        if begin is None:
            return bytes(out)
        last = begin + (width + 0.5) * step  # the middle of the stop bit
        if last >= len(levels):
            return bytes(out)
        out.append(sum(levels[int(begin + (1.5 + bit) * step)] << bit for bit in range(8)))
        at = last


def _parity(bits: list[int], parity: Parity) -> list[int]:
    if parity == Parity.NONE:
        return []
    return [sum(bits) & 1 ^ (parity == Parity.ODD)]


def _falling_edge(levels: list[int], at: float) -> int | None:
    """Return where the next start bit begins: the line must be high before it."""
    place = math.floor(at)
    end = len(levels)
    while place < end and levels[place] == 0:
        place += 1
    while place < end and levels[place] == 1:
        place += 1
    return place if place < end else None
