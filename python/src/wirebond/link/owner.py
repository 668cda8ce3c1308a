"""The seam between a `Link` and the owner of its port: this program, or a server that it is attached to."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from wirebond.codec import Codec, Message
from wirebond.link.attached.words import Control
from wirebond.link.clock_line import ClockLine, HostTime
from wirebond.link.clock_sync import ClockReading
from wirebond.link.engine import Engine
from wirebond.link.inbox import Inbox
from wirebond.link.peer import Peer

if TYPE_CHECKING:
    from wirebond.link.attached.attached_recordings import ServerRecordings
    from wirebond.link.services import AskingLink


class LinkServices(Protocol):
    """The services of one link. Any thread may ask."""

    @property
    def peer(self) -> Peer:
        """Return what is known of the other end."""

    @property
    def clock(self) -> ClockReading | None:
        """Return what is known of the MCU's clock."""

    @property
    def clock_line(self) -> ClockLine | None:
        """Return the line that times of the MCU's clock are computed from; None: it is not known here."""

    def host_time(self, mcu_us: int, near: float, /) -> HostTime:
        """Convert a time of the MCU. See ``Link.host_time``."""

    def note_exchange(self, sent: float, reply: Message, /) -> None:
        """Use an exchange of the clock that the program made itself."""

    def end(self) -> None:
        """End with the link."""


class Owner(Protocol):
    """The difference between a port of this program and one of a server. Any thread may call any method.

    :ivar port: the name to show.
    :ivar baud: bits per second of the line.
    :ivar adapter_latency: seconds that the port may hold received bytes back.
    :ivar is_attached: a server owns the port.
    """

    port: str
    baud: int
    adapter_latency: float
    is_attached: bool

    @property
    def engine(self) -> Engine:
        """Return the engine that moves the frames."""

    def begin_services(self, link: AskingLink, inbox: Inbox, hello: bool, clock_sync: bool) -> LinkServices:
        """Begin the services of this link. Called once, after its inbox was made."""

    def control(self) -> Control:
        """Return who is in control."""

    def take_control(self, over: bool | str) -> None:
        """See ``Link.take_control``."""

    def release_control(self) -> None:
        """See ``Link.release_control``."""

    def release_stop(self, over: bool | str) -> None:
        """See ``Link.release_stop``."""

    def device(self) -> str:
        """Return the port at the end of the line, such as the tty of a stable name."""

    def other_protocols(self) -> list[Codec]:
        """See ``Link.other_protocols``."""

    def recordings(self) -> ServerRecordings:
        """See ``Link.recordings``."""

    def end(self) -> None:
        """End what was started for the port, after the engine was closed."""
