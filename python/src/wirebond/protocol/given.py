"""Finds messages with the values of one in the file, such as the emergency stop."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from wirebond.protocol.meaning.field_values import has_default
from wirebond.protocol.model import F64, Field, GivenMessage, Protocol


def is_given(model: Protocol, given: GivenMessage, message: str, fields: Mapping[str, Any]) -> bool:
    """Check whether a received message has the values of ``given``, as far as the wire can carry them.

    Fields of the message that the file does not give do not count. Where it gives none at all, their defaults do: else
    any message of this name would be the one.
    """
    if message != given.message:
        return False
    described = model.message(message).fields
    try:
        return _has(described, fields, given.fields or _left_out(described))
    except (KeyError, TypeError, ValueError, OverflowError):  # no message: a program's values that no field can have
        return False


def is_emergency_stop(model: Protocol, message: str, fields: Mapping[str, Any]) -> bool:
    """Check whether it is one of the file's ``emergency_stop``."""
    return any(is_given(model, stop, message, fields) for stop in model.emergency_stop)


def _left_out(fields: tuple[Field, ...]) -> dict[str, Any]:
    """Return the default values of those fields that need no given value."""
    return {
        field.name: _default(field) for field in fields if field.has_value and not field.is_count and has_default(field)
    }


def _default(field: Field) -> Any:
    if field.default is not None:
        return field.default
    if field.fields:
        return {} if field.count is None else ({},) * field.count
    return b"" if field.value_type is bytes else ""


def _has(fields: tuple[Field, ...], received: Mapping[str, Any], given: Mapping[str, Any]) -> bool:
    known = {field.name: field for field in fields}
    return all(name in received and _equal(known[name], received[name], value) for name, value in given.items())


def _equal(field: Field, received: Any, given: Any) -> bool:
    if field.count is None and not field.is_list:
        return _element_equal(field, received, given)
    return len(received) == len(given) and all(
        _element_equal(field, one, wanted) for one, wanted in zip(received, given, strict=True)
    )


def _element_equal(field: Field, received: Any, given: Any) -> bool:
    if field.fields:
        return _has(field.fields, received, _left_out(field.fields) | given)
    if field.value_type is bytes:
        return bool(received == given.ljust(field.size, b"\0"))
    if field.flags:
        return _flag_bits(field, received) == _flag_bits(field, given)
    if field.is_integer:
        return field.wire_bits(received) == field.wire_bits(given)
    if field.is_float:
        is_rounded = field.float_format != F64 or field.is_scaled
        lost = 1 / field.float_format.steps
        return math.isclose(
            received, given, rel_tol=lost if is_rounded else 0.0, abs_tol=lost * abs(float(field.offset))
        )
    return bool(received == given)


def _flag_bits(field: Field, value: Any) -> int:
    """Return the bits of a number, or of a list of names and of numbers without a name."""
    if isinstance(value, int):
        return value
    bits = dict(field.flags)
    found = 0
    for one in value:
        found |= 1 << bits[one] if isinstance(one, str) else one
    return found
