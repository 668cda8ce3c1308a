"""Defines an oracle: another implementation of a format, which writes frames from numbers and reads them back."""

from __future__ import annotations

import random
import struct
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, ClassVar

from tests.streams import random_values
from wirebond.protocol.model import End, Field, Message

#: Numbers as they are on the wire, texts as bytes without padding, in the order of the message's fields.
Wire = list[Any]


@dataclass(frozen=True)
class Case:
    """One message to send: by name, with its numbers on the wire, and its frame's own fields."""

    message: str
    sender: End
    wire: Wire
    header: dict[str, Any] = field(default_factory=dict)


class Oracle(ABC):
    """Adapts one library. Knows nothing about how Wirebond reads or writes.

    :cvar lacks: messages of the file that it neither writes nor reads.
    """

    lacks: ClassVar[frozenset[str]] = frozenset()

    def values(self, message: Message, source: random.Random) -> dict[str, Any]:
        """Random values that the library can carry; the file's own rules are kept already."""
        return random_values(message, source)

    def header(self, message: Message, source: random.Random) -> dict[str, Any]:
        """Random values of the frame's own fields."""
        return {}

    def encode(self, case: Case) -> bytes | None:
        """The frame; None where the library does not write this message."""
        return None

    @abstractmethod
    def decode(self, frame: bytes, sender: End) -> Case | None:
        """Return the content of exactly these bytes; None if the library refuses them, or finds something shorter in
        them."""

    def reads(self, case: Case) -> bool:
        """Return whether the library can read this message at all."""
        return True


def to_wires(fields: tuple[Field, ...], values: dict[str, Any]) -> Wire:
    """The values of a message; what only counts others, or pads, has none."""
    return [to_wire(described, values[described.name]) for described in fields if described.name in values]


def from_wires(fields: tuple[Field, ...], wire: Wire) -> dict[str, Any]:
    """The inverse of ``to_wires``."""
    valued = [f for f in fields if f.has_value and not f.is_count]
    return {described.name: from_wire(described, one) for described, one in zip(valued, wire, strict=True)}


def to_wire(described: Field, value: Any) -> Any:
    """A value as it lies on the wire, worked out here and not by the engine; of a struct or of bits their list."""
    if isinstance(value, list) and (described.is_list or described.count is not None):
        return [to_wire(described, element) for element in value]
    if described.fields:
        return to_wires(described.fields, value)
    if described.value_type is str:
        return value.encode()
    if described.value_type is bytes:
        return value.ljust(described.size, b"\0")
    if described.enum:
        return dict(described.enum)[value]
    if described.flags:
        return sum(1 << bit for name, bit in described.flags if name in value)
    if described.is_float:
        return struct.unpack("<f", struct.pack("<f", value))[0] if described.size == 4 else value
    if described.is_scaled:
        return round((Fraction(value) - described.offset) / described.scale)
    return int(value)


def from_wire(described: Field, wire: Any) -> Any:
    """The value that a number on the wire stands for: the inverse of ``to_wire``."""
    if described.fields and not (wire and isinstance(wire[0], list)) and wire != []:
        return from_wires(described.fields, wire)
    if isinstance(wire, list):
        return [from_wire(described, element) for element in wire]
    if described.value_type is str:
        return wire.decode()
    if described.enum:
        return next(name for name, number in described.enum if number == wire)
    if described.flags:
        return [name for name, bit in described.flags if wire >> bit & 1]
    if described.is_scaled:
        return float(wire * described.scale + described.offset)
    return bool(wire) if described.value_type is bool else wire
