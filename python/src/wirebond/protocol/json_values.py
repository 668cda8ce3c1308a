"""Values of a message that came as JSON, in which byte strings are hexadecimal digits."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from wirebond.protocol.model import Field


def from_json_values(fields: tuple[Field, ...], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values as ``encode`` takes them.

    :raises ValueError: bytes are not hexadecimal digits.
    """
    known = {field.name: field for field in fields}
    return {name: _value(known.get(name), value) for name, value in values.items()}


def _value(field: Field | None, value: Any) -> Any:
    if field is None:
        return value
    if field.value_type is bytes and isinstance(value, str):
        try:
            return bytes.fromhex(value)
        except ValueError:
            raise ValueError(f"{field.name} is {value!r:.40}; expected bytes as hexadecimal digits") from None
    if isinstance(value, dict):
        return from_json_values(field.fields, value)
    return [_value(field, one) for one in value] if isinstance(value, list) else value
