"""Sums and xors that are not sent as the numbers that they are: in decimal digits, or without some values."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from wirebond.analysis.checksum import checksum
from wirebond.analysis.explain.solve.sample import Sample
from wirebond.analysis.explain.solve.sums import sums
from wirebond.protocol.model import Algorithm, CheckKind

_BYTE = 8  # bits


def sent_otherwise(samples: Sequence[Sample], width: int) -> Iterator[Algorithm]:
    """Yield the algorithms that the samples may have with a sent form of the value; the caller compares the values."""
    if width % 4 == 0:
        yield from _in_digits(samples, width)
    if width <= _BYTE:
        yield from _avoiding(samples, width)


def _in_digits(samples: Sequence[Sample], width: int) -> Iterator[Algorithm]:
    """Yield sums in decimal digits of four bits each; plain ones also if digits have no room."""
    digits = [f"{sample.value:x}" for sample in samples]
    if not all(map(str.isdecimal, digits)):
        return
    numbers = [Sample(sample.covered, int(text)) for sample, text in zip(samples, digits, strict=True)]
    yield from (replace(one, bcd=True) for one in sums(numbers, width) if one.kind == CheckKind.SUM)
    for negate in (False, True):
        yield Algorithm(CheckKind.SUM.value, CheckKind.SUM, width, negate=negate, bcd=True)


def _avoiding(samples: Sequence[Sample], width: int) -> Iterator[Algorithm]:
    """Yield plain sums and xors that add one number to some values, from 0 or from the lowest one seen."""
    for kind in (CheckKind.XOR, CheckKind.SUM):
        for negate in (False, True) if kind == CheckKind.SUM else (False,):
            plain = Algorithm(kind.value, kind, width, negate=negate)
            known = [(checksum(plain, sample.covered), sample.value) for sample in samples]
            added = {(value - own) % (1 << width) for own, value in known} - {0}
            if len(added) != 1:
                continue
            sent = {own for own, value in known if own == value}
            avoided = {own for own, value in known if own != value}
            low, high = (0 if min(sent, default=0) > max(avoided) else min(avoided)), max(avoided)
            if not any(low <= own <= high for own in sent):
                yield replace(plain, avoided=((low, high),), avoided_plus=added.pop())
