"""A log that does not repeat itself: for what may go wrong a thousand times a second."""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Callable

Log = Callable[[str, str], None]  # level and text
_SAY_EVERY = 1.0  # seconds between two lines about the same thing


class Throttle:
    """A log that says each thing once a second, with how often it happened since. Any thread."""

    def __init__(self, log: Log, clock: Callable[[], float] = time.monotonic) -> None:
        self._log = log
        self._clock = clock
        self._said: dict[str, deque[float]] = {}
        self._more: Counter[str] = Counter()
        self._lock = threading.Lock()

    def say(self, level: str, about: str, text: str, most: int = 1) -> None:
        """Log, a few lines a second. ``about`` identifies equal subjects. ``most``: maximum lines per second, for
        actions of persons."""
        now = self._clock()
        with self._lock:
            said = self._said.setdefault(about, deque())
            while said and now - said[0] >= _SAY_EVERY:
                said.popleft()
            if len(said) >= most:
                self._more[about] += 1
                return
            said.append(now)
            more = self._more.pop(about, 0)
        self._log(level, f"{text} ({more} more since the last line)" if more else text)
