"""Computes the places of a struct's members in bytes, and the fields that a message makes of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

from wirebond.generate.from_header.declarations import UNSURE, Enum, Member, Scalar, Struct

MAX_FIELDS = 512


@dataclass(frozen=True)
class Leaf:
    """A field. ``count``: its elements; None for a single value. ``rest``: it takes what is left of the payload.

    ``name`` is empty for padding. ``kind`` is its type in a protocol file, of a number without its width: `u`, `text`,
    `struct`; ``struct`` is what the last one holds.
    """

    name: str
    kind: str
    size: int
    count: int | None = None
    rest: bool = False
    enum: Enum | None = None
    struct: Struct | None = None
    line: int = 0
    notes: tuple[str, ...] = ()


@cache
def alignment(member_type: Scalar | Enum | Struct) -> int:
    if not isinstance(member_type, Struct):
        return member_type.size
    natural = max((alignment(member.type) for member in member_type.members), default=1)
    return min(natural, member_type.pack or natural)


@cache
def struct_size(struct: Struct) -> int:
    """Return ``sizeof``, without a flexible array at the end."""
    end = 0
    for _, start, size in _placed(struct):
        end = start + size
    return end + -end % alignment(struct)


@cache
def number_of_fields(struct: Struct) -> int:
    """Return the number of fields in the message; those of nested structs count each time."""
    return sum(number_of_fields(m.type) if isinstance(m.type, Struct) else 1 for m in struct.members)


def fields_of(struct: Struct) -> list[Leaf]:
    """Return the struct's bytes as fields, padding included."""
    leaves = []
    at = 0
    for member, start, size in _placed(struct):
        if start > at:
            leaves.append(_padding(start - at))
        at = start + size
        leaves.append(_leaf(member))
    end = struct_size(struct)
    return [*leaves, _padding(end - at)] if end > at else leaves


def _placed(struct: Struct) -> Iterator[tuple[Member, int, int]]:
    """Yield members with offset and size, in bytes."""
    at = 0
    for member in struct.members:
        align = min(alignment(member.type), struct.pack or 16)
        at += -at % align
        one = struct_size(member.type) if isinstance(member.type, Struct) else member.type.size
        size = one
        for count in member.counts:
            size *= count
        yield member, at, size
        at += size


def _padding(size: int) -> Leaf:
    return Leaf("", "padding", size)


def _leaf(member: Member) -> Leaf:
    of = member.type
    notes = []
    count: int | None = None
    if member.counts:
        count = 1
        for dimension in member.counts:
            count *= dimension
    if len(member.counts) > 1:
        notes.append(f"{' x '.join(map(str, member.counts))}, row by row")
    if isinstance(of, Struct):
        size = struct_size(of)
        return Leaf(member.name, "struct", size, count, struct=of, line=member.line, notes=tuple(notes))
    if isinstance(of, Enum):
        if of.size == 4:
            notes.append("an enum takes 4 bytes here; with -fshort-enums it takes fewer")
        kind = "i" if of.signed else "u"
        return Leaf(member.name, kind, of.size, count, enum=of, line=member.line, notes=tuple(notes))
    if of.word in UNSURE:
        notes.append(f"`{of.word}`: {UNSURE[of.word]}")
    kind = of.kind
    if kind == "text" and count is None:
        kind = "u"
    rest = member.counts == (0,)
    if rest and of.size == 1 and kind == "u":
        kind = "bytes"
    return Leaf(member.name, kind, of.size, count, rest, line=member.line, notes=tuple(notes))
