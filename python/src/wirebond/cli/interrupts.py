"""Handles Ctrl-C: an immediate end while a command starts, an exception while it works, nothing while it ends."""

from __future__ import annotations

import os
import signal

EXIT_INTERRUPTED = 130


def end_at_once() -> None:
    """End at once on Ctrl-C, during the start: an exception in the middle of an import would end as a traceback, or be
    swallowed there."""
    _handle(lambda *_: os._exit(EXIT_INTERRUPTED))


def raise_from_here() -> None:
    """Raise KeyboardInterrupt on Ctrl-C, during the work: open ports are closed and an account is given."""
    _handle(signal.default_int_handler)


def ignore() -> None:
    """Ignore Ctrl-C at the end: everything is done, and Python takes a moment to exit."""
    _handle(signal.SIG_IGN)


def _handle(handler: signal._HANDLER) -> None:
    if signal.getsignal(signal.SIGINT) != signal.SIG_IGN:  # as a shell sets it for a job in the background
        signal.signal(signal.SIGINT, handler)
