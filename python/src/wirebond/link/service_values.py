"""Values for messages of services, whose further fields belong to the protocol's author."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from wirebond.protocol.model import Field, Message


def filled(message: Message, values: Mapping[str, Any]) -> dict[str, Any]:
    """Add to ``values``, for each further field without a default, the value nearest to zero."""
    return {
        **{f.name: _least(f) for f in message.fields if f.name not in values and _needs_a_value(f)},
        **values,
    }


def _needs_a_value(f: Field) -> bool:
    return f.value_type not in (None, str, bytes) and not f.is_count and f.default is None


def _least(f: Field) -> Any:
    if f.is_list:
        return []
    one = _element(f)
    return one if f.count is None else [one] * f.count


def _element(f: Field) -> Any:
    if f.fields:
        return {member.name: _least(member) for member in f.fields if _needs_a_value(member)}
    if f.value_type is bool:
        return False
    if f.enum:
        return f.enum[0][0]
    if f.flags:
        return []
    least = 0.0 if f.minimum is None else max(0.0, float(f.minimum))
    return least if f.maximum is None else min(least, float(f.maximum))
