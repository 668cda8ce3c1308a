"""The loop of a command that runs for some seconds, or until Ctrl-C."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator


def time_left(seconds: float | None) -> Iterator[float]:
    """Rounds of the loop, each with the seconds that are left; None: without end.

    There is always a last round behind the end, with 0.0: it shows what came before the end.
    """
    end = math.inf if seconds is None else time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0:
        yield left
    yield 0.0
