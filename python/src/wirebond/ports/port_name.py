"""What a port's name means: a tty's path, a USB device, or ``tcp://host:port``. Opens nothing."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from urllib.parse import urlsplit

from wirebond.errors import PortError, UsageError
from wirebond.ports.names import resolve

ADAPTER_LATENCY = 0.016  # seconds that a USB adapter may hold bytes back (FTDI's default); a serial server does as well


@dataclass(frozen=True)
class PortName:
    """``text``: as its user wrote it. A tty has neither ``host`` nor ``service``."""

    text: str
    host: str = ""
    service: str = ""  #: the TCP port's number

    @property
    def is_tcp(self) -> bool:
        return bool(self.host)

    @property
    def moves(self) -> bool:
        """May its path be another one each time that it is plugged in?"""
        return self.text.startswith("usb:")

    def path(self) -> str:
        """Where the tty is at the moment.

        :raises PortError: a USB device that is not there, or one of several that fit.
        """
        return resolve(self.text)


def port_name(port: str | os.PathLike[str]) -> PortName:
    """Read a port's name.

    :raises UsageError: it names none, or nothing that can be opened.
    """
    text = os.fsdecode(port)
    if not text:
        raise UsageError("the port's name is empty; give a tty such as /dev/ttyUSB0")
    if "\0" in text or (not text.isascii() and any("\udc80" <= c <= "\udcff" for c in text)):
        raise UsageError(
            f"the port's name {text!r} has a byte that no port's name has; give a tty such as /dev/ttyUSB0"
        )
    if text.startswith("usb:"):
        with suppress(PortError):  # it is not there now: what opens it says so
            resolve(text)
        return PortName(text)
    scheme, found, _ = text.partition("://")
    if not found or "/" in scheme:
        return PortName(text)
    if scheme.lower() != "tcp":
        raise UsageError(
            f"{text} is no port that can be opened; give a tty such as /dev/ttyUSB0, a USB device such as "
            "usb:1a86:55d3, or tcp://host:port"
        )
    return _tcp(text)


def _tcp(text: str) -> PortName:
    wanted = "give tcp://host:port, such as tcp://192.168.1.20:5000 or tcp://[fe80::1]:5000"
    try:
        parts = urlsplit(text)
        host, number = parts.hostname, parts.port
    except ValueError:
        raise UsageError(f"{text} has no host and number that can be read; {wanted}") from None
    if not host:
        raise UsageError(f"{text} has no host; {wanted}")
    if not number:  # none, or 0
        raise UsageError(f"{text} lacks the number of its TCP port; {wanted}")
    if parts.path or parts.query or parts.fragment or parts.username or parts.password:
        raise UsageError(f"{text} has more than a host and a number; {wanted}")
    return PortName(text, host, str(number))
