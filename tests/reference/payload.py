"""The slow decoder's look into a payload: field by field from its first byte, as the model lists them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from wirebond.protocol.model import BitOrder, ByteOrder, Field, FieldKind

MOST_COUNTS = 8  # of one message


class Broken(Exception):  # noqa: N818  (an outcome, not an error)
    """The payload cannot be this message's."""


class TooShort(Exception):  # noqa: N818  (an outcome, not an error)
    """A count does not lie within these bytes."""


def counted_size(fields: tuple[Field, ...], data: bytes, at: int = 0) -> int:
    """Where these fields end that begin at ``at``, as the counts among them tell.

    :raises TooShort: more bytes are needed to tell.
    :raises Broken: a count is greater than the message allows, tells bytes that are no number of elements, or disagrees
        with another.
    """
    places: dict[str, tuple[int, Field]] = {}
    for field in fields:
        if field.counted_by:
            at += _told_bytes(field, places, data)
        elif field.kind == FieldKind.STRUCT:
            for _ in range(field.count or 1):
                at = counted_size(field.fields, data, at)
        else:
            places[field.name] = at, field
            at += field.min_wire_bytes
    return at


def most_bytes(fields: tuple[Field, ...], payload: bytes) -> int:
    """The most bytes that a payload with these counts may have. One whose counts are not all there may have any."""
    try:
        return _Bound(payload).of(fields)
    except TooShort:
        return 1 << 16


@dataclass
class _Bound:
    payload: bytes
    at: int = 0
    knows_place: bool = True
    counts: int = 0

    def of(self, fields: tuple[Field, ...]) -> int:
        places: dict[str, tuple[int, Field]] = {}
        total = 0
        for field in fields:
            varies = field.is_list or (field.is_characters and field.size == 0)
            if field.kind == FieldKind.STRUCT and not varies:
                total += sum(self.of(field.fields) for _ in range(field.count or 1))
                continue
            size = self._taken(field, places) if varies else field.min_wire_bytes
            if not varies and self.knows_place:
                places[field.name] = self.at, field
            self.at += size
            total += size
        return total

    def _taken(self, field: Field, places: dict[str, tuple[int, Field]]) -> int:
        self.counts += 2 if field.bytes_counted_by else 1
        is_known = field.counted_by.partition(".")[0] in places and self.counts <= MOST_COUNTS
        if not is_known or any(member.is_variable for member in field.fields):
            self.knows_place = False
            return field.max_wire_bytes
        unit = 1 if field.is_string or field.counted_in_bytes else field.element_min_bytes
        return _told(field.counted_by, places, self.payload) * unit


def _told(name: str, places: dict[str, tuple[int, Field]], data: bytes) -> int:
    """The number that counts: a field, or one among the bits of a field."""
    outer, _, run = name.partition(".")
    at, counting = places[outer]
    if len(data) < at + counting.size:
        raise TooShort
    number = int.from_bytes(data[at : at + counting.size], _order(counting))
    for member, place in _places(counting) if run else ():
        if member.name == run:
            return number >> place & _ones(member)
    return number


def _told_bytes(field: Field, places: dict[str, tuple[int, Field]], data: bytes) -> int:
    """The bytes that a field takes. Each of its counts is judged as soon as it is there."""
    size = 1 if field.is_string else field.element_min_bytes
    taken = _told(field.counted_by, places, data) * (1 if field.counted_in_bytes else size)
    if taken > field.max_wire_bytes or taken % size:
        raise Broken
    if field.bytes_counted_by and _told(field.bytes_counted_by, places, data) != taken:
        raise Broken
    return taken


def _places(container: Field) -> Iterator[tuple[Field, int]]:
    """The values that share bits, each with the place of its lowest bit."""
    used = 0
    for member in container.fields:
        used += member.bits_here
        yield member, used - member.bits_here if container.first == BitOrder.LOW else 8 * container.size - used


def _ones(member: Field) -> int:
    return (1 << member.bits_here) - 1


def constants_hold(fields: tuple[Field, ...], payload: bytes, trims_zeros: bool) -> bool:
    """Are the constants among these fields what they must be? Zeros that were trimmed are put back."""
    try:
        _Reader(payload, trims_zeros).read(fields)
    except Broken:
        return False
    return True


@dataclass
class _Reader:
    payload: bytes
    trims_zeros: bool
    at: int = 0
    is_lost: bool = False  # behind bytes that are no number of elements: no constant has its place there

    def _take(self, size: int) -> bytes:
        piece = self.payload[self.at : self.at + size]
        self.at += size
        return piece.ljust(size, b"\0") if self.trims_zeros else piece

    def read(self, fields: tuple[Field, ...]) -> None:
        numbers: dict[str, int] = {}
        for field in fields:
            if field.is_list or (field.is_characters and field.size == 0):
                if not field.counted_by:
                    return  # what reaches to the end is the last
                unit = 1 if field.is_string or field.counted_in_bytes else field.element_min_bytes
                number = numbers[field.counted_by]
                if field.counted_in_bytes and number <= field.max_wire_bytes and number % field.element_min_bytes:
                    self.is_lost = True
                self.at += unit * number
            elif field.kind == FieldKind.STRUCT:
                for _ in range(field.count or 1):
                    self.read(field.fields)
            else:
                self._read_one(field, numbers)

    def _read_one(self, field: Field, numbers: dict[str, int]) -> None:
        size = field.min_wire_bytes
        piece = self._take(size)
        if field.is_unsigned:
            numbers[field.name] = int.from_bytes(piece, _order(field))
        if self.is_lost and any(one.constant is not None for one in (field, *field.fields)):
            raise Broken
        if field.constant is not None and piece != field.constant.to_bytes(size, _order(field)):
            raise Broken
        for member, place in _places(field) if field.kind == FieldKind.BITS else ():
            numbers[f"{field.name}.{member.name}"] = int.from_bytes(piece, _order(field)) >> place & _ones(member)
        mask = wanted = 0
        place = 0 if field.first == BitOrder.LOW else 8 * size
        for member in field.fields:  # bits
            place -= member.bits_here if field.first == BitOrder.HIGH else 0
            if member.constant is not None:
                mask |= (1 << member.width) - 1 << place
                wanted |= member.constant << place
            place += member.bits_here if field.first == BitOrder.LOW else 0
        for index in range(size if mask else 0):  # each byte that has such bits must be there
            bits = mask.to_bytes(size, _order(field))[index]
            if bits and (index >= len(piece) or piece[index] & bits != wanted.to_bytes(size, _order(field))[index]):
                raise Broken


def _order(field: Field) -> Literal["little", "big"]:
    return "big" if field.order == ByteOrder.BIG else "little"
