"""The layout of a payload: what is read and written, step by step. Each message is lowered once, from its fields.

Everything that moves bytes walks these steps: the engine, generated code, `explain`, the document. `docs/DESIGN.md` has
a picture.

``at`` is a place in bytes, from the start of a list of steps, as if everything of varying size before it had its least
size. Who walks adds what those steps take beyond that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TypeAlias

from wirebond.protocol.model.fields import BitOrder, Field, FieldKind


@dataclass(frozen=True)
class Told:
    """A number among earlier steps that counts elements or bytes of a step.

    :ivar name: of its field; `state.number` of one among the bits of `state`.
    :ivar slot: its index in the list of steps' counts.
    :ivar per: what it counts for each element or byte.
    """

    name: str
    slot: int
    per: int


@dataclass(frozen=True)
class _Step:
    """:ivar field: what its bytes mean."""

    field: Field
    at: int

    @property
    def parts(self) -> tuple[Step | BitMember, ...]:
        """The steps, or the values among its bits, that it consists of; empty for a single value."""
        return ()


@dataclass(frozen=True)
class Padding(_Step):
    """Zeros that a receiver ignores."""


@dataclass(frozen=True)
class Constant(_Step):
    """Bytes that are always the same."""

    wire: bytes


@dataclass(frozen=True)
class Number(_Step):
    """A number or bool, in whole bytes.

    :ivar slot: see `Told`; None: it counts nothing.
    """

    slot: int | None


@dataclass(frozen=True)
class Array(_Step):
    """A fixed number of numbers or bools: in whole bytes each, or packed bit by bit."""


@dataclass(frozen=True)
class BitMember:
    """One value among bits, padding and constants included.

    :ivar low: the place of its lowest bit, or of that of its own piece.
    :ivar pieces: place and width of each piece, its lowest bits first.
    :ivar slot: as of `Number`.
    """

    field: Field
    low: int
    pieces: tuple[tuple[int, int], ...]
    slot: int | None

    @property
    def parts(self) -> tuple[Step | BitMember, ...]:
        return ()

    @property
    def text(self) -> str:
        """``bit 3``, ``bits 0 to 6``, or ``bits 40 to 43 and 8 to 31`` with the value's highest first."""
        if self.field.width == 1:
            return f"bit {self.low}"
        spans = (f"{at} to {at + size - 1}" if size > 1 else str(at) for at, size in reversed(self.pieces))
        return f"bits {' and '.join(spans)}"

    def bits_of(self, number: int) -> int:
        """Return its bits of the number that is shared."""
        found = done = 0
        for place, size in self.pieces:
            found |= (number >> place & (1 << size) - 1) << done
            done += size
        return found


@dataclass(frozen=True)
class Bits(_Step):
    """A number whose bits are shared."""

    members: tuple[BitMember, ...]

    @property
    def parts(self) -> tuple[Step | BitMember, ...]:
        return self.members


@dataclass(frozen=True)
class Characters(_Step):
    """A text, a byte string, or a number in characters: of a fixed size, or up to a size.

    :ivar told: what tells how many bytes it has. Empty, if its size varies: it goes up to the byte that ends it, or to
        the payload's end.
    """

    told: tuple[Told, ...]


@dataclass(frozen=True)
class Group(_Step):
    """Other steps, once or a fixed number of times.

    :ivar stride: least bytes of one time.
    """

    steps: tuple[Step, ...]
    stride: int

    @property
    def parts(self) -> tuple[Step | BitMember, ...]:
        return self.steps


@dataclass(frozen=True)
class List(_Step):
    """A varying number of elements: of numbers or bools, or of ``steps``.

    :ivar stride: least bytes of one element.
    :ivar told: the counts of its elements; empty: as many as the payload has.
    """

    steps: tuple[Step, ...]
    stride: int
    told: tuple[Told, ...]

    @property
    def parts(self) -> tuple[Step | BitMember, ...]:
        return self.steps


Step: TypeAlias = Padding | Constant | Number | Array | Bits | Characters | Group | List


def layout_of(fields: tuple[Field, ...]) -> tuple[Step, ...]:
    """Return the steps of fields that follow each other."""
    lowering = _Lowering(fields)
    return tuple(lowering.step(one) for one in fields)


def members_of(container: Field, slots: Mapping[str, int] = MappingProxyType({})) -> tuple[BitMember, ...]:
    """Return the values that share a number's bits.

    :param slots: of numbers that count: see `Told`.
    """
    members = []
    passed = 0
    for one in container.fields:
        low = passed if container.first == BitOrder.LOW else container.width - passed - one.bits_here
        passed += one.bits_here
        slot = slots.get(f"{container.name}.{one.name}")
        members.append(BitMember(one, low, one.split or ((low, one.width),), slot))
    return tuple(members)


@dataclass
class _Lowering:
    fields: tuple[Field, ...]
    at: int = 0
    slots: dict[str, int] = field(init=False)

    def __post_init__(self) -> None:
        names = (name for one in self.fields for name, _ in one.counters)
        self.slots = {name: slot for slot, name in enumerate(dict.fromkeys(names))}

    def step(self, one: Field) -> Step:
        at = self.at
        self.at += one.min_wire_bytes
        if one.kind == FieldKind.PADDING:
            return Padding(one, at) if one.constant is None else Constant(one, at, one.constant_bytes)
        if one.kind == FieldKind.BITS:
            return Bits(one, at, members_of(one, self.slots))
        if one.is_characters:
            return Characters(one, at, self._told(one))
        if one.is_list:
            return List(one, at, layout_of(one.fields), one.element_min_bytes, self._told(one))
        if one.kind == FieldKind.STRUCT:
            return Group(one, at, layout_of(one.fields), one.element_min_bytes)
        if one.count is not None:
            return Array(one, at)
        return Number(one, at, self.slots.get(one.name))

    def _told(self, one: Field) -> tuple[Told, ...]:
        return tuple(Told(name, self.slots[name], per) for name, per in one.counters)
