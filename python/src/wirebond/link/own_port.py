"""The port of this program: opens it, with a virtual MCU for ``sim:``, and makes the services of its link."""

from __future__ import annotations

import contextlib
import errno
import logging
import weakref
from typing import Any

from wirebond.codec import Codec
from wirebond.errors import PortError, UsageError
from wirebond.link.attached.attached_recordings import ServerRecordings
from wirebond.link.attached.words import Control
from wirebond.link.common_port import CommonPort
from wirebond.link.devices.names import resolve
from wirebond.link.devices.permission import no_permission
from wirebond.link.devices.port_name import PortName, port_name
from wirebond.link.devices.processes import named, other_users
from wirebond.link.inbox import Inbox
from wirebond.link.plugins import plugin
from wirebond.link.services import AskingLink, Services
from wirebond.link.settings import engine_settings, latency_of, open_engine
from wirebond.protocol.model import End

SIMULATED = "sim:"  # the port's name of a virtual MCU
_log = logging.getLogger("wirebond.port")  # which commands print


class OwnPort:
    """See `Owner`.

    :param waits: a port that cannot be opened is not an error.
    :raises PortError: the port cannot be opened.
    :raises UsageError: the port has a name that cannot be.
    """

    is_attached = False

    def __init__(
        self,
        codec: Codec,
        end: End,
        port: str | CommonPort,
        baud: int,
        *,
        paced: bool,
        hold_back: bool,
        adapter_latency: float | None,
        waits: bool,
    ) -> None:
        self._codec = codec
        self.baud = baud
        self._end = end
        self._simulated: Any = None
        self._common = common = port if isinstance(port, CommonPort) else None
        text = port.name if isinstance(port, CommonPort) else port
        if text == SIMULATED:
            if end == End.MCU:
                raise UsageError("sim: is a virtual MCU, and role 'mcu' is one as well; open it as the host")
            self._simulated = plugin("sim")(codec)
            weakref.finalize(self, self._simulated.close).atexit = False  # at the end of the program `end` does it
            name = PortName(self._simulated.path)
        elif text.startswith(SIMULATED):
            sentence = (
                f"there is no simulator {text}; write {SIMULATED} alone, and it simulates the protocol file's MCU"
            )
            raise UsageError(sentence)
        else:
            name = port_name(text)
        self.port = SIMULATED if self._simulated is not None else name.text
        self.adapter_latency = latency_of(codec, name, baud, adapter_latency)
        self._is_replay = bool(name.recording)
        settings = engine_settings(codec, baud, paced, hold_back, self.adapter_latency, end)
        try:
            self.engine = open_engine(codec, end, name, settings, waits, common)
        except PortError as error:
            if error.errno != errno.EACCES:
                raise
            raise PortError(no_permission(name.path()), error.errno, name.text) from None
        self._warn_of_other_users()

    def _warn_of_other_users(self) -> None:
        """Warn of programs that had the tty open before: they keep it."""
        device = self.device()
        users = other_users(device) if device.startswith("/dev/") else []
        if users:
            _log.warning(
                "%s is open in another program as well, %s, and each byte that it reads is lost to this link; end it, "
                "or let all programs attach to `wirebond serve`",
                device,
                named(users),
            )

    def begin_services(self, link: AskingLink, inbox: Inbox, hello: bool, clock_sync: bool) -> Services:
        """See `Owner`."""
        syncs = clock_sync and self._end == End.HOST and not self._is_replay
        return Services(link, self._codec, self._end, self.engine, inbox, says_hello=hello, syncs_clock=syncs)

    def control(self) -> Control:
        """See `Owner`."""
        return Control("this program", True)

    def take_control(self, over: bool | str) -> None:
        """Do nothing: this program is always in control."""

    def release_control(self) -> None:
        """See `Owner`."""
        self.engine.end_motion()

    def release_stop(self, over: bool | str) -> None:  # noqa: ARG002 nobody else can have stopped the robot
        """See `Owner`."""
        self.engine.release_stop()

    def device(self) -> str:
        """See `Owner`."""
        with contextlib.suppress(PortError, UsageError):
            return resolve(self.port)
        return self.port

    def other_protocols(self) -> list[Codec]:
        """See `Owner`."""
        return [] if self._common is None else [c for c in self._common.codecs if c.hash != self._codec.hash]

    def recordings(self) -> ServerRecordings:
        """Refuse: only a server has recordings.

        :raises UsageError: there is no server.
        """
        raise UsageError("this link has a port of its own, and no server; record(path) records it")

    def end(self) -> None:
        """See `Owner`."""
        if self._simulated is not None:
            self._simulated.close()
