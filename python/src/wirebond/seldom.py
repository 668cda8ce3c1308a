"""A rate limit for what is written to a log, so that no device and no client can fill a disk with it."""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections.abc import Collection
from typing import Any

EVERY = 1.0  # seconds between two reports


class Seldom:
    """Lets one report through in each period, and counts the others. Any thread.

    :param every: seconds of a period.
    """

    def __init__(self, every: float = EVERY) -> None:
        self._every = every
        self._lock = threading.Lock()
        self._next = float("-inf")
        self._left_out = 0

    def passes(self, now: float) -> int | None:
        """Return None where this report must be left out; else how many were left out since the last one."""
        with self._lock:
            if now < self._next:
                self._left_out += 1
                return None
            self._next = now + self._every
            left_out, self._left_out = self._left_out, 0
            return left_out


def and_more(left_out: int) -> str:
    """Return the end of a report: how many others there were."""
    return f" ({left_out} more since the last report)" if left_out else ""


class SeldomFilter(logging.Filter):
    """For a logger: one record a second from warnings on, and one below them. Add it to the loggers of a library that
    others can make write. Records for debugging are not limited.

    :param thread: limit only records of this thread.
    :param without: leave out records with these texts.
    """

    def __init__(self, thread: threading.Thread, without: Collection[str] = ()) -> None:
        super().__init__()
        self._thread = thread
        self._without = without
        self._warnings, self._others = Seldom(), Seldom()

    def filter(self, record: logging.LogRecord) -> bool:
        """See ``logging.Filter``."""
        if record.thread != self._thread.ident or record.levelno < logging.INFO:
            return True
        if record.msg in self._without:
            return False
        seldom = self._others if record.levelno < logging.WARNING else self._warnings
        left_out = seldom.passes(time.monotonic())
        if left_out is None:
            return False
        record.msg = f"{record.msg}{and_more(left_out)}"
        return True


def limit_errors_of(loop: asyncio.AbstractEventLoop) -> None:
    """Log errors that no program awaits, such as of a connection, once a second at most."""
    seldom = Seldom()

    def handle(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        left_out = seldom.passes(time.monotonic())
        if left_out is not None:
            loop.default_exception_handler({**context, "message": f"{context['message']}{and_more(left_out)}"})

    loop.set_exception_handler(handle)
