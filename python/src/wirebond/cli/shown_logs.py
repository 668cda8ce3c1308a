"""Prints warnings on stderr: who released an emergency stop at a server, or that another program has the port open."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from wirebond.cli.output import errors, plain


class _Shows(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        errors.print(plain(record.getMessage()), soft_wrap=True)


_OF_PORTS = _Shows(logging.WARNING)


def show_port_log() -> None:
    """Print the log of ports that are opened from now on."""
    logging.getLogger("wirebond.port").addHandler(_OF_PORTS)


@contextmanager
def shown_server_log() -> Iterator[None]:
    """Print warnings of servers within this block."""
    logger, handler = logging.getLogger("wirebond.server"), _Shows(logging.WARNING)
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)
