"""The kinds of single values in a protocol file: how each is written, and what it becomes.

Each is an annotated type for the models of ``grammar``. Input is what ``yaml_tree.plain`` gives.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, PlainValidator
from pydantic_core import PydanticCustomError

from wirebond.protocol import names
from wirebond.protocol.model import UNSIGNED, ByteOrder, Coding, FieldKind
from wirebond.protocol.problems import either, quoted, suggestion
from wirebond.protocol.text.yaml_tree import Number

MAX_SECONDS = 2147  # the MCU counts microseconds modulo 2^32 and compares within half of that
MIN_SECONDS = 1e-6
MAX_ID = 0xFFFFFFFF
MAX_BROADCAST = 4


def wrong(sentence: str, kind: Literal["wrong_value", "wrong_key"] = "wrong_value") -> PydanticCustomError:
    """Return the error to raise for a value (or key); ``grammar`` gives it its place in the file."""
    return PydanticCustomError(kind, "{sentence}", {"sentence": sentence})


def describe(value: object) -> str:
    """Return a value in the words of a file's author."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "`true`" if value else "`false`"
    if isinstance(value, Number):
        return quoted(value.text)
    if isinstance(value, str):
        return quoted(value) if value else "an empty text"
    return "a list" if isinstance(value, list) else "a mapping"


# ---- words and names -----------------------------------------------------------------------------


def word(*allowed: str) -> Callable[[object], str]:
    def validate(value: object) -> str:
        if isinstance(value, str) and value in allowed:
            return value
        if isinstance(value, str):
            raise wrong(f"{describe(value)} is not possible here; {suggestion(value, allowed)}")
        raise wrong(f"{describe(value)} is not possible here; write {either(allowed)}")

    return validate


def one_word(*allowed: str) -> Any:
    """Return the annotation of a value that is one of a few words."""
    return PlainValidator(word(*allowed), json_schema_input_type=Literal[allowed])


def _name(fault: Callable[[str], str]) -> Callable[[object], str]:
    def validate(value: object) -> str:
        if not isinstance(value, str):
            raise wrong(f"{describe(value)} is not a name; write a word, such as `wheel_speed`")
        found = fault(value)
        if found:
            raise wrong(f"{describe(value)} {found}")
        return value

    return validate


def _text(value: object) -> str:
    if not isinstance(value, str):
        raise wrong(f"{describe(value)} is not text here; put it in quotes")
    return value


def in_schema(kind: Any) -> BeforeValidator:
    """Mark what the published schema allows in this place, including short forms, which are expanded before the grammar
    sees them (see ``short_forms``)."""
    return BeforeValidator(lambda value: value, json_schema_input_type=kind)


NameText = Annotated[str, Field(pattern=names.PATTERN, max_length=names.MAX_LENGTH)]
Name = Annotated[str, PlainValidator(_name(names.fault), json_schema_input_type=NameText)]
_PathText = Annotated[str, Field(pattern=names.PATH_PATTERN, max_length=8 * names.MAX_LENGTH)]
FieldPath = Annotated[str, PlainValidator(_name(names.path_fault), json_schema_input_type=_PathText)]
_ProtocolNameText = Annotated[str, Field(pattern=names.PROTOCOL_PATTERN, max_length=names.MAX_LENGTH)]
ProtocolName = Annotated[str, PlainValidator(_name(names.protocol_fault), json_schema_input_type=_ProtocolNameText)]
Text = Annotated[str, PlainValidator(_text, json_schema_input_type=str)]


# ---- numbers -------------------------------------------------------------------------------------


def whole(minimum: int, maximum: int) -> Callable[[object], int]:
    def validate(value: object) -> int:
        if isinstance(value, Number) and isinstance(value.value, int):
            if minimum <= value.value <= maximum:
                return value.value
            raise wrong(f"{describe(value)} is out of range; write a whole number from {minimum} to {maximum}")
        raise wrong(f"{describe(value)} is not a whole number; write one from {minimum} to {maximum}")

    return validate


def _integer(minimum: int, maximum: int) -> Any:
    schema = Annotated[int, Field(ge=minimum, le=maximum)]
    return PlainValidator(whole(minimum, maximum), json_schema_input_type=schema)


def one_of_numbers(*allowed: float) -> Callable[[object], float]:
    def validate(value: object) -> float:
        if isinstance(value, Number) and value.value in allowed:
            return float(value.value)
        raise wrong(f"{describe(value)} is not possible here; write {either(f'{n:g}' for n in allowed)}")

    return validate


def _exact(value: object) -> Fraction:
    if isinstance(value, str) and re.fullmatch(r"[-+]?[0-9]+,[0-9]+", value):
        raise wrong(f"{describe(value)} is not a number; write a point instead of the comma: {value.replace(',', '.')}")
    if not isinstance(value, Number):
        raise wrong(f"{describe(value)} is not a number; write a decimal, such as 0.001")
    if not math.isfinite(value.value):
        raise wrong(f"{describe(value)} is not a finite number; write a decimal, such as 0.001")
    is_nonzero = value.value != 0 or any(c in "123456789" for c in re.split("[eE]", value.text)[0])
    if is_nonzero and not 1e-300 <= abs(value.value) <= 1e300:
        raise wrong(f"{describe(value)} is out of the range of a double; write a number from 1e-300 to 1e300")
    return value.exact()


def _own_value(value: object) -> Fraction | bool | str:
    if isinstance(value, (bool, str)):
        return value
    if isinstance(value, Number):
        return _exact(value)
    raise wrong(f"{describe(value)} is not possible here; write a number, true, false, a name or a text")


def _bool(value: object) -> bool:
    if not isinstance(value, bool):
        raise wrong(f"{describe(value)} is neither true nor false; write true or false")
    return value


Exact = Annotated[Fraction, PlainValidator(_exact, json_schema_input_type=float)]
OwnValue = Annotated[Fraction | bool | str, PlainValidator(_own_value, json_schema_input_type=float | bool | str)]


def _default_value(value: object) -> Fraction | bool | str | list[Fraction | bool | str]:
    return [_own_value(item) for item in value] if isinstance(value, list) else _own_value(value)


DefaultValue = Annotated[
    Fraction | bool | str | list[Fraction | bool | str],
    PlainValidator(_default_value, json_schema_input_type=float | bool | str | list[float | bool | str]),
]


@dataclass(frozen=True)
class EndDefaults:
    """The defaults of each end, as the file gives them."""

    host: Any
    mcu: Any


def _header_default(value: object) -> EndDefaults:
    if not isinstance(value, dict):
        given = _default_value(value)
        return EndDefaults(given, given)
    if set(value) != {"host", "mcu"}:
        raise wrong("this mapping is not a default; write one value, or `{host: 255, mcu: 1}` for one of each end")
    return EndDefaults(_default_value(value["host"]), _default_value(value["mcu"]))


_HeaderDefaultInput: Any = float | str | list[str]
HeaderDefault = Annotated[
    EndDefaults,
    PlainValidator(
        _header_default,
        json_schema_input_type=_HeaderDefaultInput | dict[Literal["host", "mcu"], _HeaderDefaultInput],
    ),
]


def _own_values(value: object) -> list[Fraction | bool | str]:
    listed = [_own_value(item) for item in value] if isinstance(value, list) else [_own_value(value)]
    if not 1 <= len(listed) <= MAX_BROADCAST:
        raise wrong(f"these are {len(listed)} values; write 1 to {MAX_BROADCAST}")
    return listed


OwnValues = Annotated[
    list[Fraction | bool | str], PlainValidator(_own_values, json_schema_input_type=float | str | list[float | str])
]

Bool = Annotated[bool, PlainValidator(_bool, json_schema_input_type=bool)]

Id = Annotated[int, _integer(0, MAX_ID)]
PayloadBytes = Annotated[int, _integer(0, 0xFFFF)]
Count = Annotated[int, _integer(1, 0xFFFF)]
ReservedBytes = Annotated[int, _integer(1, 255)]
BitNumber = Annotated[int, _integer(0, 63)]
WireInteger = Annotated[int, _integer(-(2**63), 2**64 - 1)]
LengthOffset = Annotated[int, _integer(-0xFFFF, 0xFFFF)]
Register = Annotated[int, _integer(0, 2**64 - 1)]
WordSize = Annotated[int, PlainValidator(one_of_numbers(1, 2, 4), json_schema_input_type=Literal[1, 2, 4])]
CheckWidth = Annotated[int, _integer(1, 64)]
Modulus = Annotated[int, _integer(2, 0xFFFF)]
Baud = Annotated[int, _integer(50, 100_000_000)]
StopBits = Annotated[float, PlainValidator(one_of_numbers(1, 1.5, 2), json_schema_input_type=Literal[1, 1.5, 2])]


# ---- bytes ---------------------------------------------------------------------------------------

_BYTE = re.compile(r"0x[0-9a-fA-F]{1,2}")


def hex_bytes(most: int) -> Callable[[object], bytes]:
    advice = "bytes are written 0x.., such as 0xAA" + (" 0x55" if most > 1 else "")

    def validate(value: object) -> bytes:
        if not isinstance(value, (str, Number)):
            raise wrong(f"{describe(value)} is not a byte; {advice}")
        text = value if isinstance(value, str) else value.text
        tokens = text.split()
        if not tokens or not all(_BYTE.fullmatch(token) for token in tokens):
            if len(tokens) == 1 and re.fullmatch(r"0x([0-9a-fA-F]{2}){2,}", text):
                pairs = " ".join("0x" + text[i : i + 2] for i in range(2, min(len(text), 10), 2))
                raise wrong(f"{quoted(text)} runs bytes together; write one 0x.. for each byte: {pairs}")
            raise wrong(f"{describe(value)} is ambiguous (decimal or hexadecimal); {advice}")
        if len(tokens) > most:
            raise wrong(f"{len(tokens)} bytes are too many here; at most {most}")
        return bytes(int(token, 16) for token in tokens)

    return validate


def _bytes_pattern(most: int) -> str:
    return _BYTE.pattern if most == 1 else f"{_BYTE.pattern}( +{_BYTE.pattern}){{0,{most - 1}}}"


def bytes_schema(most: int) -> Any:
    # Editors read a single 0xAA as the integer 170.
    return Annotated[int, Field(ge=0, le=255)] | Annotated[str, Field(pattern=f"^{_bytes_pattern(most)}$")]


def _bytes_type(most: int) -> Any:
    return PlainValidator(hex_bytes(most), json_schema_input_type=bytes_schema(most))


OneByte = Annotated[bytes, _bytes_type(1)]
DelimiterBytes = Annotated[bytes, _bytes_type(2)]
MagicBytes = Annotated[bytes, _bytes_type(4)]
ConstantBytes = Annotated[bytes, _bytes_type(16)]


_PAIRS = re.compile(r"(0x)?[0-9a-fA-F]{2}( *[0-9a-fA-F]{2}| +0x[0-9a-fA-F]{2})*")  # one way to match: no backtracking
MAX_EXAMPLE_BYTES = 4096


def _frame_bytes(value: object) -> bytes:
    if isinstance(value, Number):
        raise wrong(f'{describe(value)} is read as a number; put the bytes in quotes: "{value.text}"')
    if not isinstance(value, str) or not _PAIRS.fullmatch(value):
        raise wrong(f'{describe(value)} is not a frame; write its bytes as two hex digits each: "AA 55 01"')
    found = bytes.fromhex(value.replace("0x", " "))
    if len(found) > MAX_EXAMPLE_BYTES:
        raise wrong(f"{len(found)} bytes are too many for an example; at most {MAX_EXAMPLE_BYTES}")
    return found


def _given_value(value: object) -> Any:
    """Return a value, or lists and mappings of such; the reader bounds how deep."""
    if isinstance(value, list):
        return [_given_value(item) for item in value]
    if isinstance(value, dict):
        return {key: _given_value(item) for key, item in value.items()}
    return _own_value(value)


GivenValue = Annotated[
    Any,
    PlainValidator(_given_value, json_schema_input_type=float | bool | str | list[Any] | dict[str, Any]),
]


def _values_or_one(value: object) -> Any:
    if isinstance(value, dict):
        return {str(key): _given_value(item) for key, item in value.items()}
    return _given_value(value)


# Values by name; or one value, where the key is also the name of a field.
ValuesOrOne = Annotated[
    dict[str, GivenValue] | Fraction | bool | str | list[Any],
    PlainValidator(_values_or_one, json_schema_input_type=dict[str, GivenValue] | float | bool | str | list[Any]),
]
FrameBytes = Annotated[
    bytes,
    PlainValidator(_frame_bytes, json_schema_input_type=Annotated[str, Field(pattern=f"^{_PAIRS.pattern}$")]),
]


# ---- time ----------------------------------------------------------------------------------------

_UNITS = {"us": Fraction(1, 1_000_000), "ms": Fraction(1, 1000), "s": Fraction(1)}
_DURATION = re.compile(r"([0-9]{1,12}(?:\.[0-9]{1,12})?) *([a-zA-Zµ]+)")
_DURATION_PATTERN = r"^[0-9]{1,12}(\.[0-9]{1,12})? *(us|ms|s)$"
_PERIOD_PATTERN = r"^[0-9]{1,12}(\.[0-9]{1,12})? *(us|ms|s|Hz)$"


def _seconds(value: object, *, rates: bool) -> float:
    advice = "write a number and a unit: `50 ms`, `1.5 s` or `200 us`" + (", or a rate: `20 Hz`" if rates else "")
    if isinstance(value, Number):
        raise wrong(f"{describe(value)} has no unit; {advice}")
    match = _DURATION.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        raise wrong(f"{describe(value)} is not a duration; {advice}")
    number, unit = Fraction(match[1]), match[2]
    if unit == "Hz" and rates and number > 0:
        seconds = 1 / number
    elif unit in _UNITS:
        seconds = number * _UNITS[unit]
    elif unit == "Hz" and number > 0:
        raise wrong(f"{describe(value)} is a rate, but a duration is expected here; {advice}")
    elif unit == "Hz":
        raise wrong(f"{describe(value)} means never; leave the key out")
    else:
        raise wrong(f"{quoted(unit)} is not a unit of time; {advice}")
    if not MIN_SECONDS <= seconds <= MAX_SECONDS:
        raise wrong(f"{describe(value)} is out of range; write 1 us to {MAX_SECONDS} s")
    return float(seconds)


Duration = Annotated[
    float,
    PlainValidator(
        lambda value: _seconds(value, rates=False),
        json_schema_input_type=Annotated[str, Field(pattern=_DURATION_PATTERN)],
    ),
]
Period = Annotated[
    float,
    PlainValidator(
        lambda value: _seconds(value, rates=True),
        json_schema_input_type=Annotated[str, Field(pattern=_PERIOD_PATTERN)],
    ),
]


# ---- types of values on the wire -----------------------------------------------------------------


@dataclass(frozen=True)
class WireType:
    """``order`` is None where the word names none: then the file's ``byte_order`` holds."""

    word: str
    kind: FieldKind
    size: int  # bytes; 0 for text, bytes and padding, and for numbers of other than whole bytes
    order: ByteOrder | None = None
    bits: int = 0  # of a number of other than whole bytes
    coding: Coding = UNSIGNED  # of kind INTEGER

    @property
    def is_integer(self) -> bool:
        return self.kind == FieldKind.INTEGER

    @property
    def is_unsigned(self) -> bool:
        return self.is_integer and self.coding == UNSIGNED

    @property
    def is_signed(self) -> bool:
        return self.is_integer and self.coding.is_signed

    @property
    def width(self) -> int:
        """Bits of one number."""
        return self.bits or 8 * self.size


def both_orders(word: str, kind: FieldKind, size: int, coding: Coding = UNSIGNED) -> dict[str, WireType]:
    """Return a number's type by its word, followed by a byte order if it has several bytes."""
    orders = {"": None, "le": ByteOrder.LITTLE, "be": ByteOrder.BIG} if size > 1 else {"": None}
    return {
        word + ending: WireType(word + ending, kind, size, order, coding=coding) for ending, order in orders.items()
    }


_PART_TYPES = {
    word: wire_type
    for size in (1, 2, 3, 4)
    for word, wire_type in both_orders(f"u{8 * size}", FieldKind.INTEGER, size).items()
}
# Other languages' words for the same things, so that the advice is right at once.
FOREIGN_TYPES = {
    **{f"{p}int{8 * n}{s}": f"{p or 'i'}{8 * n}" for p in ("u", "") for n in range(1, 9) for s in ("", "_t")},
    "float": "f32",
    "float32": "f32",
    "double": "f64",
    "float64": "f64",
    "byte": "u8",
    "char": "u8",
    "int": "i32",
    "uint": "u32",
    "boolean": "bool",
    "string": "text",
    "str": "text",
}


def _part_type(value: object) -> WireType:
    plain_words = [word for word in _PART_TYPES if not word.endswith(("le", "be"))]
    listing = f"possible: {', '.join(plain_words)}; add `le` or `be` for the byte order"
    if not isinstance(value, str):
        raise wrong(f"{describe(value)} is not a type; {listing}")
    if value in _PART_TYPES:
        return _PART_TYPES[value]
    if value[:-2] in _PART_TYPES and value.endswith(("le", "be")):
        raise wrong(f"{quoted(value)} has no byte order to choose; write `{value[:-2]}`")
    known = FOREIGN_TYPES.get(value.lower())
    if known in _PART_TYPES:
        raise wrong(f"{quoted(value)} is not a type here; write `{known}`")
    raise wrong(f"{quoted(value)} is not a type here; {listing}")


PartType = Annotated[
    WireType,
    PlainValidator(_part_type, json_schema_input_type=Literal[tuple(_PART_TYPES)]),
]
