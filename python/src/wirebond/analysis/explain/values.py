"""Payload bytes as field values, each with its unit, how it came out, and the field rules that it breaks."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

from wirebond.analysis.explain.constants import constant_text
from wirebond.analysis.explain.numbers import ReadNumber, number_of, packed_number, raw_number, whole_number, with_unit
from wirebond.protocol.model import Digits, Field, FieldKind, Message
from wirebond.protocol.payload_rules import bit_places, bits_of, bits_text
from wirebond.protocol.spelling import field_type
from wirebond.visible import visible


@dataclass(frozen=True)
class Reading:
    """One field of a payload, or one element of a field that repeats its fields. ``value`` is what the Python API
    gives. ``data`` is empty for a value among the bits of a number: the number around it has the bytes."""

    field: Field
    name: str
    offset: int  # in the payload
    data: bytes
    value: Any
    text: str
    faults: tuple[str, ...] = ()  # of this one, not of its parts
    parts: tuple[Reading, ...] = ()


def read_fields(message: Message, payload: bytes) -> list[Reading]:
    """The fields that the payload holds whole, in wire order; those behind a payload that is too short are left out.

    Padding has a reading, and no value.
    """
    found: list[Reading] = []
    walk = _Walk(payload, max(0, len(payload) - message.min_payload))
    with suppress(_CutOff):  # what is there is named; the rest is not all there
        walk.read_all(message.fields, found)
    return found


def values_of(readings: Iterable[Reading]) -> dict[str, Any]:
    """By name, as the Python API gives them."""
    return {reading.name: reading.value for reading in readings if reading.field.has_value}


def faults_of(readings: Iterable[Reading], path: str = "") -> list[str]:
    """Every broken field rule: ``points[1].x is outside -1 to 1 m``."""
    found = []
    for reading in readings:
        found += [f"{path}{reading.name}{fault}" for fault in reading.faults]
        found += faults_of(reading.parts, f"{path}{reading.name}.")
    return found


def values_text(readings: Iterable[Reading]) -> str:
    """``linear 0.5 m/s, angular 0 rad/s``, shortened where there is much."""
    texts = [f"{r.name} {_short(r)}" for r in readings if r.field.has_value]
    text = ", ".join(texts)
    return text if len(text) <= _MOST_TEXT else f"{text[:_MOST_TEXT]}…"


_MOST_TEXT = 240


def _short(reading: Reading) -> str:
    if not reading.parts:
        return reading.text.split(" (")[0]
    inner = ", ".join(f"{part.name} {_short(part)}" for part in reading.parts if part.field.has_value)
    return f"{{{inner}}}"


class _CutOff(Exception):  # noqa: N818  (an outcome, not an error)
    """The payload ends within a field."""


@dataclass
class _Walk:
    """Where the next field begins. Fields of varying size take out of ``spare``: what the payload has beyond the least
    that its message needs, so that each field lies within it whatever the counts on the wire say."""

    payload: bytes
    spare: int
    at: int = 0

    def take(self, size: int) -> bytes:
        if self.at + size > len(self.payload):
            raise _CutOff
        self.at += size
        return self.payload[self.at - size : self.at]

    def spend(self, size: int) -> None:
        self.spare -= size

    def read_all(self, fields: tuple[Field, ...], found: list[Reading]) -> None:
        told: dict[str, int] = {}
        for field in fields:
            promised = None
            for name, step in field.counters[:1]:
                promised = told[name] // step
            reading = self._read(field, promised)
            if field.is_count:
                told[field.name] = raw_number(field, reading.data)
            for run in reading.parts if field.kind == FieldKind.BITS else ():
                if run.field.is_count:
                    told[f"{field.name}.{run.name}"] = run.value
            if field.counters:
                reading = _with_promises(reading, field, told)
            found.append(reading)

    def _read(self, field: Field, promised: int | None) -> Reading:
        if field.kind not in _READERS:
            raise NotImplementedError(f"values.py has no entry for the field type '{field.kind}'")
        if field.digits is not None:
            return _in_characters(self, field, field.digits)
        return _READERS[field.kind](self, field, promised)

    def number_of_elements(self, field: Field, promised: int | None) -> int:
        """How many elements of a list there are, taken out of ``spare``. A list of structs asks one by one, for
        structs may vary in size themselves."""
        most = field.max_count if promised is None else min(promised, field.max_count)
        number = min(most, self.spare // field.element_min_bytes) if field.element_min_bytes else most
        self.spend(number * field.element_min_bytes)
        return number


def _with_promises(reading: Reading, field: Field, told: dict[str, int]) -> Reading:
    """What each of its counts tells, held against what is there."""
    found = len(reading.data if field.is_string else reading.value)
    for name, step in field.counters:
        if told[name] != found * step:
            what = "bytes" if field.is_string or step > 1 else "elements"
            reading = replace(
                reading, faults=(*reading.faults, f" has {found * step} {what}, and {name} tells {told[name]}")
            )
    return reading


# ---- each kind of field ----


def _numbers(walk: _Walk, field: Field, promised: int | None) -> Reading:
    start = walk.at
    if field.packed is not None:
        data = walk.take(field.min_wire_bytes)
        raws = [packed_number(data, index * field.bits, field.bits, field.packed) for index in range(field.count or 0)]
    elif field.is_list:
        number = walk.number_of_elements(field, promised)
        data = walk.take(number * field.size)
        raws = [raw_number(field, data[at : at + field.size]) for at in range(0, len(data), field.size)]
    else:
        data = walk.take(field.size * (1 if field.count is None else field.count))
        raws = [raw_number(field, data[at : at + field.size]) for at in range(0, len(data), field.size)]
    elements = [number_of(field, raw) for raw in raws]
    if field.count is None and not field.is_list:
        value, text, fault = elements[0]
        return Reading(field, field.name, start, data, value, text, (fault,) if fault else ())
    values = [value for value, _, _ in elements]
    faults = tuple(f"[{index}]{fault}" for index, (_, _, fault) in enumerate(elements) if fault)
    return Reading(field, field.name, start, data, values, _array_text(field, elements), faults)


def _array_text(field: Field, elements: list[ReadNumber]) -> str:
    texts = [text.split(" (")[0].removesuffix(f" {field.unit}") for _, text, _ in elements]
    return with_unit("[" + ", ".join(texts) + "]", field)


def _text(walk: _Walk, field: Field, promised: int | None) -> Reading:
    start, (data, faults) = walk.at, _string(walk, field, promised)
    shown = data.split(b"\0", 1)[0] if field.size else _without_end(data, field)
    try:
        data.decode()
    except UnicodeDecodeError:
        faults = (*faults, " is not UTF-8")
    value = shown.decode(errors="replace")
    return Reading(field, field.name, start, data, value, f'"{visible(value)}"', faults)


def _bytes(walk: _Walk, field: Field, promised: int | None) -> Reading:
    start, (data, faults) = walk.at, _string(walk, field, promised)
    value = _without_end(data, field)
    return Reading(field, field.name, start, data, value, f"{len(value)} byte{'s' * (len(value) != 1)}", faults)


def _in_characters(walk: _Walk, field: Field, digits: Digits) -> Reading:
    start, (data, faults) = walk.at, _string(walk, field, None)
    spelled = _without_end(data, field).decode("latin-1")
    wire = None if faults else _spelled_number(field, digits, spelled)
    if wire is None:
        faults = faults or (f' is "{visible(spelled)}", which is no {field_type(field)}',)
        return Reading(field, field.name, start, data, None, f'"{visible(spelled)}"', faults)
    value, text, fault = whole_number(field, wire)
    return Reading(field, field.name, start, data, value, text, (fault,) if fault else ())


def _spelled_number(field: Field, digits: Digits, spelled: str) -> int | None:
    """The whole number that these characters spell; None where they spell none that the field's type holds. What stands
    behind the last decimal is rounded, halves away from zero."""
    if digits.base == 16:
        found = re.fullmatch(r" *\+?([0-9A-Fa-f]+)", spelled)
        number = int(found[1], 16) if found else None
    else:
        found = re.fullmatch(r" *([+-]?)([0-9]*)(?:\.([0-9]*))?", spelled)
        number = _decimal_number(found[1], found[2], found[3], digits.decimals) if found else None
        if found is not None and found[1] == "-" and not field.coding.is_signed:
            return None
    least, greatest = replace(field, digits=None).whole_limits
    return number if number is not None and least <= number <= greatest else None


def _decimal_number(sign: str, whole: str, behind: str | None, decimals: int) -> int | None:
    if not (whole or behind) or (behind is not None and decimals == 0):
        return None
    places = (behind or "").ljust(decimals + 1, "0")
    amount = int((whole or "0") + places[:decimals]) + (decimals > 0 and places[decimals] >= "5")
    return -amount if sign == "-" else amount


def _string(walk: _Walk, field: Field, promised: int | None) -> tuple[bytes, tuple[str, ...]]:
    """Its bytes with the one that ends it, and what is wrong."""
    if field.size:
        return walk.take(field.size), ()
    most = min(field.max_size, walk.spare)
    if field.ends_with is not None:
        found = walk.payload.find(field.ends_with, walk.at, walk.at + most + 1)
        size = most if found < 0 else found - walk.at
        fault = f" does not end with 0x{field.ends_with:02X} within {most + 1} byte{'s' * (most > 0)}"
        walk.spend(size)
        return walk.take(size + 1), (fault,) * (found < 0)
    size = min(most, field.max_size if promised is None else promised)
    walk.spend(size)
    return walk.take(size), ()


def _without_end(data: bytes, field: Field) -> bytes:
    """The value of a string. One whose end is missing keeps its last byte."""
    return data if field.ends_with is None else data.removesuffix(bytes([field.ends_with]))


def _padding(walk: _Walk, field: Field, _: int | None) -> Reading:
    start, data = walk.at, walk.take(field.min_wire_bytes)
    if field.constant is not None:
        text, wanted = constant_text(field, raw_number(field, data)), constant_text(field, field.constant)
        return Reading(field, field.name, start, data, None, "constant" if text == wanted else f"must be {wanted}")
    text = "padding: ignored" + (", though a sender puts 0 here" if any(data) else "")
    return Reading(field, field.name, start, data, None, text)


def _bit_fields(walk: _Walk, field: Field, _: int | None) -> Reading:
    start, data = walk.at, walk.take(field.size)
    number = raw_number(field, data)
    parts = []
    for part, low in bit_places(field):
        if not part.has_value and part.constant is None:
            continue
        bits = bits_of(part, low, number)
        if part.constant is not None:
            wanted, there = constant_text(part, part.constant), constant_text(part, bits)
            text = f"{there}, a constant" if there == wanted else f"{there}, which must be {wanted}"
            parts.append(Reading(part, part.name, start, b"", None, text))
            continue
        value, text, fault = number_of(part, bits)
        text = f"{text}, {bits_text(part, low)}"
        parts.append(Reading(part, part.name, start, b"", value, text, (fault,) if fault else ()))
    text = f"0x{number:0{2 * field.size}X}, shared by its bits"
    return Reading(field, field.name, start, data, values_of(parts), text, (), tuple(parts))


def _structs(walk: _Walk, field: Field, promised: int | None) -> Reading:
    start = walk.at
    if field.count is None and not field.is_list:
        one = _struct(walk, field, field.name)
        return one
    parts = []
    most = field.count or 0
    if field.is_list:
        most = field.max_count if promised is None else min(promised, field.max_count)
    least = field.element_min_bytes
    for index in range(most):
        if field.is_list:
            if least > walk.spare:
                break
            walk.spend(least)
        parts.append(_struct(walk, field, f"{field.name}[{index}]"))
    data = walk.payload[start : walk.at]
    of = f" of {field.type_name}" if field.type_name else ""
    text = f"{len(parts)} element{'s' * (len(parts) != 1)}{of}"
    return Reading(field, field.name, start, data, [part.value for part in parts], text, (), tuple(parts))


def _struct(walk: _Walk, field: Field, name: str) -> Reading:
    start = walk.at
    parts: list[Reading] = []
    walk.read_all(field.fields, parts)
    data = walk.payload[start : walk.at]
    text = field.type_name or f"{len(field.fields)} fields"
    return Reading(field, name, start, data, values_of(parts), text, (), tuple(parts))


# One entry for each kind of field in the model.
_READERS: dict[FieldKind, Callable[[_Walk, Field, int | None], Reading]] = {
    FieldKind.INTEGER: _numbers,
    FieldKind.FLOAT: _numbers,
    FieldKind.BOOL: _numbers,
    FieldKind.TEXT: _text,
    FieldKind.BYTES: _bytes,
    FieldKind.PADDING: _padding,
    FieldKind.BITS: _bit_fields,
    FieldKind.STRUCT: _structs,
}


# ---- one number ----
