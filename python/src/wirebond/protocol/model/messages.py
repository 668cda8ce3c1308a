"""Messages: their senders, their conditions, and how they are queued."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

from wirebond.protocol.model.fields import ByteOrder, End, Field
from wirebond.protocol.model.layout import Step, layout_of

_INDEX = re.compile(r"\[\d+\]")  # in the name of a column


class Queue(StrEnum):
    """How a message waits for the line at its sender."""

    NORMAL = "normal"
    URGENT = "urgent"  # before all that is not
    LATEST = "latest"  # only the newest one


class LogLevel(StrEnum):
    """The severity of a log line, in the order of the log service's numbers."""

    DEBUG = "debug"
    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


class MatchOf(StrEnum):
    """The values that distinguish a message's frames from those of others."""

    ID = "id"
    HEADER = "header"  # a header field, as bits on the wire
    PAYLOAD = "payload"  # a number at a place of the payload that is always the same
    SIZE = "size"  # payload bytes


@dataclass(frozen=True)
class PayloadPlace:
    """A number of the payload, at a place that is always the same: (number >> shift) & mask."""

    at: int
    bytes: int
    order: ByteOrder
    shift: int
    mask: int


@dataclass(frozen=True)
class Match:
    """Frames of a message have this: a number of ``width`` bits of which the bits of ``mask`` are in one of ``ranges``.

    ``width`` is 32 for an id, whatever the frame's id part holds.
    """

    of: MatchOf
    ranges: tuple[tuple[int, int], ...]  # rising and apart, both bounds included; of a magic as the file lists them
    width: int
    mask: int
    name: str = ""  # of the header field, or of the field of the payload
    place: PayloadPlace | None = None  # of a number of the payload

    def holds(self, value: int) -> bool:
        return any(low <= value & self.mask <= high for low, high in self.ranges)

    @property
    def whole(self) -> int:
        return (1 << self.width) - 1

    @property
    def is_one_value(self) -> bool:
        low, high = self.ranges[0]
        return len(self.ranges) == 1 and low == high and self.mask == self.whole

    @property
    def least(self) -> int:
        """The least number that has it, of magics the first: what is sent where no other is given. Bits that do not
        count are 0."""
        return self.ranges[0][0]


@dataclass(frozen=True)
class Message:
    """``id`` is the least one where ``match`` has several."""

    name: str
    id: int
    sender: End
    fields: tuple[Field, ...] = ()
    every: float | None = None  # seconds
    reply: str | None = None
    description: str = ""
    seed: int | None = None  # counted by the frame's seeded check, not sent
    queue: Queue = Queue.NORMAL
    log: str | None = None  # its text, with `{field}` for a value
    log_level: LogLevel = LogLevel.INFO
    has_id: bool = True  # False: `id` is 0, and of its sender's frames those without an id carry it
    match: tuple[Match, ...] = ()  # conditions of its frames other than one id, or several ids

    @property
    def ids(self) -> Match | None:
        """All its ids, where it has more than one."""
        return next((match for match in self.match if match.of == MatchOf.ID), None)

    @property
    def min_payload(self) -> int:
        return sum(f.min_wire_bytes for f in self.fields)

    @property
    def max_payload(self) -> int:
        return sum(f.max_wire_bytes for f in self.fields)

    @cached_property
    def layout(self) -> tuple[Step, ...]:
        """The payload, step by step."""
        return layout_of(self.fields)

    def field_at(self, column: str) -> Field | None:
        """Return the field of a column, such as `joints[3].position`; None: no field has its values."""
        fields, found = self.fields, None
        for name in _INDEX.sub("", column).split("."):
            found = next((field for field in fields if field.name == name), None)
            fields = () if found is None else found.fields
        return found

    def sent_by(self, end: End | None) -> bool:
        return end is None or end == End.BOTH or self.sender in (end, End.BOTH)
