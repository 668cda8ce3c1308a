"""Frames judged together: how much of all the bytes a change to the file explains, and what chance would explain."""

from __future__ import annotations

import math
from dataclasses import dataclass

from wirebond.analysis.explain.guesses.guess import Guess, evidence
from wirebond.analysis.explain.scan import Found, Scan, scan
from wirebond.analysis.explain.verdict import Cause

# What a candidate fails by that has a frame's size: bytes that begin as a frame only by chance seldom get as far.
_COUNTED = (Cause.CHECK_MISMATCH, Cause.HEADER_CHECK_MISMATCH, Cause.UNKNOWN_MESSAGE, Cause.BAD_STUFFING)


@dataclass(frozen=True)
class Together:
    """``fits`` of ``of`` candidates are frames by the change and were none before. Those that it loses count as well:
    they do not fit. ``sizes``: of the frames won."""

    fits: int
    of: int
    sizes: tuple[int, ...] = ()


ALONE = Together(1, 1)


def chance_of(values: float, tried: int, together: Together) -> float:
    """Return the chance that one of ``tried`` guesses fits as many of the frames or more, if each fits a frame in 1 of
    ``values`` cases.

    The upper tail of the binomial distribution, and the chance that the best of the guesses reaches it.
    """
    if values <= 1:
        return 1.0
    tail = min(1.0, sum(_exactly(k, together.of, 1 / values) for k in range(together.fits, together.of + 1)))
    return 1.0 if tail >= 1 else -math.expm1(tried * math.log1p(-tail))


def _exactly(k: int, n: int, p: float) -> float:
    """Return the chance that exactly ``k`` of ``n`` independent cases with chance ``p`` occur. In logarithms: the
    factors are huge."""
    choices = math.lgamma(n + 1) - math.lgamma(k + 1) - math.lgamma(n - k + 1)
    return math.exp(choices + k * math.log(p) + (n - k) * math.log1p(-p))


class Stream:
    """All given bytes, as the file reads them and as a guess reads them. One thread."""

    def __init__(self, data: bytes, before: Scan) -> None:
        self._data = data
        self._good = {(found.offset, found.size) for found in before.frames}

    def by(self, guess: Guess) -> Together:
        """Judge in one pass over all bytes. Frames without a strong check are not counted."""
        found = scan(guess.protocol, self._data, guess.sender)
        frames = {(one.offset, one.size) for one in found.frames}
        won = [one for one in found.frames if (one.offset, one.size) not in self._good and _proves(one)]
        lost = len(self._good - frames)
        refused = sum(found.rejected[cause] for cause in _COUNTED)
        fits = max(1, len(won))
        return Together(fits, max(fits + lost + refused, 1), tuple(one.size for one in won))


def _proves(found: Found) -> bool:
    return evidence(found.verdict) > 1
