"""Derives the values that generated code must return for a message's fields from those of the engine."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from tests.conformance.formats import Handed
from wirebond import Codec, Message, MessageError
from wirebond.generate.code.cpp_number import real_type
from wirebond.protocol.model import Field, OnRange

# What C++ does not validate: its bool and text take any byte, its flags any bit.
ONLY_IN_PYTHON = (" is not UTF-8", ", a bool is 0 or 1", " has unnamed bits set: ")
FLOAT_ERROR = 2.0**-22
FLOAT_STEP = 2.0**-149  # between neighbours near zero, where numbers have fewer digits (subnormal)
DOUBLE_STEP = 2.0**-1074
DOUBLE_ERROR = 2.0**-50


def violations_in_cpp(message: Message) -> list[str]:
    """The violations that the generated code sees as well."""
    return [text for text in message.violations if not any(mark in text for mark in ONLY_IN_PYTHON)]


def difference(codec: Codec, message: Message, handed: Handed) -> str:
    """Return how the generated code's values of this frame differ from the engine's; empty if they do not."""
    expected = violations_in_cpp(message)
    contradicts = any(mark in text for text in expected for mark in UNREADABLE)
    if handed.wrong_count != contradicts:
        return f"wrong_count is {handed.wrong_count}, the engine finds {expected}"
    if (handed.rejected or handed.clamped) != bool(expected):
        return f"rejected {handed.rejected}, clamped {handed.clamped}, the engine finds {expected}"
    if handed.rejected:
        return "" if handed.values is None else "rejected, and handed over"
    if handed.values is None:
        return "neither rejected nor handed over"
    fields = codec.model.message(message.name).fields
    found = iter(handed.values)
    is_whole = not message.violations
    try:
        for path, described, value in _leaves(fields, message.fields, ""):
            if described is not None and described.is_string:
                letters = _letters(described, found)
                is_whole = is_whole and letters == _padded(described, value)
                same = _engine_value(described, letters) == value
            else:
                letters = next(found)
                same = _is_same(described, value, letters)
                is_whole = is_whole and not _loses_digits(described, value)
            if not same:
                return f"{path} is {letters!r}, the engine has {value!r}"
    except StopIteration:
        return "there are fewer values than the engine has"
    if list(found):
        return "there are more values than the engine has"
    if not is_whole:
        return ""  # what no sender may send, a text with zeros in it, which ends there in Python, or lost digits
    try:
        again = codec.encode(message.name, message.fields)
    except MessageError:
        again = None
    return "" if again == handed.again else f"encodes again as {handed.again!r}, the engine as {again!r}"


def _loses_digits(field: Field | None, value: Any) -> bool:
    """Is it a scaled float so near zero that it has fewer digits than its wire number, or than it will have again?"""
    if field is None or not field.is_float or not field.is_scaled or not math.isfinite(value):
        return False
    least = 2.0 ** (-126 if field.size == 4 else -1022)  # the smallest float with all its digits
    return bool(0 < min(abs(value), abs(value / float(field.scale))) < least)


UNREADABLE = (" says ", " does not end with ", "-bit number in ")  # in sentences of what generated code cannot read


Leaf = tuple[str, Field | None, Any]  # path, field (None: a number of elements), value


def _leaves(fields: tuple[Field, ...], values: dict[str, Any], path: str) -> Iterator[Leaf]:
    """The values in the order of the struct's members; numbers of elements stand before what varies."""
    for field in fields:
        if not field.has_value or field.is_count:
            continue
        value, here = values[field.name], f"{path}.{field.name}"
        if field.is_string:
            yield here, field, value
        elif field.is_list or field.count is not None:
            if field.is_list:
                yield here, None, len(value)
            for index, one in enumerate(value):
                yield from _one(field, one, f"{here}[{index}]")
        else:
            yield from _one(field, value, here)


def _letters(field: Field, tokens: Iterator[str]) -> bytes:
    size = field.size or int(next(tokens).removeprefix("#"))
    return bytes(int(next(tokens)) for _ in range(size))


def _engine_value(field: Field, letters: bytes) -> str | bytes:
    if field.value_type is bytes:
        return letters
    return (letters.split(b"\0")[0] if field.size else letters).decode(errors="replace")


def _padded(field: Field, value: str | bytes) -> bytes:
    return (value.encode() if isinstance(value, str) else value).ljust(field.size, b"\0")


def _one(field: Field, value: Any, path: str) -> Iterator[Leaf]:
    if field.fields:
        yield from _leaves(field.fields, value, path)
    else:
        yield path, field, value


def _is_same(field: Field | None, value: Any, token: str) -> bool:
    if field is None:
        return int(token.removeprefix("#")) == value
    if field.value_type is bool:
        return token == str(int(bool(value)))
    if field.enum:
        return int(token) == dict(field.enum)[value]
    if field.flags:
        bits = dict(field.flags)
        return int(token) == sum(1 << bits[flag] if isinstance(flag, str) else flag for flag in value)
    if field.on_range == OnRange.CLAMP and field.minimum is not None and field.maximum is not None:
        value = min(max(value, field.minimum), field.maximum)
    if not field.is_float and not field.is_scaled:
        return int(token) == value
    error, step = (FLOAT_ERROR, FLOAT_STEP) if real_type(field) == "float" else (DOUBLE_ERROR, DOUBLE_STEP)
    size = max(abs(value), abs(float(field.offset)))
    found = float.fromhex(token)
    if found == 0 == value and math.copysign(1, found) != math.copysign(1, value):
        return False
    return math.isclose(found, value, rel_tol=0, abs_tol=error * size + step)
