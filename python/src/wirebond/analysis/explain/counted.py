"""Computes the possible payload sizes from the counts in a payload. Read field by field, without the engine's
offsets."""

from __future__ import annotations

from dataclasses import dataclass, field

from wirebond.analysis.explain.numbers import raw_number
from wirebond.protocol.model import Message
from wirebond.protocol.model.layout import Bits, Characters, Group, List, Number, Step
from wirebond.protocol.payload_rules import MAX_COUNTS


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
    """Return the bound of a payload by its counts; None if no count bounds it, or one of them is missing."""
    walk = _Walk(payload)
    try:
        most = walk.read(message.layout, "")
    except IndexError:
        return None
    return CountedBound(most, walk.counts) if walk.counts else None


@dataclass
class _Walk:
    payload: bytes
    at: int | None = 0  # None: after something whose size no count gives
    used: int = 0  # counts
    counts: dict[str, int] = field(default_factory=dict)

    def read(self, steps: tuple[Step, ...], path: str) -> int:
        """Return the most bytes that these steps take."""
        most = 0
        numbers: dict[str, int] = {}
        for step in steps:
            one = step.field
            match step:
                case List() | Characters() if one.is_variable:
                    most += self._varying(step, numbers, path)
                case Group():
                    for index in range(one.count or 1):
                        most += self.read(step.steps, f"{path}{one.name}{'' if one.count is None else f'[{index}]'}.")
                case _:
                    most += one.min_wire_bytes
                    self._note(step, numbers)
        return most

    def _varying(self, step: List | Characters, numbers: dict[str, int], path: str) -> int:
        one, told = step.field, step.told
        is_even = not any(member.is_variable for member in one.fields)  # its elements have one size
        if not told or told[0].name not in numbers or not is_even:
            self.at = None
            return one.max_wire_bytes
        if self.used + len(told) > MAX_COUNTS:
            self.used = MAX_COUNTS
            self.at = None
            return one.max_wire_bytes
        self.used += len(told)
        name = told[0].name
        taken = numbers[name] * ((step.stride if isinstance(step, List) else 1) // told[0].per)
        self.counts[f"{path}{name}"] = numbers[name]
        if self.at is not None:
            self.at += taken
        return taken

    def _note(self, step: Step, numbers: dict[str, int]) -> None:
        if self.at is None:
            return
        one = step.field
        size = one.min_wire_bytes
        data = self.payload[self.at : self.at + size]
        self.at += size
        match step:
            case Number():
                counting = {one.name: raw_number(one, data)} if step.slot is not None else {}
            case Bits():
                shared = raw_number(one, data)
                runs = (member for member in step.members if member.slot is not None)
                counting = {f"{one.name}.{run.field.name}": run.bits_of(shared) for run in runs}
            case _:
                counting = {}
        if counting and len(data) < size:
            raise IndexError
        numbers |= counting
