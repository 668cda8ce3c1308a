"""Tries all kinds of check on the samples, and computes the probability that the result fits by chance."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import or_

from wirebond.analysis.checksum import checksum
from wirebond.analysis.explain.solve.crcs import crcs
from wirebond.analysis.explain.solve.sample import LEAST_SAMPLES, Sample
from wirebond.analysis.explain.solve.sent import sent_otherwise
from wirebond.analysis.explain.solve.sums import sums
from wirebond.protocol.model import Algorithm, CheckKind

_WAYS = 10  # bits: the kinds, units, orders, widths and reflections among which one is chosen


@dataclass(frozen=True)
class Solution:
    """``freedom``: bits that could be chosen to make it fit. ``evidence``: bits of each value that it explains."""

    algorithm: Algorithm
    freedom: int
    evidence: int


def solve(samples: Sequence[Sample], size: int, *, thorough: bool = True) -> Solution | None:
    """Return the check of ``size`` bytes that all the samples have, or all but one, which may be damaged; of several
    the one that is least likely by chance. None if no one fits. Pure.

    :param thorough: also CRCs whose last steps hide their polynomial, and one damaged sample. That takes some seconds.
    """
    unlike = list(dict.fromkeys(samples))
    found = _solve(unlike, size, thorough=thorough)
    if thorough and found is None and len(unlike) > LEAST_SAMPLES + 1:
        others = (_solve([*unlike[:i], *unlike[i + 1 :]], size, thorough=False) for i in range(len(unlike)))
        found = next((one for one in others if one is not None), None)
    return found


def _solve(samples: Sequence[Sample], size: int, *, thorough: bool) -> Solution | None:
    varying = reduce(or_, (sample.value ^ samples[0].value for sample in samples), 0)
    if len(samples) < LEAST_SAMPLES or not varying:
        return None
    evidence = varying.bit_count()
    found = [Solution(one, _freedom(one, varying), evidence) for one in _fitting(samples, size, thorough=thorough)]
    best = min(found, key=lambda one: one.freedom, default=None)
    return best if best is not None and best.freedom < evidence * len(samples) else None


def _fitting(samples: Sequence[Sample], size: int, *, thorough: bool) -> Iterator[Algorithm]:
    used = max(sample.value for sample in samples).bit_length()
    widths = [8 * size, *range(max(used, 3), 8 * size)]
    for width in widths:
        for candidates in (
            sums(samples, width),
            sent_otherwise(samples, width),
            crcs(samples, width, thorough=thorough),
        ):
            found = [one for one in candidates if all(checksum(one, each.covered) == each.value for each in samples)]
            if found:
                yield from found
                return


def _freedom(algorithm: Algorithm, varying: int) -> int:
    """Count the bits of unusual parameters, without those of a final xor over bits that never vary."""
    every = (1 << algorithm.width) - 1
    bits = _WAYS
    if algorithm.kind == CheckKind.CRC:
        bits += algorithm.width
    if algorithm.init not in (0, every):
        bits += algorithm.width
    if algorithm.xorout & varying not in (0, varying):
        bits += varying.bit_count()
    if algorithm.plus:
        bits += algorithm.width
    if algorithm.kept & varying != varying or algorithm.mask is not None:
        bits += algorithm.width
    if algorithm.avoided:
        bits += 3 * algorithm.width
    return bits
