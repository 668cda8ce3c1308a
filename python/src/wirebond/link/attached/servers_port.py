"""The port of a server: attaches to it, and leaves control, requests and services to it."""

from __future__ import annotations

import contextlib

from wirebond.codec import Codec
from wirebond.errors import PortError, UsageError
from wirebond.link.attached.address import ServerAddress
from wirebond.link.attached.attached_link import AttachedLink
from wirebond.link.attached.attached_recordings import ServerRecordings
from wirebond.link.attached.attached_requests import AttachedRequests
from wirebond.link.attached.attached_services import AttachedServices
from wirebond.link.attached.words import Control
from wirebond.link.devices.names import resolve
from wirebond.link.inbox import Inbox
from wirebond.link.services import AskingLink
from wirebond.protocol.loader import loads
from wirebond.protocol.model import End


class ServersPort:
    """See `Owner`.

    :param waits: a server that is not there yet is not an error.
    :raises PortError: there is no server.
    """

    is_attached = True
    adapter_latency = 0.0  # the server has added it

    def __init__(self, codec: Codec, end: End, address: ServerAddress, waits: bool) -> None:
        self._codec = codec
        self._end = end
        self.port = address.text
        self.engine = AttachedLink(codec, end, address, waits)
        welcome = self.engine.welcome
        self.baud = codec.model.link.baud if welcome is None else welcome.baud

    def begin_services(self, link: AskingLink, inbox: Inbox, hello: bool, clock_sync: bool) -> AttachedServices:  # noqa: ARG002 the server does both
        """See `Owner`."""
        inbox.requests = AttachedRequests(self._codec, self._end, self.engine)
        return AttachedServices(self._codec, self.engine, inbox, self.port)

    def control(self) -> Control:
        """See `Owner`."""
        return self.engine.control()

    def take_control(self, over: bool | str) -> None:
        """See `Owner`."""
        self.engine.take_control(over)

    def release_control(self) -> None:
        """See `Owner`."""
        self.engine.release_control()

    def release_stop(self, over: bool | str) -> None:
        """See `Owner`."""
        self.engine.release_stop(over)

    def device(self) -> str:
        """See `Owner`."""
        welcome = self.engine.welcome
        if welcome is None:
            return self.port
        if self.engine.is_on_this_computer:
            with contextlib.suppress(PortError, UsageError):
                return resolve(welcome.port)
        return welcome.port

    def other_protocols(self) -> list[Codec]:
        """See `Owner`."""
        welcome = self.engine.welcome
        return [] if welcome is None else [Codec(loads(text)) for text in welcome.other_protocols]

    def recordings(self) -> ServerRecordings:
        """See `Owner`."""
        return ServerRecordings(self.engine)

    def end(self) -> None:
        """Do nothing: the server keeps its port."""
