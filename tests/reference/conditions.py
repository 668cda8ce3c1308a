"""Conditions of parts (`when:`): do they hold, as far as is known?"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

from wirebond.protocol.model import Comparison, Condition, End, Subject


@dataclass
class Header:
    """What the parts before the payload say."""

    sender: End | None = None
    magic: bytes = b""
    numbers: dict[str, int] = field(default_factory=dict)
    id: int | None = None
    length: int | None = None
    asked: set[Comparison] = field(default_factory=set)  # of the payload's size


Known = dict[tuple[Subject, str], int]


Sizes = frozenset[Comparison]  # of the payload: those comparisons that are taken to hold


def truth(condition: Condition, header: Header, sizes: Sizes | None, known: Known | None = None) -> bool | None:
    """Does it hold? None where that depends on what is not known. ``sizes``: None if nothing is known of the payload's
    size; ``known``: numbers that are taken for granted. What is asked of ``sizes`` is noted in the header."""
    if sizes is not None and known is None:
        without = truth(condition, header, None)
        if without is not None:
            return without
    whole: bool | None = True
    for term in condition.terms:
        answer = _holds_now(term, header, sizes, known)
        if answer is False:
            return condition.negated
        if answer is None:
            whole = None
    return None if whole is None else not condition.negated


def _holds_now(term: Comparison | Condition, header: Header, sizes: Sizes | None, known: Known | None) -> bool | None:
    if isinstance(term, Condition):
        return truth(term, header, sizes, known)
    if term.subject == Subject.SENDER:
        ends = (End.HOST, End.MCU)
        return None if header.sender not in ends else term.holds(ends.index(header.sender))
    if term.subject == Subject.MAGIC:
        return bool(header.magic) and term.holds(int.from_bytes(header.magic, "big"))
    if term.subject == Subject.SIZE:
        if known is not None:
            return term.holds(known[Subject.SIZE, ""])
        if sizes is None:
            return None
        header.asked.add(term)
        return term in sizes
    if term.subject == Subject.ID:
        return header.id is not None and term.holds(header.id)
    return term.name in header.numbers and term.holds(header.numbers[term.name])


def telling_values(compared: list[Comparison], most: int) -> set[int]:
    """Values of one number, up to its greatest, among which each answer to these comparisons occurs. All values of a
    byte are tried; of a wider number the bounds, and the values around them whose bits are set or clear."""
    if most <= 0xFF:
        return set({tuple(c.holds(value) for c in compared): value for value in range(most + 1)}.values())
    bounds = {0} | {n for c in compared for low, high in c.ranges for n in (low - 1, low, high, high + 1) if n >= 0}
    masks = [c.mask for c in compared if c.mask is not None]
    found = set(bounds)
    for size in range(1, len(masks) + 1):
        for some in itertools.combinations(masks, size):
            together = 0
            for mask in some:
                together |= mask
            found |= {value | together for value in bounds} | {value & ~together for value in bounds}
            found |= {value + together & ~together for value in bounds}
    return {value for value in found if value <= most}
