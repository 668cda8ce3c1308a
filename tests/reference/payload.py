"""The slow decoder's look into a payload: field by field from its first byte, as the model lists them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from wirebond.protocol.model import BitOrder, ByteOrder, Field, FieldKind


class Broken(Exception):  # noqa: N818  (an outcome, not an error)
    """The payload cannot be this message's."""


class TooShort(Exception):  # noqa: N818  (an outcome, not an error)
    """A count does not lie within these bytes."""


def counted_size(fields: tuple[Field, ...], data: bytes, at: int = 0) -> int:
    """Where these fields end that begin at ``at``, as the counts among them tell.

    :raises TooShort: more bytes are needed to tell.
    :raises Broken: a count is greater than the message allows.
    """
    places: dict[str, tuple[int, Field]] = {}
    for field in fields:
        if field.counted_by:
            place, counting = places[field.counted_by]
            if len(data) < place + counting.size:
                raise TooShort
            number = int.from_bytes(data[place : place + counting.size], _order(counting))
            if number > (field.max_size if field.is_string else field.max_count):
                raise Broken
            at += number * (1 if field.is_string else field.element_min_bytes)
        elif field.kind == FieldKind.STRUCT:
            for _ in range(field.count or 1):
                at = counted_size(field.fields, data, at)
        else:
            places[field.name] = at, field
            at += field.min_wire_bytes
    return at


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

    def _take(self, size: int) -> bytes:
        piece = self.payload[self.at : self.at + size]
        self.at += size
        return piece.ljust(size, b"\0") if self.trims_zeros else piece

    def read(self, fields: tuple[Field, ...]) -> None:
        numbers: dict[str, int] = {}
        for field in fields:
            if field.is_list or (field.is_string and field.size == 0):
                if not field.counted_by:
                    return  # what reaches to the end is the last
                unit = 1 if field.is_string else field.element_min_bytes
                self.at += unit * numbers[field.counted_by]
            elif field.kind == FieldKind.STRUCT:
                for _ in range(field.count or 1):
                    self.read(field.fields)
            else:
                self._read_one(field, numbers)

    def _read_one(self, field: Field, numbers: dict[str, int]) -> None:
        size = field.min_wire_bytes
        piece = self._take(size)
        if field.kind == FieldKind.UNSIGNED:
            numbers[field.name] = int.from_bytes(piece, _order(field))
        if field.constant is not None and piece != field.constant.to_bytes(size, _order(field)):
            raise Broken
        mask = wanted = 0
        place = 0 if field.first == BitOrder.LOW else 8 * size
        for member in field.fields:  # bits
            place -= member.width if field.first == BitOrder.HIGH else 0
            if member.constant is not None:
                mask |= (1 << member.width) - 1 << place
                wanted |= member.constant << place
            place += member.width if field.first == BitOrder.LOW else 0
        for index in range(size if mask else 0):  # each byte that has such bits must be there
            bits = mask.to_bytes(size, _order(field))[index]
            if bits and (index >= len(piece) or piece[index] & bits != wanted.to_bytes(size, _order(field))[index]):
                raise Broken


def _order(field: Field) -> Literal["little", "big"]:
    return "big" if field.order == ByteOrder.BIG else "little"
