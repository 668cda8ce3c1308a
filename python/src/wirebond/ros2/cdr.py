"""Messages as dicts to the bytes of DDS (CDR) and back, by their type. What a dict lacks gets its default.

Bytes come from any program of the network: `decode` believes no length.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

from wirebond.ros2.types import DEFAULTS, Kind, RosField, RosType

_LITTLE = b"\x00\x01\x00\x00"
CODES = {
    "bool": "?", "byte": "B", "char": "B", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i",
    "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip
_PADDING = [bytes(size) for size in range(8)]

_Writer = Callable[[bytearray, Any], None]
_Reader = Callable[[bytes, int], tuple[Any, int]]  # data and place: the value, and the place after it


def encode(type_: RosType, values: Mapping[str, Any]) -> bytes:
    """Return the bytes of a message, with the four that say how it is encoded.

    :raises ValueError, TypeError, struct.error: a value is not of its field's type.
    """
    out = bytearray()
    _message_writer(type_)(out, values)
    return _LITTLE + out


def decode(type_: RosType, data: bytes) -> dict[str, Any]:
    """Return the message in these bytes.

    :raises ValueError: they are not a message of this type.
    """
    if len(data) < 4 or data[0] != 0 or data[1] not in (0, 1):
        raise ValueError("the bytes are not plain CDR")
    try:
        values, _ = _message_reader(type_, "<" if data[1] else ">")(data[4:], 0)
    except (struct.error, IndexError, UnicodeDecodeError) as error:
        raise ValueError(f"the bytes are no {type_.short}: {error}") from None
    found: dict[str, Any] = values
    return found


# ---- places of a message's numbers

Steps = tuple[str | int, ...]


def places_of(type_: RosType, values: Mapping[str, Any]) -> dict[Steps, tuple[int, str]]:
    """Return the place of each number in the bytes of `encode` for this message, and how `struct` packs it. The places
    are the same in every message of this type whose texts and sequences have the same sizes."""
    places: dict[Steps, tuple[int, str]] = {}
    _place(type_, values, 0, (), places)
    return {steps: (len(_LITTLE) + at, code) for steps, (at, code) in places.items()}


def _place(
    type_: RosType, values: Mapping[str, Any], at: int, path: Steps, places: dict[Steps, tuple[int, str]]
) -> int:
    """Note the place of each number of this message, and how it is packed; return the place after the message."""
    for field in type_.fields:
        value = values.get(field.name, DEFAULTS.get(type_.name, {}).get(field.name, default_of(field)))
        steps = (*path, field.name)
        if field.kind == Kind.ONE:
            at = _place_one(field, value, at, steps, places)
            continue
        if field.kind == Kind.SEQUENCE:
            at += -at % 4 + 4
        for index, one in enumerate(value):
            at = _place_one(field, one, at, (*steps, index), places)
    return at


def _place_one(field: RosField, value: Any, at: int, steps: Steps, places: dict[Steps, tuple[int, str]]) -> int:
    if field.of is not None:
        return _place(field.of, value, at, steps, places)
    if field.base == "string":
        return at + -at % 4 + 4 + len(value.encode()) + 1
    size = struct.calcsize(f"<{CODES[field.base]}")
    at += -at % size
    places[steps] = at, CODES[field.base]
    return at + size


# ---- to bytes


@cache
def _message_writer(type_: RosType) -> _Writer:
    defaults = DEFAULTS.get(type_.name, {})
    fields = [(f.name, _field_writer(f), defaults.get(f.name, default_of(f))) for f in type_.fields]

    def write(out: bytearray, values: Any) -> None:
        for name, write_field, default in fields:
            write_field(out, values.get(name, default))

    return write


def default_of(field: RosField) -> Any:
    """Return the value that a new message has there."""
    if field.kind == Kind.SEQUENCE:
        return ()
    one: Any = {} if field.of is not None else "" if field.base == "string" else False if field.base == "bool" else 0
    return (one,) * field.count if field.kind == Kind.ARRAY else one


def _field_writer(field: RosField) -> _Writer:
    if field.kind == Kind.ONE:
        return _one_writer(field)
    is_array = field.kind == Kind.ARRAY
    code = CODES.get(field.base)
    size = struct.calcsize(f"<{code}") if code else 0
    write_one = None if code else _one_writer(field)

    def write(out: bytearray, values: Any) -> None:
        if is_array and len(values) != field.count:
            raise ValueError(f"{field.name} has {len(values)} values; expected {field.count}")
        if not is_array:
            out += _PADDING[-len(out) % 4]
            out += len(values).to_bytes(4, "little")
        if write_one is None:
            if len(values):
                out += _PADDING[-len(out) % size]
                out += bytes(values) if code == "B" else struct.pack(f"<{len(values)}{code}", *values)
            return
        for value in values:
            write_one(out, value)

    return write


def _one_writer(field: RosField) -> _Writer:
    if field.of is not None:
        return _message_writer(field.of)
    if field.base == "string":
        return _write_string
    if field.base not in CODES:
        raise ValueError(f"{field.name} is of type {field.base}, which Wirebond does not write")
    pack = struct.Struct(f"<{CODES[field.base]}")
    size, packed = pack.size, pack.pack

    def write(out: bytearray, value: Any) -> None:
        out += _PADDING[-len(out) % size]
        out += packed(value)

    return write


def _write_string(out: bytearray, value: str) -> None:
    text = value.encode()
    out += _PADDING[-len(out) % 4]
    out += (len(text) + 1).to_bytes(4, "little")
    out += text
    out.append(0)


# ---- from bytes


@cache
def _message_reader(type_: RosType, order: str) -> _Reader:
    fields = [(f.name, _field_reader(f, order)) for f in type_.fields]

    def read(data: bytes, at: int) -> tuple[Any, int]:
        values = {}
        for name, read_field in fields:
            values[name], at = read_field(data, at)
        return values, at

    return read


def _field_reader(field: RosField, order: str) -> _Reader:
    read_one = _one_reader(field, order)
    if field.kind == Kind.ONE:
        return read_one
    code = CODES.get(field.base)
    size = struct.calcsize(f"<{code}") if code else 0
    unpack_count = struct.Struct(f"{order}I").unpack_from

    def read(data: bytes, at: int) -> tuple[Any, int]:
        count = field.count
        if field.kind == Kind.SEQUENCE:
            at += -at % 4
            (count,) = unpack_count(data, at)
            at += 4
        if count > len(data) - at:  # an element has at least one byte
            raise ValueError(f"{field.name} announces {count} elements, but only {len(data) - at} bytes follow")
        if code and count:
            at += -at % size
            values: Any = struct.unpack_from(f"{order}{count}{code}", data, at)
            return values, at + count * size
        values = []
        for _ in range(count):
            value, at = read_one(data, at)
            values.append(value)
        return values, at

    return read


def _one_reader(field: RosField, order: str) -> _Reader:
    if field.of is not None:
        return _message_reader(field.of, order)
    if field.base == "string":
        return _string_reader(order)
    if field.base not in CODES:
        raise ValueError(f"{field.name} is of type {field.base}, which Wirebond does not read")
    form = struct.Struct(f"{order}{CODES[field.base]}")
    size, unpack = form.size, form.unpack_from

    def read(data: bytes, at: int) -> tuple[Any, int]:
        at += -at % size
        return unpack(data, at)[0], at + size

    return read


@cache
def _string_reader(order: str) -> _Reader:
    unpack_count = struct.Struct(f"{order}I").unpack_from

    def read(data: bytes, at: int) -> tuple[Any, int]:
        at += -at % 4
        (size,) = unpack_count(data, at)
        at += 4
        if size > len(data) - at:
            raise ValueError(f"a text announces {size} bytes, but only {len(data) - at} follow")
        return data[at : at + max(size - 1, 0)].decode(), at + size

    return read
