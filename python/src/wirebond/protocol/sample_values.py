"""Values made up for any message, inside the limits of its fields: one walk, and what it asks of who makes them up.

Values only: no engine, no clock.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Protocol, TypeAlias

from wirebond.protocol.matching import fitted_values
from wirebond.protocol.meaning.field_values import value_limits
from wirebond.protocol.model import Field, Message

FEW = 3  # elements of lists, and bytes of texts, whose size may vary

# A value from -1 to 1 for the field of this number; None: at rest, which is zero where the field allows it.
Wave: TypeAlias = Callable[[int], float | None]


class Chooser(Protocol):
    """Makes up the single values. ``place``: the number of the field, and of the element, so that values may differ."""

    def size(self, fields: Sequence[Field], most: int) -> int:
        """Return how many elements or bytes, at most ``most``, each of these fields has: one number counts them, or it
        is one list without a count."""

    def string(self, field: Field, size: int | None) -> str | bytes:
        """Return a text or bytes. ``size``: of a counted one."""

    def element(self, field: Field, place: int) -> Any:
        """Return a number, a bool, or names of ``enum`` or ``flags``."""


def values_by(choose: Chooser, fields: tuple[Field, ...], place: int = 0) -> dict[str, Any]:
    """Make values for all fields except padding and counts of others, which are counted."""
    counting = dict.fromkeys(field.counted_by for field in fields if field.counted_by)
    sizes: dict[str, int] = {}
    for name in counting:
        counted = [field for field in fields if field.counted_by == name]
        sizes[name] = choose.size(counted, min(field.max_count or field.max_size for field in counted))
    return {
        field.name: _value(choose, field, sizes.get(field.counted_by), place + number)
        for number, field in enumerate(fields)
        if field.has_value and not field.is_count
    }


def _value(choose: Chooser, field: Field, size: int | None, place: int) -> Any:
    if field.is_string:
        return choose.string(field, size)
    if field.is_list and size is None:
        size = choose.size((field,), field.max_count)
    if field.is_list or field.count is not None:
        return [_element(choose, field, place + element) for element in range(field.count or size or 0)]
    return _element(choose, field, place)


def _element(choose: Chooser, field: Field, place: int) -> Any:
    return values_by(choose, field.fields, place) if field.fields else choose.element(field, place)


def at_rest(_place: int) -> None:
    """Give every field its value at rest."""


def sample_values(message: Message, wave: Wave = at_rest, amounts: Mapping[str, int] | None = None) -> dict[str, Any]:
    """Make plausible values for every field of a message, except those that count others and padding.

    :param wave: where each field is between its limits; it gets the number of the field.
    :param amounts: how many elements a request asked for, by the lists' names. Other lists have `FEW`.
    """
    return fitted_values(message, values_by(_Plausible(wave, amounts or {}), message.fields))


@dataclass(frozen=True)
class _Plausible:
    wave: Wave
    asked: Mapping[str, int]

    def size(self, fields: Sequence[Field], most: int) -> int:
        return min(next((self.asked[f.name] for f in fields if f.asked_by and f.name in self.asked), FEW), most)

    def string(self, field: Field, size: int | None) -> str | bytes:
        if field.value_type is bytes:
            return bytes(size or 0)
        return field.without_ends("virtual"[: field.room if size is None else size])

    def element(self, field: Field, place: int) -> Any:
        at = self.wave(place)
        if field.value_type is bool:
            return at is not None and at > 0
        if field.enum:
            return field.enum[0][0]
        return [] if field.flags else _number(field, at)


def _number(described: Field, wave: float | None) -> float | int:
    if described.is_float:
        bounds = value_limits(described)  # narrow ones where it is scaled
        low, high = float(max(bounds[0], Fraction(-1))), float(min(bounds[1], Fraction(1)))
    else:
        least, most = described.whole_limits
        ends = max(least, -100, -most), min(most, 100)  # wire units: a lively but modest value
        low, high = sorted(float(end * described.scale + described.offset) for end in ends)
    if described.minimum is not None and described.maximum is not None:
        low, high = described.minimum, described.maximum
    value = min(max(0.0, low), high) if wave is None else low + (high - low) * (0.5 + 0.45 * wave)
    whole = not described.is_float and not described.is_scaled
    return round(value) if whole else value
