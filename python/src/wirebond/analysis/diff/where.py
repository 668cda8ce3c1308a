"""The place of the compared fields, and their direction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from wirebond.analysis.diff.change import Effect, Sides
from wirebond.protocol.model import Field

Tail = Callable[[Sides, str], Effect]  # the effect of payloads that differ in size at their end, for these fields
Fields = tuple[Field, ...]


@dataclass(frozen=True)
class Where:
    """The fields that are compared: their owner, their place in the file, and the directions in which they travel."""

    path: str
    place: tuple[str | int, ...]
    routes: tuple[Sides, ...]
    tail: Tail | None  # None: bytes follow them

    def at(self, name: str, *, is_last: bool, key: tuple[str | int, ...] = ()) -> Where:
        return Where(
            f"{self.path}.{name}", (*self.place, "fields", name, *key), self.routes, self.tail if is_last else None
        )

    def everywhere(self, sentence: str) -> list[Effect]:
        return [Effect(sides.flow, True, sentence) for sides in self.routes]
