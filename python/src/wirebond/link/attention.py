"""Waiting for events of a link that Python drives: as in the engine's ``Link``, with conditions of Python."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable


class Attention:
    """Every wait ends as well when the link has ended.

    :param arrived: notified of news, of events, and when the link has ended. Its lock may be held by the caller.
    :param has_news: is something there to be taken?
    :param is_done: has the link ended?
    """

    def __init__(self, arrived: threading.Condition, has_news: Callable[[], bool], is_done: Callable[[], bool]) -> None:
        self._arrived = arrived
        self._has_news = has_news
        self._is_done = is_done
        self._is_attended = False
        self._is_recalled = False

    def wait(self, timeout: float) -> None:
        """Wait until there is something to take."""
        self._wait_for(self._has_news, timeout)

    def attend(self, timeout: float) -> None:
        """Do the same for the one thread that takes whatever comes when it has nothing else to do."""
        with self._arrived:
            self._is_attended = True
            try:
                self._wait_for(lambda: self._has_news() or self._is_recalled, timeout)
            finally:
                self._is_attended = self._is_recalled = False

    def recall(self) -> None:
        """End the wait of ``attend``: of this call, or of the next one."""
        with self._arrived:
            self._is_recalled = True
            self._arrived.notify_all()

    def wait_unattended(self, timeout: float) -> None:
        """Wait until there is something to take while no thread is in ``attend``."""
        self._wait_for(lambda: self._has_news() and not self._is_attended, timeout)

    def _wait_for(self, is_ready: Callable[[], bool], timeout: float) -> None:
        until = time.monotonic() + min(max(timeout, 0.0), 1e6) if timeout == timeout else 0.0  # noqa: PLR0124 NaN
        with self._arrived:
            while not is_ready() and not self._is_done():
                left = until - time.monotonic()
                if left <= 0:
                    return
                self._arrived.wait(left)
