"""The times at which the host's port goes away in a soak, and comes back."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass

from wirebond.errors import UsageError

LEAST = 0.01  # seconds that it is away: longer than the driver holds bytes
_SHORTEST, _LONGEST = 0.05, 2.0  # seconds of those at random
_MOST = 10_000


@dataclass(frozen=True)
class At:
    """Once: ``at`` seconds after the start, for ``seconds``."""

    at: float
    seconds: float


@dataclass(frozen=True)
class AtRandom:
    """This many times, at moments and for lengths drawn from the seed."""

    times: int


Unplug = At | AtRandom


def unplug(text: str) -> Unplug:
    """Read times of unplugging: ``2:0.5`` means after 2 s, for 0.5 s; ``20`` means 20 times, at random.

    :raises UsageError: it is something else.
    """
    at, colon, length = text.partition(":")
    try:
        found: Unplug = At(float(at), float(length)) if colon else AtRandom(int(at))
    except ValueError:
        found = AtRandom(0)
    if isinstance(found, At) and 0 <= found.at <= 1e6 and LEAST <= found.seconds <= 1e6:
        return found
    if isinstance(found, AtRandom) and 1 <= found.times <= _MOST:
        return found
    raise UsageError(
        f"--unplug {text}: expected AT:FOR in seconds, such as 2:0.5, at least {LEAST:g} s long; or how often at "
        f"random, such as 20, at most {_MOST}"
    )


def plug_times(unplugs: Sequence[Unplug], length: float, seed: int) -> list[float]:
    """Return the seconds at which the port goes away, comes back, and so on, in a soak of this length. Those that
    overlap are one. It is back at the end."""
    source = random.Random(seed)  # noqa: S311 it keeps no secret
    spans = []
    for one in unplugs:
        if isinstance(one, At):
            spans.append((one.at, one.at + one.seconds))
            continue
        longest = min(_LONGEST, max(length / (2 * one.times), LEAST))
        for _ in range(one.times):
            at = source.uniform(0.0, length)
            spans.append((at, at + source.uniform(min(_SHORTEST, longest), longest)))
    times: list[float] = []
    for begin, end in sorted((begin, min(end, length)) for begin, end in spans):
        if end - begin < LEAST:
            continue
        if times and begin - times[-1] < LEAST:
            times[-1] = max(times[-1], end)
        else:
            times += [begin, end]
    return times
