"""The field rules of a received message, as an MCU applies them: which refuse it, and what is brought to a bound."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from wirebond.codec import Codec
from wirebond.protocol.model import Field, OnRange


def refusing(codec: Codec) -> Codec:
    """Return the same protocol without the ranges that only clamp. Each violation of its messages refuses the
    message."""
    messages = tuple(replace(m, fields=_without_clamps(m.fields)) for m in codec.model.messages)
    return codec if messages == codec.model.messages else Codec(replace(codec.model, messages=messages))


def _without_clamps(fields: tuple[Field, ...]) -> tuple[Field, ...]:
    return tuple(_without_clamp(replace(f, fields=_without_clamps(f.fields))) for f in fields)


def _without_clamp(field: Field) -> Field:
    return field if _clamp_bounds(field) is None else replace(field, minimum=None, maximum=None)


def clamped(fields: tuple[Field, ...], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return these values, with each one that its field clamps moved to the nearest bound."""
    found = {f.name: f for f in fields}
    return {name: _clamped(found[name], value) for name, value in values.items()}


def _clamped(field: Field, value: Any) -> Any:
    if isinstance(value, list) and (field.is_list or field.count is not None):
        return [_clamped(field, element) for element in value]
    if field.fields:
        return clamped(field.fields, value)
    bounds = _clamp_bounds(field)
    if bounds is None:
        return value
    low, high = (math.ceil(bounds[0]), math.floor(bounds[1])) if isinstance(value, int) else bounds
    return min(max(value, low), high)


def _clamp_bounds(field: Field) -> tuple[float, float] | None:
    if field.on_range != OnRange.CLAMP or field.minimum is None or field.maximum is None:
        return None
    return field.minimum, field.maximum
