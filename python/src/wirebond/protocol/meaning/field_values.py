"""Checks whether a value in the file fits a field, and which values the field's wire type can carry."""

from __future__ import annotations

import re
from fractions import Fraction

from wirebond.protocol.decimals import decimal_text
from wirebond.protocol.model import Default, Field
from wirebond.protocol.problems import quoted, suggestion

_BYTE = re.compile(r"0x[0-9a-fA-F]{1,2}")

Given = Fraction | bool | str | list[Fraction | bool | str]  # a value as the file gives it
_Single = float | int | bool | str
_Fitted = tuple[Default | None, str]


def wire_limits(field: Field) -> tuple[Fraction, Fraction]:
    """Return the minimum and maximum number on the wire."""
    if field.is_integer:
        least, greatest = field.whole_limits
        return Fraction(least), Fraction(greatest)
    most = field.float_format.greatest
    return -most, most


def value_limits(field: Field) -> tuple[Fraction, Fraction]:
    """Return the minimum and maximum value in the field's unit that the wire can carry."""
    ends = sorted(bound * field.scale + field.offset for bound in wire_limits(field))
    return ends[0], ends[1]


def number_text(value: Fraction) -> str:
    whole = value.denominator == 1 and abs(value) < 10**15
    return str(value.numerator) if whole else decimal_text(float(value), 10)


def fit_value(field: Field, value: Given) -> _Fitted:
    """Return the value as the API takes it and an empty text, or None and what is wrong.

    An array takes a list, or where its number of elements is fixed one value for all of them; flags take a number or
    a list of names. Structs, groups and padding take none.
    """
    if field.value_type in (dict, None):
        return None, f"`{field.name}` has no value of its own; give those of its fields, or leave it out"
    if field.count is None and not field.is_list:
        return fit_element(field, value)
    if not isinstance(value, list) or (field.flags and all(isinstance(item, str) for item in value)):
        if field.count is None:
            return None, f"`{field.name}` has a varying number of elements; write a list, such as []"
        fitted, fault = fit_element(field, value)
        return (None, fault) if fault else ((fitted,) * field.count, "")  # type: ignore[return-value]
    most = field.count or field.max_count
    if len(value) > most or (field.count is not None and len(value) != most):
        wanted = f"it has {most}" if field.count is not None else f"it has at most {most}"
        return None, f"{len(value)} elements do not fit `{field.name}`; {wanted}"
    found: list[_Single] = []
    for item in value:
        one, fault = fit_element(field, item)
        if fault or not isinstance(one, float | int | str):
            return None, fault
        found.append(one)
    return tuple(found), ""


def fit_element(field: Field, value: Given) -> _Fitted:
    """Fit one element of an array, or a single value, as `fit_value`."""
    if isinstance(value, list):
        return _fit_flags(field, value)
    if field.value_type is bool:
        return (value, "") if isinstance(value, bool) else (None, f"`{field.name}` is a bool; write true or false")
    if field.value_type is str:
        if not isinstance(value, str):
            return None, f"`{field.name}` is a text; put the value in quotes"
        size, room = len(value.encode()), field.room
        if size > room:
            return None, f"the text has {size} bytes, and `{field.name}` has room for {room}; shorten it"
        return (None, _too_early(field)) if _has_end(field, value.encode()) else (value, "")
    if field.value_type is bytes:
        return _fit_bytes(field, value)
    if isinstance(value, str):
        names = dict(field.enum)
        if value in names:
            return value, ""
        if names:
            return None, f"{quoted(value)} is not a name of `{field.name}`; {suggestion(value, names)}"
    if isinstance(value, (bool, str)):
        shown = str(value).lower() if isinstance(value, bool) else value
        return None, f"{quoted(shown)} is not a number; `{field.name}` takes a number"
    return _fit_number(field, value)


def _fit_bytes(field: Field, value: Fraction | bool | str) -> _Fitted:
    tokens = value.split() if isinstance(value, str) else [""]
    if not all(_BYTE.fullmatch(token) for token in tokens):
        return None, f"`{field.name}` is a byte string; write its bytes as 0xAA 0x55"
    return fit_bytes(field, bytes(int(token, 16) for token in tokens))


def fit_bytes(field: Field, value: bytes) -> tuple[bytes | None, str]:
    """Fit the bytes of a byte string, as `fit_value`."""
    if len(value) > field.room:
        return (
            None,
            f"these are {len(value)} bytes, and `{field.name}` has room for {field.room}; write no more",
        )
    return (None, _too_early(field)) if _has_end(field, value) else (value, "")


def _has_end(field: Field, value: bytes) -> bool:
    return field.ends_with is not None and field.ends_with in value


def _too_early(field: Field) -> str:
    return f"`{field.name}` would end at its first 0x{field.ends_with:02X}; leave that byte out"


def _fit_flags(field: Field, value: list[Fraction | bool | str]) -> _Fitted:
    if not field.flags:
        return None, f"`{field.name}` is one value; write it without [ and ]"
    bits = dict(field.flags)
    unknown = [item for item in value if item not in bits]
    if unknown:
        shown = unknown[0] if isinstance(unknown[0], str) else str(unknown[0]).lower()
        return None, f"{quoted(shown)} is not a flag of `{field.name}`; {suggestion(shown, bits)}"
    return sum(1 << bits[str(item)] for item in dict.fromkeys(value)), ""


def _fit_number(field: Field, value: Fraction) -> tuple[float | int | None, str]:
    lowest, highest = value_limits(field)
    if field.minimum is not None and field.maximum is not None:
        lowest, highest = max(lowest, Fraction(field.minimum)), min(highest, Fraction(field.maximum))
        # The bounds were decimals: a value that equals one as a double is inside.
        value = min(max(value, lowest), highest) if float(value) in (field.minimum, field.maximum) else value
    if not lowest <= value <= highest:
        limits = f"from {number_text(lowest)} to {number_text(highest)}"
        return (
            None,
            f"{number_text(value)} does not fit `{field.name}`, which takes values {limits}; choose one in that range",
        )
    if field.is_integer and not field.is_scaled:
        if value.denominator != 1:
            return (
                None,
                f"{number_text(value)} is not a whole number, and `{field.name}` takes whole numbers; add a `scale`?",
            )
        if field.enum and int(value) not in dict(field.enum).values():
            return (
                None,
                f"{value} has no name in `{field.name}`; write one of {', '.join(name for name, _ in field.enum)}",
            )
        unnamed = int(value) & ~sum(1 << bit for _, bit in field.flags)
        if field.flags and unnamed:
            return (
                None,
                f"bit {unnamed.bit_length() - 1} of {value} has no name in `{field.name}`; name it, or leave it 0",
            )
        return int(value), ""
    return float(value), ""


def has_default(field: Field) -> bool:
    """Return whether the field has a value if none is given."""
    if field.fields and not field.is_list:
        return all(has_default(member) for member in field.fields)
    return field.default is not None or field.is_count or not field.has_value


def settled(fields: tuple[Field, ...]) -> set[str]:
    """Return the names of fields that may be left out, of these that are side by side."""
    return {field.name for field in fields if has_default(field)}
