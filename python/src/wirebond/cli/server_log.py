"""Prints the warnings of a server on stderr, such as who released an emergency stop."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from wirebond.cli.output import errors, plain


class _Shows(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        errors.print(plain(record.getMessage()), soft_wrap=True)


@contextmanager
def shown_server_log() -> Iterator[None]:
    """Within this, warnings of servers are printed."""
    logger, handler = logging.getLogger("wirebond.server"), _Shows(logging.WARNING)
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)
