"""Where a struct's members lie in bytes, and the flat fields that a message makes of them."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

from wirebond.c_header.declarations import UNSURE, Enum, Member, Scalar, Struct
from wirebond.protocol.model import FieldKind

MAX_FIELDS = 512


class TooMany(Exception):  # noqa: N818  (it ends one struct, and is told in the result)
    """The struct makes more fields than a message should have."""


@dataclass(frozen=True)
class Leaf:
    """One field. ``count``: its elements; None for a single value. ``rest``: it takes what is left of the payload.

    ``path`` is empty for padding.
    """

    path: tuple[str, ...]
    kind: FieldKind
    size: int
    count: int | None = None
    rest: bool = False
    enum: Enum | None = None
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
    """``sizeof``, without a flexible array at the end."""
    end = 0
    for _, start, size in _placed(struct):
        end = start + size
    return end + -end % alignment(struct)


def fields_of(struct: Struct) -> list[Leaf]:
    """The struct's bytes as fields, padding included. :raises TooMany: more than MAX_FIELDS."""
    leaves = list(itertools.islice(_leaves(struct, ()), MAX_FIELDS + 1))
    if len(leaves) > MAX_FIELDS:
        raise TooMany
    return leaves


def _placed(struct: Struct) -> Iterator[tuple[Member, int, int]]:
    """Members with offset and size, in bytes."""
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


def _leaves(struct: Struct, path: tuple[str, ...]) -> Iterator[Leaf]:
    at = 0
    for member, start, size in _placed(struct):
        if start > at:
            yield _padding(start - at)
        at = start + size
        here = (*path, member.name) if member.name else path
        if isinstance(member.type, Struct):
            if not member.counts:
                yield from _leaves(member.type, here)
                continue
            for index in itertools.product(*(range(count) for count in member.counts)):
                yield from _leaves(member.type, (*here, *map(str, index)))
        else:
            yield _leaf(member, member.type, here)
    end = struct_size(struct)
    if end > at:
        yield _padding(end - at)


def _padding(size: int) -> Leaf:
    return Leaf((), FieldKind.BYTES, size)


def _leaf(member: Member, of: Scalar | Enum, path: tuple[str, ...]) -> Leaf:
    notes = []
    count: int | None = None
    if member.counts:
        count = 1
        for dimension in member.counts:
            count *= dimension
    if len(member.counts) > 1:
        notes.append(f"{' x '.join(map(str, member.counts))}, row by row")
    if isinstance(of, Enum):
        if of.size == 4:
            notes.append("an enum takes 4 bytes here; with -fshort-enums it takes fewer")
        kind = FieldKind.SIGNED if of.signed else FieldKind.UNSIGNED
        return Leaf(path, kind, of.size, count, False, of, member.line, tuple(notes))
    if of.word in UNSURE:
        notes.append(f"`{of.word}`: {UNSURE[of.word]}")
    kind = of.kind
    if kind == FieldKind.TEXT and count is None:
        kind = FieldKind.UNSIGNED
    rest = member.counts == (0,)
    if rest and of.size == 1 and kind == FieldKind.UNSIGNED:
        kind = FieldKind.BYTES
    return Leaf(path, kind, of.size, count, rest, None, member.line, tuple(notes))
