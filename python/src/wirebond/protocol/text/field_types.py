"""The types of fields: how each is written, and which of them a bit field or a packed stream can take."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import Field, PlainValidator

from wirebond.protocol.model import FieldKind
from wirebond.protocol.problems import quoted
from wirebond.protocol.text.scalars import FOREIGN_TYPES, WireType, both_orders, describe, wrong

_INTEGERS = {"u": FieldKind.UNSIGNED, "i": FieldKind.SIGNED, "s": FieldKind.SIGNED}
_ANY_WIDTH = re.compile(r"([uis]|bcd)([1-9][0-9]?)")
_BINARY = r"u([1-9]|[1-5][0-9]|6[0-4])|[is]([2-9]|[1-5][0-9]|6[0-4])"
_DECIMAL = r"bcd([48]|[135][26]|[24][048]|60)"
MOST_BCD_BITS = 60  # a double has all numbers of 15 digits
_POSSIBLE = (
    "u8, i8 and s8 to u64, i64 and s64 in steps of 8 bits, bcd8 to bcd56 (two decimal digits in each byte), f32, f64, "
    "bool, text, bytes, padding"
)
_ORDERS = "`le` or `be` behind a number's type sets its byte order"


def _whole_types() -> dict[str, WireType]:
    """Types that begin and end with a byte."""
    table: dict[str, WireType] = {}
    for letter, kind in _INTEGERS.items():
        for size in range(1, 9):
            table |= both_orders(f"{letter}{8 * size}", kind, size, sign_magnitude=letter == "s")
    for size in range(1, 8):
        table |= both_orders(f"bcd{8 * size}", FieldKind.BCD, size)
    for size in (4, 8):
        table |= both_orders(f"f{8 * size}", FieldKind.FLOAT, size)
    table["bool"] = WireType("bool", FieldKind.BOOL, 1)
    for kind in (FieldKind.TEXT, FieldKind.BYTES, FieldKind.PADDING):
        table[kind.value] = WireType(kind.value, kind, 0)
    return table


_WHOLE_TYPES = _whole_types()
_WHOLE_INTEGERS = {word: t for word, t in _WHOLE_TYPES.items() if t.kind in (FieldKind.UNSIGNED, FieldKind.SIGNED)}
_CONTAINER_TYPES = {word: t for word, t in _WHOLE_TYPES.items() if t.kind == FieldKind.UNSIGNED}


def _any_width(word: str) -> WireType | None:
    """An integer of 1 to 64 bits; with a sign it has 2 at least, and in decimal digits 4 for each."""
    match = _ANY_WIDTH.fullmatch(word)
    if match is None:
        return None
    letter, bits = match[1], int(match[2])
    if letter == "bcd":
        return _bcd(word, bits)
    if bits > 64 or (bits == 1 and letter != "u"):
        return None
    if bits % 8 == 0:
        return _WHOLE_TYPES[word]
    return WireType(word, _INTEGERS[letter], 0, bits=bits, sign_magnitude=letter == "s")


def _bcd(word: str, bits: int) -> WireType | None:
    if bits % 4 or bits > MOST_BCD_BITS:
        return None
    return _WHOLE_TYPES.get(word) or WireType(word, FieldKind.BCD, 0, bits=bits)


def _field_type(value: object) -> WireType:
    if not isinstance(value, str):
        raise wrong(f"{describe(value)} is not a type; possible: {_POSSIBLE}; {_ORDERS}")
    found = _WHOLE_TYPES.get(value) or _any_width(value)
    if found is not None:
        return found
    if value.endswith(("le", "be")) and (_WHOLE_TYPES.get(value[:-2]) or _any_width(value[:-2])) is not None:
        raise wrong(f"{quoted(value)} has no byte order to choose; write `{value[:-2]}`")
    known = FOREIGN_TYPES.get(value.lower())
    if value.lower() == "char":
        raise wrong(f"{quoted(value)} is not a type here; write `text` for letters (`size: 8`), or `u8` for a number")
    if known is not None:
        raise wrong(f"{quoted(value)} is not a type here; write `{known}`")
    raise wrong(f"{quoted(value)} is not a type here; possible: {_POSSIBLE}; {_ORDERS}")


def _bit_type(value: object) -> WireType:
    possible = "possible: u1 to u64, i2 to i64, s2 to s64, bcd4 to bcd60 in steps of 4, bool, padding"
    found = (_WHOLE_TYPES.get(value) or _any_width(value)) if isinstance(value, str) else None
    if found is None or found.order is not None or found.kind in (FieldKind.FLOAT, FieldKind.TEXT, FieldKind.BYTES):
        raise wrong(f"{describe(value)} is not a type of a bit field; {possible}")
    return found


def _container_type(value: object) -> WireType:
    if isinstance(value, str) and value in _CONTAINER_TYPES:
        return _CONTAINER_TYPES[value]
    raise wrong(f"{describe(value)} cannot hold bit fields; write u8, u16 or another unsigned type up to u64")


def is_field_type(word: str) -> bool:
    """Whether the word is a type, such as `u16be`, `i5` or `text`."""
    return word in _WHOLE_TYPES or _any_width(word) is not None


def wire_type(word: str) -> WireType:
    """The type of a word that is one: `u16be`, `i5`."""
    found = _WHOLE_TYPES.get(word) or _any_width(word)
    assert found is not None, word
    return found


def _header_type(value: object) -> WireType:
    """A header field that begins and ends with a byte."""
    if isinstance(value, str) and value in _WHOLE_INTEGERS:
        return _WHOLE_INTEGERS[value]
    known = FOREIGN_TYPES.get(value.lower()) if isinstance(value, str) else None
    if known in _WHOLE_INTEGERS:
        raise wrong(f"{describe(value)} is not a type here; write `{known}`")
    if isinstance(value, str) and value.endswith(("le", "be")) and value[:-2] in _WHOLE_INTEGERS:
        raise wrong(f"{quoted(value)} has no byte order to choose; write `{value[:-2]}`")
    raise wrong(
        f"{describe(value)} is not a type of a header field; possible: u8, i8 and s8 to u64, i64 and s64 in steps of "
        f"8 bits; {_ORDERS}"
    )


def _run_type(value: object) -> WireType:
    """A header field among bits."""
    found = (_WHOLE_INTEGERS.get(value) or _any_width(value)) if isinstance(value, str) else None
    if found is None or found.order is not None or found.kind == FieldKind.BCD:
        raise wrong(f"{describe(value)} is not a type of a run of bits; possible: u1 to u64, i2 to i64, s2 to s64")
    return found


TypeWord: Any = Literal[tuple(_WHOLE_TYPES)]
_WidthText = Annotated[str, Field(pattern=f"^({_BINARY}|{_DECIMAL})$")]
_RunText = Annotated[str, Field(pattern=f"^({_BINARY})$")]
FieldType = Annotated[
    WireType,
    PlainValidator(_field_type, json_schema_input_type=TypeWord | _WidthText),
]
BitType = Annotated[WireType, PlainValidator(_bit_type, json_schema_input_type=Literal["bool", "padding"] | _WidthText)]
ContainerType = Annotated[
    WireType, PlainValidator(_container_type, json_schema_input_type=Literal[tuple(_CONTAINER_TYPES)])
]
HeaderType = Annotated[WireType, PlainValidator(_header_type, json_schema_input_type=Literal[tuple(_WHOLE_INTEGERS)])]
RunType = Annotated[WireType, PlainValidator(_run_type, json_schema_input_type=_RunText)]
