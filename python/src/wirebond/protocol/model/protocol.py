"""A whole protocol: format, messages, line, deadlines, stop, services and examples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Union

from wirebond.protocol.model.fields import End
from wirebond.protocol.model.forms import parts_of_forms
from wirebond.protocol.model.frames import FrameFormat, HeaderDefault, PartKind, PayloadRule
from wirebond.protocol.model.messages import Message

PAUSE_MARGIN = 0.002  # seconds
MAX_LATENCY = 1.0  # seconds that a port may hold bytes back: longer is a fault of the device


class Recover(StrEnum):
    NEXT_MESSAGE = "next_message"
    EXPLICIT = "explicit"


class Start(StrEnum):
    """The state of a deadline with ``recover: explicit`` after a start of the MCU."""

    READY = "ready"  #: its message acts
    HELD = "held"  #: it has struck already: its message is held back until somebody recovers


class Mismatch(StrEnum):
    """The MCU's treatment of commands from a host with another protocol hash."""

    HOLD_BACK = "hold_back"
    ACT = "act"


class Parity(StrEnum):
    NONE = "none"
    EVEN = "even"
    ODD = "odd"


@dataclass(frozen=True)
class LinkSettings:
    baud: int = 115200
    data_bits: int = 8
    parity: Parity = Parity.NONE
    stop_bits: float = 1
    max_run: float = 0.001  # seconds of line that one run of frames takes at most, unless it is a single frame
    max_age: float | None = None  # seconds; frames that waited longer expire
    echo: bool = False  # an end receives its own bytes
    adapter_latency: float | None = None  # seconds that the host's port may hold bytes back; None: by its device
    on_mismatch: Mismatch = Mismatch.HOLD_BACK

    @property
    def bits_per_byte(self) -> float:
        """Start bit, data, parity and stop bits."""
        return 1 + self.data_bits + (self.parity != Parity.NONE) + self.stop_bits

    @property
    def max_run_bytes(self) -> int:
        return max(1, int(self.max_run * self.baud / self.bits_per_byte))


GivenScalar = float | int | bool | str | bytes
# An array is a tuple, a struct a mapping.
GivenValue = Union[GivenScalar, tuple["GivenValue", ...], Mapping[str, "GivenValue"]]  # noqa: UP007  (recursive)


def _plain(value: GivenValue) -> Any:
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return {name: _plain(item) for name, item in value.items()} if isinstance(value, Mapping) else value


@dataclass(frozen=True)
class GivenMessage:
    """A message of the host with the values that the file gives it: that of ``recover_by``, or one of
    ``emergency_stop``, which stops the robot and ends a lease."""

    message: str
    values: tuple[tuple[str, GivenValue], ...]
    header: tuple[tuple[str, HeaderDefault], ...] = ()  # of the frame, where it differs from the host's defaults

    @property
    def fields(self) -> dict[str, Any]:
        """The values with lists and dicts, as ``encode`` takes them."""
        return {name: _plain(value) for name, value in self.values}


@dataclass(frozen=True)
class Deadline:
    message: str
    at: End
    after: float  # seconds
    then: str
    recover: Recover
    recover_by: GivenMessage | None = None  # the host sends it to end an explicit one; None: not in the file
    start: Start = Start.READY


@dataclass(frozen=True)
class Example:
    """A worked example of the file: a message's values, and the frame that is said to carry them.

    Nothing here says that the two agree; ``wirebond check`` compares them. ``sender`` is one end, never both.
    """

    message: str
    sender: End
    values: tuple[tuple[str, GivenValue], ...]
    frame: bytes
    header: tuple[tuple[str, HeaderDefault], ...] = ()  # named header fields that differ from their defaults

    @property
    def fields(self) -> dict[str, Any]:
        """The values with lists and dicts, as ``encode`` takes them."""
        return {name: _plain(value) for name, value in self.values}


@dataclass(frozen=True)
class Service:
    """An optional built-in message mapped to messages of this protocol, by role (``request``, ``reply``, …)."""

    name: str
    messages: tuple[tuple[str, str], ...]

    def message(self, role: str) -> str | None:
        return dict(self.messages).get(role)


@dataclass(frozen=True)
class Protocol:
    name: str
    format: FrameFormat
    messages: tuple[Message, ...]
    link: LinkSettings = LinkSettings()
    deadlines: tuple[Deadline, ...] = ()
    emergency_stop: tuple[GivenMessage, ...] = ()  # sent and released together, in this order
    services: tuple[Service, ...] = ()
    examples: tuple[Example, ...] = ()
    idle: float | None = None  # seconds; None: the default rule
    fixed: End | None = None  # the end that exists already and cannot change; BOTH: a link that is only listened to
    description: str = ""
    path: str = field(default="", compare=False)
    text: str = field(default="", compare=False, repr=False)  # of the file

    def message(self, name: str) -> Message:
        """Return the message of this name; KeyError if there is none."""
        for message in self.messages:
            if message.name == name:
                return message
        raise KeyError(name)

    def service(self, name: str) -> Service | None:
        return next((s for s in self.services if s.name == name), None)

    def max_wire_bytes(self, payload: int | None = None, sender: End | None = None) -> int:
        """Return the wire bytes of the largest frame, of ``sender`` if that is given, or of one with ``payload`` bytes;
        delimiters and worst stuffing included.

        Of forms that exclude each other the largest counts.
        """
        rule = self.format.part(PartKind.PAYLOAD)
        if rule is not None and rule.payload == PayloadRule.FIXED:
            payload = rule.fixed_payload
        beside = max(form.bytes_beside_payload for form in parts_of_forms(self.format.parts, None))
        size = beside + (self.format.max_payload_from(sender) if payload is None else payload)
        size += self.format.overhead(size)
        delimiter = self.format.delimiter or b""
        return size + len(self.format.opening or delimiter) + len(delimiter)

    @property
    def pause_seconds(self) -> float:
        """If silence ends a frame: how long a sender keeps the line silent between two frames; else 0.

        More than the silence, so that a receiver that looks every millisecond sees it from its beginning to its end.
        """
        return self.idle_seconds + PAUSE_MARGIN if self.format.ends_by_silence else 0.0

    @property
    def idle_seconds(self) -> float:
        """Silence that ends an incomplete candidate: the file's, or the longer of 20 ms and two frames."""
        if self.idle is not None:
            return self.idle
        frame_time = self.max_wire_bytes() * self.link.bits_per_byte / self.link.baud
        return max(0.020, 2 * frame_time)
