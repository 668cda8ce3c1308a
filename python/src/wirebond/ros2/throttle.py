"""A log that does not repeat itself: for what may go wrong a thousand times a second."""

from __future__ import annotations

import math
import threading
import time
from collections import Counter
from collections.abc import Callable

Log = Callable[[str, str], None]  # level and text
_SAY_EVERY = 1.0  # seconds between two lines about the same thing


class Throttle:
    """A log that says each thing once a second, with how often it happened since. Any thread."""

    def __init__(self, log: Log, clock: Callable[[], float] = time.monotonic) -> None:
        self._log = log
        self._clock = clock
        self._said: dict[str, float] = {}
        self._more: Counter[str] = Counter()
        self._lock = threading.Lock()

    def say(self, level: str, about: str, text: str) -> None:
        """``about`` is what counts as the same thing."""
        now = self._clock()
        with self._lock:
            if now - self._said.get(about, -math.inf) < _SAY_EVERY:
                self._more[about] += 1
                return
            self._said[about] = now
            more = self._more.pop(about, 0)
        self._log(level, f"{text} ({more} more since the last line)" if more else text)
