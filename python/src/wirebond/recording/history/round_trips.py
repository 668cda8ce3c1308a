"""Computes how long replies took, from the times of requests and replies. No thread, no clock."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

_WINDOW = 60.0  # seconds
_MOST_KEPT = 4096
_MOST_WAITING = 256


class RoundTrips:
    """The round trips of all requests together. A reply belongs to the oldest waiting request of its kind."""

    def __init__(self) -> None:
        self._asked: dict[str, deque[float]] = {}
        self._found: deque[tuple[float, float]] = deque(maxlen=_MOST_KEPT)

    def ask(self, reply: str, times: NDArray[np.float64]) -> None:
        """Note that requests left that this message answers."""
        self._asked.setdefault(reply, deque(maxlen=_MOST_WAITING)).extend(times[-_MOST_WAITING:].tolist())

    def answer(self, reply: str, times: NDArray[np.float64]) -> None:
        """Note received replies."""
        waiting = self._asked.get(reply)
        if not waiting:
            return
        for t in times.tolist():
            before = None
            while waiting and waiting[0] <= t:
                before = waiting.popleft()
                if not waiting or waiting[0] > t - 1.0:  # older ones were never answered
                    break
            if before is not None:
                self._found.append((t, t - before))

    def figures(self, now: float) -> dict[str, float] | None:
        """Return percentiles of the last minute, in seconds; None: there was none."""
        while self._found and self._found[0][0] < now - _WINDOW:
            self._found.popleft()
        if not self._found:
            return None
        taken = np.array([seconds for _, seconds in self._found])
        p50, p95, p99 = np.percentile(taken, (50, 95, 99)).tolist()
        return {"count": len(taken), "p50": p50, "p95": p95, "p99": p99, "max": float(taken.max())}
