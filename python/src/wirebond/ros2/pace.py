"""Decides how often a thread fetches messages: at a high rate it waits until several have arrived."""

from __future__ import annotations

import time
from collections.abc import Callable


class Pace:
    """Waking a thread costs more than a message. At a high rate each read finds all that came in ``gap`` seconds; no
    message waits longer for it. What comes one or two at a time does not wait. One thread."""

    def __init__(
        self,
        gap: float,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._gap = gap
        self._clock = clock
        self._sleep = sleep
        self._next = 0.0

    def wait(self) -> None:
        """Wait before each check for messages."""
        now = self._clock()
        if now < self._next:
            self._sleep(self._next - now)
            now = self._next
        self._next = now + self._gap
