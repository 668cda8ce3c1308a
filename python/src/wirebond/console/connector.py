"""Connects the console to a port, and disconnects it: one link goes, another comes. Any thread."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wirebond import paths
from wirebond.codec import Codec, load
from wirebond.console.jobs.protocol_files import EDITED
from wirebond.console.station import Station
from wirebond.errors import UsageError
from wirebond.link import open_link
from wirebond.link.attached.address import make_socket_folder, socket_of
from wirebond.link.devices.port_name import port_name
from wirebond.link.raw import raw_codec
from wirebond.protocol import loads
from wirebond.protocol.model import LinkSettings
from wirebond.recording.capture import is_capture
from wirebond.recording.recording import Recording
from wirebond.server import Server
from wirebond.sim.port import NAME as SIMULATED

ROVER = "sim:rover"
SIMULATORS = (
    (ROVER, "the rover's own firmware, as a process (diffdrive)"),
    (SIMULATED, "a simulated MCU of the chosen protocol"),
)


class HeldError(UsageError):
    """Somebody is in control of what would be taken away."""


@dataclass(frozen=True)
class Options:
    """The options for links that the page opens.

    :ivar name: of the server; None: the protocol's.
    :ivar recordings: the folder for recordings.
    :ivar may_save: the protocol file that the page may write; None: none.
    :ivar may_connect: False: the console shows the link of a program, and no other.
    """

    name: str | None = None
    recordings: Path | None = None
    listen: str = "own"
    may_connect: bool = False
    may_save: Path | None = None


class Connector:
    """:param station: whose link is replaced."""

    def __init__(self, station: Station, options: Options) -> None:
        self._station = station
        self.options = options
        self._lock = threading.Lock()

    def connect(self, port: str, baud: int | None, protocol: str | None, text: str | None, *, over: bool) -> None:
        """Open the port, and show its link. A port that is not there is waited for.

        :param protocol: the path of one of the files that can be chosen; None and no ``text``: raw bytes, or the
            protocol of the recording that is replayed.
        :param over: also if a program is in control of the present link.
        :raises HeldError: a program is in control.
        :raises WirebondError: the protocol or the port cannot be used; the present link continues, unless its port is
            this one.
        """
        self._must_be_allowed()
        port = port.strip()
        if not port:
            raise UsageError("there is no port; choose one, or a simulator")
        codec = self._codec(port, baud, protocol, text)
        with self._lock:
            self._must_be_free(over)
            self._station.connecting = {"port": port, "why": "it is being opened"}
            try:
                self._replace(port, baud, codec)
            finally:
                self._station.connecting = None

    def disconnect(self, *, over: bool) -> None:
        """Close the present link.

        :raises HeldError: a program is in control.
        """
        self._must_be_allowed()
        with self._lock:
            self._must_be_free(over)
            self._station.clear()

    def choices(self) -> list[Path]:
        """Return the protocol files that can be chosen: the one that the console was started with, those of this
        folder, and those that come with the package."""
        here = [Path.cwd(), Path.cwd() / "protocols"]
        found = [path for folder in here if folder.is_dir() for path in sorted(folder.glob("*.yaml"))]
        own = [] if self.options.may_save is None else [self.options.may_save]
        offered = [*own, *found, *paths.protocol_files()]
        return list(dict.fromkeys(path.resolve() for path in offered if path.is_file()))

    # ---- inside

    def _must_be_allowed(self) -> None:
        if not self.options.may_connect:
            raise UsageError("this console shows the link of one program, and connects to nothing else")

    def _must_be_free(self, over: bool) -> None:
        served = self._station.served
        holder = None if served is None else served.server.holder
        if holder is not None and not over:
            raise HeldError(f"{holder} is in control of the robot; wait until it releases it, or take over")

    def _codec(self, port: str, baud: int | None, protocol: str | None, text: str | None) -> Codec:
        if text is not None:
            return Codec(loads(text, EDITED))
        if protocol is not None:
            known = {os.fspath(path): path for path in self.choices()}
            if protocol not in known:
                raise UsageError(f"{protocol!r:.100} is not among the protocol files that can be chosen")
            return load(known[protocol])
        if port == ROVER:
            from wirebond.sim import rover  # noqa: PLC0415 it needs the generator

            return load(rover.protocol_file())
        if name := port_name(port).recording:
            if is_capture(Path(name)):
                raise UsageError(f"{name} is a raw capture, which has no protocol in it; choose one")
            return Recording(name).codec
        if port == SIMULATED:
            raise UsageError("a simulated MCU needs a protocol; choose one")
        return raw_codec(LinkSettings(baud=baud or LinkSettings().baud))

    def _replace(self, port: str, baud: int | None, codec: Codec) -> None:
        options = self.options
        make_socket_folder()
        self._station.clear()
        with ExitStack() as stack:
            if port == ROVER:
                from wirebond.sim import rover  # noqa: PLC0415

                port = stack.enter_context(rover.RoverProcess(rover.build())).port
            link = stack.enter_context(
                open_link(codec, port, baud, listen=options.listen, wait_for_port=port != SIMULATED)
            )
            where = socket_of(options.name or codec.name)
            server = stack.enter_context(Server(link, where, recordings=options.recordings))
            close: Callable[[], Any] = stack.pop_all().close
        self._station.put(link, server, close)
