"""The forms that a frame of a protocol can have, with what every candidate asks about them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Generic, Literal, TypeVar

from wirebond.analysis.explain.layout import CONSTANTS, fixed_bits, id_index, payload_index, spans
from wirebond.protocol.model import ByteOrder, End, FrameFormat, Part, PartKind, PayloadRule, Protocol
from wirebond.protocol.model.forms import FormParts, parts_of_forms
from wirebond.protocol.planning import matches_late

T = TypeVar("T")


class Heard(Generic[T]):
    """A part of a protocol and the sender that is listened to, as a key that compares by identity: protocols are long
    to compare."""

    __slots__ = ("of", "sender")

    def __init__(self, of: T, sender: End | None) -> None:
        self.of, self.sender = of, sender

    def __hash__(self) -> int:
        return hash((id(self.of), self.sender))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Heard) and other.of is self.of and other.sender == self.sender


@lru_cache(maxsize=256)
def _forms(key: Heard[FrameFormat]) -> list[FormParts]:
    return parts_of_forms(key.of.parts, key.sender)


def forms(protocol: Protocol, sender: End | None) -> list[FormParts]:
    """Return the forms that a frame can have, by magic and by the header's bits; most formats have one."""
    return _forms(Heard(protocol.format, sender))


@dataclass(frozen=True)
class Shape:
    """The facts about a form that are the same for every candidate."""

    form: FormParts
    payload_at: int  # its place among the parts
    id_at: int | None
    before: list[tuple[int, int]]  # where each part before the payload begins and ends
    prefix: int  # bytes before the payload
    outside: int  # bytes beside the payload
    tells_late: bool  # the message is identified by bytes of the payload or after it
    tells_id_early: bool  # before the payload's size is needed
    constants: list[tuple[bytes, bytes] | None]  # of each part: its bytes, in the bits of these masks
    header_checks: list[int]
    checks: list[int]


def _shape(protocol: Protocol, form: FormParts, sender: End | None) -> Shape:
    parts = form.parts
    at, id_at = payload_index(parts), id_index(parts)
    before = spans(parts[:at], 0)
    sent = tuple(message for message in protocol.messages if message.sent_by(sender))
    is_late = matches_late(sent, protocol.format.parts)
    # Without an id the one message there is says how long a payload is that has its message's size.
    is_early = id_at < at if id_at is not None else parts[at].payload == PayloadRule.BY_ID
    checks = [index for index, part in enumerate(parts) if part.kind == PartKind.CHECK]
    of_header = [index for index in checks if index < at and parts[index].last_covered < at]
    return Shape(
        form,
        at,
        id_at,
        before,
        before[-1][1] if before else 0,
        sum(part.size for part in parts),
        is_late,
        is_early and not is_late,
        [_constant_of(part, form) for part in parts],
        of_header,
        [index for index in checks if index not in of_header],
    )


def _constant_of(part: Part, form: FormParts) -> tuple[bytes, bytes] | None:
    if part.kind in CONSTANTS:
        return part.value, b"\xff" * part.size
    mask, value = fixed_bits(part, form.choices)
    order: Literal["big", "little"] = "big" if part.order == ByteOrder.BIG else "little"
    return (value.to_bytes(part.size, order), mask.to_bytes(part.size, order)) if mask else None


def shapes_of(protocol: Protocol, sender: End | None) -> list[Shape]:
    return _shapes(Heard(protocol, sender))


@lru_cache(maxsize=256)
def _shapes(key: Heard[Protocol]) -> list[Shape]:
    return [_shape(key.of, form, key.sender) for form in forms(key.of, key.sender)]
