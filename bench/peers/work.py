"""The work that is the same for all: which messages, which values, and what a codec must make of them."""

from __future__ import annotations

import random
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from tests.streams import random_values

import wirebond
from bench.collateral import PROTOCOL, SEED
from wirebond.protocol.model import Field, FieldKind, Message

CHUNK = 4096  # bytes at a time, for all that take their bytes in chunks
DIFFERENT = 500  # values of each message before they come again

MODEL = wirebond.load(PROTOCOL).model
MESSAGES: tuple[Message, ...] = MODEL.messages

Values = dict[str, Any]
Sample = tuple[Message, Values]
Flat = dict[str, list[tuple[Any, ...]]]  # message: a column for each element of each field, in the file's order


class Codec(Protocol):
    """One way to move the messages. A codec's result is looked at after the clock has stopped."""

    name: str
    package: str  # whose version counts
    licence: str

    def stream(self, samples: Iterable[Sample]) -> bytes:
        """The samples on the wire, one frame behind the other."""

    def columns(self, stream: bytes) -> Any:
        """Everything in the stream, with a sequence of values for each field (or element of an array)."""

    def flat(self, columns: Any) -> Flat:
        """Convert ``columns`` to one shape for all."""

    def messages(self, stream: bytes) -> int:
        """Every message for itself, every field of it read. How many messages that were."""


def samples(frames: int) -> list[Sample]:
    """``frames`` messages, the protocol's messages taking turns, with values that a float of 32 bits holds."""
    source = random.Random(SEED)
    drawn = [(m, random_values(m, source)) for _ in range(DIFFERENT) for m in MESSAGES]
    return [drawn[i % len(drawn)] for i in range(frames)]


def elements(values: Values) -> Iterable[Any]:
    """The values of a message, arrays taken apart."""
    for value in values.values():
        if isinstance(value, (list, tuple)):
            yield from value
        else:
            yield value


@dataclass(frozen=True)
class Element:
    """The layout of a field's element on the wire, in the words of Python's struct."""

    field: Field
    code: str
    count: int

    @property
    def shape(self) -> tuple[int, ...]:
        """Return the shape of the field's values, as numpy has it."""
        return () if self.field.count is None else (self.count,)


_CODES = {
    (FieldKind.FLOAT, 4): "f",
    (FieldKind.BOOL, 1): "?",
    (FieldKind.INTEGER, 1): "B",
    (FieldKind.INTEGER, 2): "H",
}


def layout(message: Message) -> Sequence[Element]:
    return [Element(f, _CODES[f.kind, f.size], f.count or 1) for f in message.fields]


def struct_format(message: Message) -> str:
    """A payload, as the protocol file lays it out."""
    return "<" + "".join(f"{element.count}{element.code}" for element in layout(message))
