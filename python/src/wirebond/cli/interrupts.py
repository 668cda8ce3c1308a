"""Handles Ctrl-C: an immediate end while a command starts, an exception while it works, nothing while it ends."""

from __future__ import annotations

import os
import signal

EXIT_INTERRUPTED = 130


def end_at_once() -> None:
    """For the start: an exception in the middle of an import would end as a traceback, or be swallowed there."""
    _handle(lambda *_: os._exit(EXIT_INTERRUPTED))


def raise_from_here() -> None:
    """For the work: KeyboardInterrupt, so that what is open is closed and an account given."""
    _handle(signal.default_int_handler)


def ignore() -> None:
    """For the end: everything is done, and Python takes a moment to leave."""
    _handle(signal.SIG_IGN)


def _handle(handler: signal._HANDLER) -> None:
    if signal.getsignal(signal.SIGINT) != signal.SIG_IGN:  # as a shell sets it for a job in the background
        signal.signal(signal.SIGINT, handler)
