"""Times in which this process did not run: messages that ROS sent in them are old when they are taken."""

from __future__ import annotations

import time
from collections.abc import Callable

_OLDEST = 0.5  # seconds that a message may have waited; it is checked ten times a second
_SETTLE = 1.0  # seconds after a stall in which the middleware still delivers queued messages


class Stalls:
    """Notices that the thread which takes messages was held up: by a SIGSTOP, a computer without a free core, a server
    that did not answer. A message does not say how long it waited; its stamp is of the clock of another computer.

    One thread calls ``look``; any thread may ask.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._looked = clock()
        self._old_until = 0.0
        self._lasted = 0.0

    def begin(self) -> None:
        """Forget the time before the first ``look``."""
        self._looked = self._clock()

    def look(self) -> None:
        """Note that the thread runs. It calls this before each search for messages, at least ten times a second."""
        now = self._clock()
        if now - self._looked > _OLDEST:
            self._lasted = now - self._looked
            self._old_until = now + _SETTLE
        self._looked = now

    @property
    def why_old(self) -> str:
        """Say why messages that are taken now may be old; empty: they are not."""
        now = self._clock()
        if now - self._looked > _OLDEST:
            return _WHY.format(now - self._looked)
        return _WHY.format(self._lasted) if now < self._old_until else ""


_WHY = "it may have waited while this node was held up for {:.1f} s; publish it again if it is still wanted"
