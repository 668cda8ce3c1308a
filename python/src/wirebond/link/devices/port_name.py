"""The meaning of a port's name: the path of a tty, a USB device, or a server on the network. Opens nothing."""

from __future__ import annotations

import os
import re
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from wirebond.errors import PortError, UsageError
from wirebond.link.devices.names import resolve

ADAPTER_LATENCY = 0.016  # seconds that a USB adapter may hold bytes back (FTDI's default); a serial server does as well
MAX_BAUD = 100_000_000


@dataclass(frozen=True)
class PortName:
    """``text``: as its user wrote it. A tty has neither ``host`` nor ``service``."""

    text: str
    host: str = ""
    service: str = ""  #: the TCP port's number
    is_rfc2217: bool = False  #: the server also sets baud rate, parity and stop bits
    recording: str = ""  #: path of a recording that is replayed
    speed: float = 1.0  #: of a replay; 0: as fast as possible
    start: float = 0.0  #: of a replay: seconds since the start of the recording
    stop: float | None = None  #: the same; None: its end
    loop: bool = False  #: of a replay: again and again

    @property
    def is_tcp(self) -> bool:
        """A server of either kind."""
        return bool(self.host)

    @property
    def address(self) -> str:
        """``host:port`` of a server."""
        return f"[{self.host}]:{self.service}" if ":" in self.host else f"{self.host}:{self.service}"

    @property
    def moves(self) -> bool:
        """May its path be another one each time that it is plugged in?"""
        return self.text.startswith("usb:")

    def path(self) -> str:
        """Return the current path of the tty.

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
            f"the port's name {text!r} has a byte that a port cannot have in its name; give a tty such as /dev/ttyUSB0"
        )
    if text.startswith("usb:"):
        with suppress(PortError):  # it is not there now; opening it will say so
            resolve(text)
        return PortName(text)
    if text.startswith("replay:"):
        return _replay(text)
    scheme, found, address = text.partition("://")
    if not found or "/" in scheme:
        _refuse_foreign(text)
        return PortName(text)
    if scheme.lower() == "udp":
        raise UsageError(
            f"{text}: Wirebond needs a stream of bytes, and UDP loses packets and changes their order; give "
            f"tcp://{address or 'host:port'} if the device has it, or a pty from `socat pty,raw,echo=0,link=robot "
            f"udp:{address or 'host:port'}`"
        )
    if scheme.lower() not in _SERVERS:
        raise UsageError(
            f"{text} is not a port that can be opened; give a tty such as /dev/ttyUSB0, a USB device such as "
            "usb:1a86:55d3, tcp://host:port or rfc2217://host:port"
        )
    return _server(text, scheme.lower())


_SERVERS = ("tcp", "rfc2217")


def is_com_port(text: str) -> bool:
    """Return whether this is a name such as ``COM3``, on Windows.

    :param text: a name, or a path.
    """
    return sys.platform == "win32" and _COM.fullmatch(text) is not None


_COM = re.compile(r"com[0-9]+:?", re.IGNORECASE)
_FOREIGN = {
    _COM: "is a port of Windows, and this is another system; on Linux a USB adapter is /dev/ttyUSB0 or /dev/ttyACM0, "
    "and `wirebond ports` lists them; on macOS it is /dev/cu.usbserial-… or /dev/cu.usbmodem…",
    re.compile(
        r"sim(ulat(or|ion))?", re.IGNORECASE
    ): "is not a port; `sim:`, with a colon, is a simulated device at the other end",
    re.compile(r"(v|vx|sl)?can[0-9]+", re.IGNORECASE): "is an interface of CAN, and Wirebond needs a serial port, such "
    "as /dev/ttyUSB0; `wirebond ports` lists them",
}


def _refuse_foreign(text: str) -> None:
    """Refuse a name that means no serial port on this system.

    :raises UsageError: the name is of such a kind, and no file but at most a folder has it.
    """
    for pattern, what in _FOREIGN.items():
        if not is_com_port(text) and pattern.fullmatch(text) and (Path(text).is_dir() or not os.path.lexists(text)):
            raise UsageError(f"{text} {what}")


_SECTION = "speed=2, from=12.5, to=20 and loop=1, joined by &"


def _replay(text: str) -> PortName:
    path, _, options = text.removeprefix("replay:").partition("?")
    if not path:
        raise UsageError(f"{text} names no recording; give replay:run.mcap, or replay:run.mcap?speed=2")
    values: dict[str, float] = {}
    for option in options.split("&") if options else ():
        name, _, value = option.partition("=")
        if name not in ("speed", "from", "to", "loop"):
            raise UsageError(f"{text} has an option {name!r} that a replay does not know; it knows {_SECTION}")
        try:
            values[name] = replay_number(name, value)
        except ValueError:
            raise UsageError(f"{text} has {name}={value}, which is not a number; such as {_SECTION}") from None
    return PortName(
        text,
        recording=path,
        speed=values.get("speed", 1.0),
        start=values.get("from", 0.0),
        stop=values.get("to"),
        loop=bool(values.get("loop", 0)),
    )


def replay_number(name: str, text: str) -> float:
    """Return a speed, with ``max`` for as fast as possible, or seconds, with or without ``s``.

    :raises ValueError: it is none.
    """
    if name == "speed":
        return 0.0 if text == "max" else float(text.removesuffix("x"))
    return float(text.removesuffix("s"))


def _server(text: str, scheme: str) -> PortName:
    wanted = f"give {scheme}://host:port, such as {scheme}://192.168.1.20:5000 or {scheme}://[fe80::1]:5000"
    try:
        parts = urlsplit(text)
        host, number = parts.hostname, parts.port
    except ValueError:
        raise UsageError(f"{text} has no valid host and number; {wanted}") from None
    if not host:
        raise UsageError(f"{text} has no host; {wanted}")
    if not number:  # none, or 0
        raise UsageError(f"{text} has no TCP port number; {wanted}")
    if parts.path or parts.query or parts.fragment or parts.username or parts.password:
        raise UsageError(f"{text} has more than a host and a number; {wanted}")
    return PortName(text, host, str(number), scheme == "rfc2217")
