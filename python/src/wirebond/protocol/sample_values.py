"""Plausible values for any message, inside the limits of its fields. Values only: no engine, no clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

from wirebond.protocol.matching import fitted_values
from wirebond.protocol.model import Field, Message

FEW = 3  # elements of lists, and bytes of texts, whose size may vary

# A value from -1 to 1 for the field of this number; None: at rest, which is zero where the field allows it.
Wave: TypeAlias = Callable[[int], float | None]


def at_rest(_phase: int) -> None:
    """Give every field its value at rest."""


def sample_values(message: Message, wave: Wave = at_rest, amounts: Mapping[str, int] | None = None) -> dict[str, Any]:
    """Make values for every field of a message, except those that count others and padding.

    :param wave: where each field is between its limits; it gets the number of the field.
    :param amounts: how many elements lists shall have, by name, up to their ``max``. Others have `FEW`.
    """
    return fitted_values(message, _struct(message.fields, 0, wave, amounts or {}))


def _struct(fields: tuple[Field, ...], phase: int, wave: Wave, asked: Mapping[str, int]) -> dict[str, Any]:
    counting = {f.counted_by for f in fields if f.counted_by}
    least = {c: min(f.max_count or f.max_size for f in fields if f.counted_by == c) for c in counting}
    sizes = {counter: min(most, FEW) for counter, most in least.items()}
    sizes |= {f.counted_by: min(asked[f.name], least[f.counted_by]) for f in fields if f.name in asked}
    return {
        f.name: _value(f, sizes.get(f.counted_by, FEW), phase + number, wave)
        for number, f in enumerate(fields)
        if f.has_value and not f.is_count
    }


def _value(described: Field, size: int, phase: int, wave: Wave) -> Any:
    """``size``: elements or bytes of a value whose size is counted or free."""
    if described.value_type is str:
        return described.without_ends("virtual"[: size if described.counted_by else described.room])
    if described.value_type is bytes:
        return bytes(size) if described.counted_by else b""
    if not described.is_list and described.count is None:
        return _element(described, phase, wave)
    count = described.count or min(size, described.max_count)
    return [_element(described, phase + element, wave) for element in range(count)]


def _element(described: Field, phase: int, wave: Wave) -> Any:
    if described.fields:
        return _struct(described.fields, phase, wave, {})
    at = wave(phase)
    if described.value_type is bool:
        return at is not None and at > 0
    if described.enum:
        return described.enum[0][0]
    return [] if described.flags else _number(described, at)


def _number(described: Field, wave: float | None) -> float | int:
    if described.is_float:
        low, high = -1.0, 1.0
    else:
        least, most = described.whole_limits
        ends = max(least, -100, -most), min(most, 100)  # wire units: a lively but modest value
        low, high = sorted(float(end * described.scale + described.offset) for end in ends)
    if described.minimum is not None and described.maximum is not None:
        low, high = described.minimum, described.maximum
    value = min(max(0.0, low), high) if wave is None else low + (high - low) * (0.5 + 0.45 * wave)
    whole = not described.is_float and not described.is_scaled
    return round(value) if whole else value
