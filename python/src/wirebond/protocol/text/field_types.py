"""The types of fields: how each is written, and which of them a bit field or a packed stream can take."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Annotated, Any, Literal

from pydantic import Field, PlainValidator

from wirebond.protocol.model import BCD, CODINGS, FLOATS, SIGN_MAGNITUDE, TWOS_COMPLEMENT, UNSIGNED, Coding, FieldKind
from wirebond.protocol.problems import quoted
from wirebond.protocol.text.scalars import FOREIGN_TYPES, WireType, both_orders, describe, wrong

# The widths of each coding, in bits, as a regular expression: with a sign 2 at least, and of decimal digits 4 for each.
_UP_TO_64 = "[1-5][0-9]|6[0-4]"
_WIDTHS = {
    UNSIGNED: f"[1-9]|{_UP_TO_64}",
    TWOS_COMPLEMENT: f"[2-9]|{_UP_TO_64}",
    SIGN_MAGNITUDE: f"[2-9]|{_UP_TO_64}",
    BCD: "[48]|[135][26]|[24][048]|60",  # a double has all numbers of 15 digits
}
_POSSIBLE = (
    "u8, i8 and s8 to u64, i64 and s64 in steps of 8 bits, bcd8 to bcd56 (two decimal digits in each byte), "
    f"{', '.join(one.name for one in FLOATS)}, bool, text, bytes, padding"
)
_ORDERS = "add `le` or `be` to a number's type for its byte order"


def _widths(coding: Coding) -> list[int]:
    """Return the widths that a number of this coding may have, in bits."""
    return [bits for bits in range(1, 65) if re.fullmatch(_WIDTHS[coding], str(bits))]


def most_bits(coding: Coding) -> int:
    """Return the most bits that a number of this coding may have."""
    return _widths(coding)[-1]


def _pattern(codings: Iterable[Coding]) -> str:
    """Return a regular expression for numbers of these codings and of any width."""
    return f"^({'|'.join(f'{coding.letters}({_WIDTHS[coding]})' for coding in codings)})$"


def _whole_types() -> dict[str, WireType]:
    """Return types that begin and end with a byte."""
    table: dict[str, WireType] = {}
    for coding in CODINGS:
        for bits in _widths(coding):
            if bits % 8 == 0:
                table |= both_orders(f"{coding.letters}{bits}", FieldKind.INTEGER, bits // 8, coding)
    for one in FLOATS:
        table |= both_orders(one.name, FieldKind.FLOAT, one.size)
    table["bool"] = WireType("bool", FieldKind.BOOL, 1)
    for kind in (FieldKind.TEXT, FieldKind.BYTES, FieldKind.PADDING):
        table[kind.value] = WireType(kind.value, kind, 0)
    return table


_WHOLE_TYPES = _whole_types()
_ANY_WIDTH = {
    f"{coding.letters}{bits}": WireType(f"{coding.letters}{bits}", FieldKind.INTEGER, 0, bits=bits, coding=coding)
    for coding in CODINGS
    for bits in _widths(coding)
    if bits % 8
}
_IN_HEADERS = [coding for coding in CODINGS if coding.is_binary]
_WHOLE_INTEGERS = {word: t for word, t in _WHOLE_TYPES.items() if t.is_integer and t.coding in _IN_HEADERS}
_CONTAINER_TYPES = {word: t for word, t in _WHOLE_TYPES.items() if t.is_unsigned}


def _field_type(value: object) -> WireType:
    if not isinstance(value, str):
        raise wrong(f"{describe(value)} is not a type; possible: {_POSSIBLE}; {_ORDERS}")
    found = _WHOLE_TYPES.get(value) or _ANY_WIDTH.get(value)
    if found is not None:
        return found
    if value.endswith(("le", "be")) and (_WHOLE_TYPES.get(value[:-2]) or _ANY_WIDTH.get(value[:-2])) is not None:
        raise wrong(f"{quoted(value)} has no byte order to choose; write `{value[:-2]}`")
    known = FOREIGN_TYPES.get(value.lower())
    if value.lower() == "char":
        raise wrong(f"{quoted(value)} is not a type here; write `text` for letters (`size: 8`), or `u8` for a number")
    if known is not None:
        raise wrong(f"{quoted(value)} is not a type here; write `{known}`")
    raise wrong(f"{quoted(value)} is not a type here; possible: {_POSSIBLE}; {_ORDERS}")


def _bit_type(value: object) -> WireType:
    possible = "possible: u1 to u64, i2 to i64, s2 to s64, bcd4 to bcd60 in steps of 4, bool, padding"
    found = (_WHOLE_TYPES.get(value) or _ANY_WIDTH.get(value)) if isinstance(value, str) else None
    if found is None or found.order is not None or found.kind in (FieldKind.FLOAT, FieldKind.TEXT, FieldKind.BYTES):
        raise wrong(f"{describe(value)} is not a type of a bit field; {possible}")
    return found


def _container_type(value: object) -> WireType:
    if isinstance(value, str) and value in _CONTAINER_TYPES:
        return _CONTAINER_TYPES[value]
    raise wrong(f"{describe(value)} cannot hold bit fields; write u8, u16 or another unsigned type up to u64")


def is_field_type(word: str) -> bool:
    """Return whether the word is a type, such as `u16be`, `i5` or `text`."""
    return word in _WHOLE_TYPES or word in _ANY_WIDTH


def wire_type(word: str) -> WireType:
    """Return the type of a word that is one: `u16be`, `i5`."""
    found = _WHOLE_TYPES.get(word) or _ANY_WIDTH.get(word)
    assert found is not None, word
    return found


def _header_type(value: object) -> WireType:
    """Return a header field that begins and ends with a byte."""
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
    """Return a header field among bits."""
    found = (_WHOLE_INTEGERS.get(value) or _ANY_WIDTH.get(value)) if isinstance(value, str) else None
    if found is None or found.order is not None or found.coding not in _IN_HEADERS:
        raise wrong(f"{describe(value)} is not a type of a run of bits; possible: u1 to u64, i2 to i64, s2 to s64")
    return found


TypeWord: Any = Literal[tuple(_WHOLE_TYPES)]
_WidthText = Annotated[str, Field(pattern=_pattern(CODINGS))]
_RunText = Annotated[str, Field(pattern=_pattern(_IN_HEADERS))]
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
