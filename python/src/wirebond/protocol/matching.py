"""Identifies the message of a frame if an id is not enough: whether the frames of two messages can be the same."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

from wirebond.protocol.model import ByteOrder, Field, Match, MatchOf, Message, PayloadPlace, Subject
from wirebond.protocol.model.forms import Choice, complement, some_value

ID_BITS = 32
_Key = tuple[MatchOf, str, PayloadPlace | None]


@dataclass(frozen=True)
class Shared:
    """A number with which what two messages match holds for both."""

    match: Match
    value: int


def id_key(message: Message) -> int | None:
    """Return what identifies a message among others of its sender without ``match``: its id, or that it has none."""
    return message.id if message.has_id else None


def told_by(message: Message) -> tuple[Match, ...]:
    """Return all conditions of its frames, its one id included."""
    if not message.has_id or message.ids is not None:
        return message.match
    return one_id(message.id), *message.match


def one_id(value: int) -> Match:
    return Match(MatchOf.ID, ((value, value),), ID_BITS, (1 << ID_BITS) - 1)


def overlap(one: Message, other: Message) -> tuple[Shared, ...] | None:
    """Return numbers of a frame that can be either message; None if no frame can."""
    if one.has_id != other.has_id:
        return None
    if not one.match and not other.match:
        return (Shared(one_id(one.id), one.id),) * one.has_id if one.id == other.id else None
    mine, theirs = _by_key(one), _by_key(other)
    shared = []
    for key, match in (mine | theirs).items():
        both = tuple(_choice(side[key]) for side in (mine, theirs) if key in side)
        value = some_value(both, match.width)
        if value is None:
            return None
        shared.append(Shared(match, value))
    return tuple(shared)


def covers(read: Message, sent: Message) -> bool:
    """Check whether, to a receiver, every frame sent as one message is the other one."""
    if read.has_id != sent.has_id:
        return False
    theirs = _by_key(sent)
    size = Match(MatchOf.SIZE, ((sent.min_payload, sent.max_payload),), 16, 0xFFFF, "size")
    theirs.setdefault((MatchOf.SIZE, "size", None), size)
    return all(key in theirs and _is_within(theirs[key], match) for key, match in _by_key(read).items())


def _is_within(inner: Match, outer: Match) -> bool:
    others = replace(_choice(outer), allowed=complement(tuple(sorted(outer.ranges)), outer.mask))
    return not others.allowed or some_value((_choice(inner), others), max(inner.width, outer.width)) is None


def are_matched(messages: Iterable[Message]) -> bool:
    """Return whether any of them needs more than its id."""
    return any(message.match for message in messages)


@dataclass(frozen=True)
class Told:
    """The facts in a frame that identify its message: the id, or None; the numbers of its header, as bits.

    ``payload`` is empty if only the bytes before it are asked for.
    """

    id: int | None
    header: dict[str, int]
    size: int
    payload: bytes
    trims_zeros: bool = False

    def is_of(self, message: Message) -> bool:
        if message.has_id != (self.id is not None):
            return False
        return all((number := self.number_of(match)) is not None and match.holds(number) for match in told_by(message))

    def number_of(self, match: Match) -> int | None:
        """Return the frame's value for this match, or None if it has none."""
        if match.of == MatchOf.PAYLOAD:
            place = match.place
            assert place is not None
            found = self.payload[place.at : place.at + place.bytes]
            if len(found) < place.bytes and not self.trims_zeros:
                return None
            number = int.from_bytes(
                found.ljust(place.bytes, b"\0"), "big" if place.order == ByteOrder.BIG else "little"
            )
            return number >> place.shift & place.mask
        if match.of == MatchOf.HEADER:
            return self.header.get(match.name)
        return self.id if match.of == MatchOf.ID else self.size


def fitted_values(message: Message, values: dict[str, Any], pick: Callable[[int, int], int] = min) -> dict[str, Any]:
    """Make values for all fields that meet the message's conditions. ``pick`` chooses from a range."""
    fitted = values
    for match in message.match:
        if match.of == MatchOf.PAYLOAD:
            fitted = _with_number(message.fields, fitted, match, match.name, pick)
        elif match.of == MatchOf.SIZE:
            fitted = _with_size(message.fields, fitted, match, pick)
    return fitted


def _with_number(
    fields: tuple[Field, ...], values: dict[str, Any], match: Match, path: str, pick: Callable[[int, int], int]
) -> dict[str, Any]:
    fitted = dict(values)
    name, _, rest = path.partition(".")
    for one in fields:
        if one.name != name or name not in values:  # that is a constant
            continue
        if rest:
            fitted[name] = _with_number(one.fields, values[name], match, rest, pick)
        else:
            number = pick(*match.ranges[pick(0, len(match.ranges) - 1)])
            fitted[one.name] = {value: name for name, value in one.enum}.get(number, number)
    return fitted


def _with_size(
    fields: tuple[Field, ...], values: dict[str, Any], match: Match, pick: Callable[[int, int], int]
) -> dict[str, Any]:
    """Change the number of bytes or letters in the one field that varies freely."""
    free = [one for one in fields if one.is_string and one.size == 0 and not one.counted_by]
    if not free:
        return values
    one = free[-1]
    value: str | bytes = values[one.name]
    length = len(value.encode() if isinstance(value, str) else value)
    beside = payload_size(fields, values) - length
    sizes = [size for size in range(beside, beside + one.max_size + 1) if match.holds(size)]
    if match.holds(beside + length) or not sizes:
        return values
    wanted = sizes[pick(0, len(sizes) - 1)] - beside
    return {**values, one.name: "a" * wanted if isinstance(value, str) else bytes(value[:wanted]).ljust(wanted, b"a")}


def payload_size(fields: tuple[Field, ...], values: dict[str, Any]) -> int:
    """Return the bytes of these values, if only strings and lists of numbers vary in size."""
    total = 0
    for one in fields:
        value = values.get(one.name)
        if one.digits is not None:
            total += one.size or len(one.digits.text(one.wire_number(values[one.name]))) + (one.ends_with is not None)
        elif one.is_string and one.size == 0:
            data = value.encode() if isinstance(value, str) else value
            total += len(data or b"") + (one.ends_with is not None)
        else:
            total += len(value or ()) * one.element_min_bytes if one.is_list else one.min_wire_bytes
    return total


def _by_key(message: Message) -> dict[_Key, Match]:
    """Group by the compared number. A number of the payload is the same wherever its place is, whatever its name."""
    return {(match.of, "" if match.place is not None else match.name, match.place): match for match in told_by(message)}


def _choice(match: Match) -> Choice:
    return Choice(Subject.FIELD, match.name, match.mask, match.ranges)
