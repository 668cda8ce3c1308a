"""The loop of a command that runs for some seconds, or until Ctrl-C."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

_ROUNDING = 1e-6  # seconds


def time_left(seconds: float | None) -> Iterator[float]:
    """Yield for each round of the loop the seconds that are left; None: without end.

    There is always a last round after the end, with 0.0: it shows the state before the end.
    """
    end = math.inf if seconds is None else time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0:
        yield left
    yield 0.0


def paced(rate: float, seconds: float | None) -> Iterator[None]:
    """Yield ``rate`` times a second, at first at once: at 20 a second, half a second has ten rounds.

    After a stall it continues from there, without the rounds that it missed.
    """
    due = time.monotonic()
    end = math.inf if seconds is None else due + seconds
    while end - due > _ROUNDING:
        time.sleep(max(0.0, due - time.monotonic()))
        yield
        due = max(due + 1 / rate, time.monotonic())
