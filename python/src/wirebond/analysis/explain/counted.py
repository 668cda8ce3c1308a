"""How many bytes a payload may have, as the counts in it tell. Read field by field, without the engine's offsets."""

from __future__ import annotations

from dataclasses import dataclass, field

from wirebond.protocol.model import ByteOrder, Field, FieldKind, Message
from wirebond.protocol.payload_rules import MAX_COUNTS, bit_places


@dataclass(frozen=True)
class CountedBound:
    """``most`` payload bytes; ``counts`` are those that say so, by their paths."""

    most: int
    counts: dict[str, int]

    @property
    def text(self) -> str:
        """``at most 7 payload bytes with number 3``."""
        counts = " and ".join(f"{path} {number}" for path, number in self.counts.items())
        return f"at most {self.most} payload byte{'s' * (self.most != 1)} with {counts}"


def bound_by_counts(message: Message, payload: bytes) -> CountedBound | None:
    """None where no count bounds it, or one of them is not there."""
    walk = _Walk(payload)
    try:
        most = walk.read(message.fields, "")
    except IndexError:
        return None
    return CountedBound(most, walk.counts) if walk.counts else None


@dataclass
class _Walk:
    payload: bytes
    at: int | None = 0  # None: behind something whose size no count tells
    used: int = 0  # counts
    counts: dict[str, int] = field(default_factory=dict)

    def read(self, fields: tuple[Field, ...], path: str) -> int:
        """The most bytes that these fields take."""
        most = 0
        numbers: dict[str, int] = {}
        for one in fields:
            if one.is_list or (one.is_characters and one.size == 0):
                most += self._varying(one, numbers, path)
            elif one.kind == FieldKind.STRUCT:
                for index in range(one.count or 1):
                    most += self.read(one.fields, f"{path}{one.name}{'' if one.count is None else f'[{index}]'}.")
            else:
                most += one.min_wire_bytes
                self._note(one, numbers)
        return most

    def _varying(self, one: Field, numbers: dict[str, int], path: str) -> int:
        is_even = not any(member.is_variable for member in one.fields)  # its elements have one size
        if one.counted_by not in numbers or not is_even:
            self.at = None
            return one.max_wire_bytes
        if self.used + len(one.counters) > MAX_COUNTS:
            self.used = MAX_COUNTS
            self.at = None
            return one.max_wire_bytes
        self.used += len(one.counters)
        name, step = one.counters[0]
        taken = numbers[name] * ((1 if one.is_string else one.element_min_bytes) // step)
        self.counts[f"{path}{name}"] = numbers[name]
        if self.at is not None:
            self.at += taken
        return taken

    def _note(self, one: Field, numbers: dict[str, int]) -> None:
        if self.at is None:
            return
        size = one.min_wire_bytes
        data = self.payload[self.at : self.at + size]
        self.at += size
        is_number = one.is_unsigned and one.is_count
        if (is_number or any(member.is_count for member in one.fields)) and len(data) < size:
            raise IndexError
        number = int.from_bytes(data, "big" if one.order == ByteOrder.BIG else "little")
        if one.is_unsigned:
            numbers[one.name] = number
        for member, low in bit_places(one) if one.kind == FieldKind.BITS else ():
            numbers[f"{one.name}.{member.name}"] = number >> low & (1 << member.width) - 1
