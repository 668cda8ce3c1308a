"""Payload bytes as field values, each with its unit, how it came out, and the field rules that it breaks."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, assert_never

from wirebond.analysis.explain.constants import constant_text
from wirebond.analysis.explain.numbers import ReadNumber, number_of, packed_number, raw_number, whole_number, with_unit
from wirebond.protocol.model import Digits, Field, Message
from wirebond.protocol.model.layout import (
    Array,
    Bits,
    Characters,
    Constant,
    Group,
    List,
    Number,
    Padding,
    Step,
    Told,
)
from wirebond.protocol.spelling import field_type
from wirebond.visible import visible


@dataclass(frozen=True)
class Reading:
    """A field of a payload, or one element of a field that repeats its fields. ``value`` is what the Python API
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
    """Return the fields that the payload holds whole, in wire order; those behind a payload that is too short are left
    out.

    Padding has a reading, and no value.
    """
    found: list[Reading] = []
    walk = _Walk(payload, max(0, len(payload) - message.min_payload))
    with suppress(_CutOff):  # the complete values are named; the rest is cut off
        walk.read_all(message.layout, found)
    return found


def values_of(readings: Iterable[Reading]) -> dict[str, Any]:
    """Return the values by name, as the Python API gives them."""
    return {reading.name: reading.value for reading in readings if reading.field.has_value}


def faults_of(readings: Iterable[Reading], path: str = "") -> list[str]:
    """List every broken field rule: ``points[1].x is outside -1 to 1 m``."""
    found = []
    for reading in readings:
        found += [f"{path}{reading.name}{fault}" for fault in reading.faults]
        found += faults_of(reading.parts, f"{path}{reading.name}.")
    return found


def values_text(readings: Iterable[Reading]) -> str:
    """Write the values, shortened if there are many: ``linear 0.5 m/s, angular 0 rad/s``."""
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
    """Finds where each field begins. Fields of varying size use up ``spare``, the bytes that the payload has beyond the
    minimum of its message. So each field is inside the payload for any counts on the wire."""

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

    def read_all(self, steps: tuple[Step, ...], found: list[Reading]) -> None:
        numbers: dict[str, int] = {}
        for step in steps:
            told = step.told if isinstance(step, Characters | List) else ()
            reading = self._read(step, numbers[told[0].name] // told[0].per if told else None)
            if isinstance(step, Number) and step.slot is not None:
                numbers[step.field.name] = raw_number(step.field, reading.data)
            if isinstance(step, Bits):
                shared = raw_number(step.field, reading.data)
                runs = (member for member in step.members if member.slot is not None)
                numbers |= {f"{step.field.name}.{run.field.name}": run.bits_of(shared) for run in runs}
            found.append(_with_promises(reading, told, numbers))

    def _read(self, step: Step, promised: int | None) -> Reading:
        """:param promised: elements or bytes that the payload says there are; None: it says nothing."""
        match step:
            case Padding() | Constant():
                return _padding(self, step)
            case Number() | Array():
                return _numbers(self, step.field, 1 if step.field.count is None else step.field.count)
            case List(steps=()):
                return _numbers(self, step.field, self.number_of_elements(step, promised))
            case Bits():
                return _bit_fields(self, step)
            case Characters():
                return _characters(self, step.field, promised)
            case Group():
                return _group(self, step)
            case List():
                return _list_of_groups(self, step, promised)
            case _:
                assert_never(step)

    def number_of_elements(self, step: List, promised: int | None) -> int:
        """Return how many numbers of a list are present, taken out of ``spare``. A list of groups asks for each one,
        because groups may vary in size."""
        number = min(_most(step, promised), self.spare // step.stride)
        self.spend(number * step.stride)
        return number


def _most(step: List, promised: int | None) -> int:
    """Return the most elements that there may be."""
    return step.field.max_count if promised is None else min(promised, step.field.max_count)


def _with_promises(reading: Reading, told: tuple[Told, ...], numbers: Mapping[str, int]) -> Reading:
    """Compare each of its counts with the elements that are present."""
    if not told:
        return reading
    is_string = reading.field.is_string
    found = len(reading.data if is_string else reading.value)
    for one in told:
        if numbers[one.name] != found * one.per:
            what = "bytes" if is_string or one.per > 1 else "elements"
            fault = f" has {found * one.per} {what}, and {one.name} says {numbers[one.name]}"
            reading = replace(reading, faults=(*reading.faults, fault))
    return reading


# ---- each kind of step ----


def _numbers(walk: _Walk, field: Field, number: int) -> Reading:
    start = walk.at
    if field.packed is not None:
        data = walk.take(field.min_wire_bytes)
        raws = [packed_number(data, index * field.bits, field.bits, field.packed) for index in range(number)]
    else:
        data = walk.take(field.size * number)
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


def _characters(walk: _Walk, field: Field, promised: int | None) -> Reading:
    start, (data, faults) = walk.at, _string(walk, field, promised)
    if field.digits is not None:
        return _in_characters(field, field.digits, start, data, faults)
    if field.value_type is bytes:
        content = _without_end(data, field)
        text = f"{len(content)} byte{'s' * (len(content) != 1)}"
        return Reading(field, field.name, start, data, content, text, faults)
    shown = data.split(b"\0", 1)[0] if field.size else _without_end(data, field)
    try:
        data.decode()
    except UnicodeDecodeError:
        faults = (*faults, " is not UTF-8")
    value = shown.decode(errors="replace")
    return Reading(field, field.name, start, data, value, f'"{visible(value)}"', faults)


def _in_characters(field: Field, digits: Digits, start: int, data: bytes, faults: tuple[str, ...]) -> Reading:
    spelled = _without_end(data, field).decode("latin-1")
    wire = None if faults else _spelled_number(field, digits, spelled)
    if wire is None:
        faults = faults or (f' is "{visible(spelled)}", which is no {field_type(field)}',)
        return Reading(field, field.name, start, data, None, f'"{visible(spelled)}"', faults)
    value, text, fault = whole_number(field, wire)
    return Reading(field, field.name, start, data, value, text, (fault,) if fault else ())


def _spelled_number(field: Field, digits: Digits, spelled: str) -> int | None:
    """Return the whole number that these characters spell; None where they spell none that the field's type holds. What
    follows the last decimal is rounded, halves away from zero."""
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
    """Read a string: its bytes with the one that ends it, and its faults."""
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
    """Return the value of a string. One whose end is missing keeps its last byte."""
    return data if field.ends_with is None else data.removesuffix(bytes([field.ends_with]))


def _padding(walk: _Walk, step: Padding | Constant) -> Reading:
    field, start = step.field, walk.at
    data = walk.take(field.size)
    if isinstance(step, Constant):
        wanted = constant_text(field, field.constant or 0)
        text = "constant" if data == step.wire else f"must be {wanted}"
    else:
        text = "padding: ignored" + (", though a sender puts 0 here" if any(data) else "")
    return Reading(field, field.name, start, data, None, text)


def _bit_fields(walk: _Walk, step: Bits) -> Reading:
    field, start = step.field, walk.at
    data = walk.take(field.size)
    number = raw_number(field, data)
    parts = []
    for member in step.members:
        part = member.field
        if not part.has_value and part.constant is None:
            continue
        bits = member.bits_of(number)
        if part.constant is not None:
            wanted, there = constant_text(part, part.constant), constant_text(part, bits)
            text = f"{there}, a constant" if there == wanted else f"{there}, which must be {wanted}"
            parts.append(Reading(part, part.name, start, b"", None, text))
            continue
        value, text, fault = number_of(part, bits)
        parts.append(Reading(part, part.name, start, b"", value, f"{text}, {member.text}", (fault,) if fault else ()))
    text = f"0x{number:0{2 * field.size}X}, shared by its bits"
    return Reading(field, field.name, start, data, values_of(parts), text, (), tuple(parts))


def _group(walk: _Walk, step: Group) -> Reading:
    field, start = step.field, walk.at
    if field.count is None:
        return _element(walk, step, field.name)
    parts = [_element(walk, step, f"{field.name}[{index}]") for index in range(field.count)]
    return _elements(walk, step, start, parts)


def _list_of_groups(walk: _Walk, step: List, promised: int | None) -> Reading:
    start = walk.at
    parts: list[Reading] = []
    while len(parts) < _most(step, promised) and step.stride <= walk.spare:
        walk.spend(step.stride)
        parts.append(_element(walk, step, f"{step.field.name}[{len(parts)}]"))
    return _elements(walk, step, start, parts)


def _elements(walk: _Walk, step: Group | List, start: int, parts: list[Reading]) -> Reading:
    field = step.field
    of = f" of {field.type_name}" if field.type_name else ""
    text = f"{len(parts)} element{'s' * (len(parts) != 1)}{of}"
    values = [part.value for part in parts]
    return Reading(field, field.name, start, walk.payload[start : walk.at], values, text, (), tuple(parts))


def _element(walk: _Walk, step: Group | List, name: str) -> Reading:
    field, start = step.field, walk.at
    parts: list[Reading] = []
    walk.read_all(step.steps, parts)
    text = field.type_name or f"{len(field.fields)} fields"
    return Reading(field, name, start, walk.payload[start : walk.at], values_of(parts), text, (), tuple(parts))
