"""The kinds of single values in the `frame` section alone: magics, the names of checks, and ranges."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Field, PlainValidator

from wirebond.protocol import algorithms, names
from wirebond.protocol.problems import quoted
from wirebond.protocol.text.scalars import bytes_schema, describe, hex_bytes, wrong
from wirebond.protocol.text.yaml_tree import Number


def _validate_name(value: object) -> str:
    if isinstance(value, str) and (value in algorithms.OWN_KINDS or algorithms.find(value) is not None):
        return value
    if isinstance(value, str):
        raise wrong(f"{quoted(value)} is not a check that is known; {algorithms.advice_for_unknown(value)}")
    raise wrong(f"{describe(value)} is not a check; write its name, such as crc-16/mcrf4xx, xor8 or sum16")


MAX_RANGES = 4  # of a check; as `max_check_ranges` of core/include/wirebond/format.hpp


def _part_ranges(value: object) -> tuple[tuple[str, str], ...]:
    if not isinstance(value, list):
        return (_part_range(value),)
    if not 1 <= len(value) <= MAX_RANGES:
        raise wrong(f"a check covers 1 to {MAX_RANGES} ranges, not {len(value)}; join some, as in `id..payload`")
    return tuple(map(_part_range, value))


def _part_range(value: object) -> tuple[str, str]:
    ends = value.split("..") if isinstance(value, str) else []
    if len(ends) not in (1, 2) or any(names.fault(end) and not end.isalpha() for end in ends):
        raise wrong(f"{describe(value)} is not a range of parts; write `id..payload`, first and last part, or one part")
    return ends[0], ends[-1]


MOST_BYTE_RANGES = 4  # as `max_avoided` of core/include/wirebond/check.hpp


def _byte_ranges(value: object) -> tuple[tuple[int, int], ...]:
    listed = value if isinstance(value, list) else [value]
    if not 1 <= len(listed) <= MOST_BYTE_RANGES:
        raise wrong(
            f"this list has {len(listed)} entries; write 1 to {MOST_BYTE_RANGES} values or ranges, such as 0..0x1F"
        )
    return tuple(map(_byte_range, listed))


def _byte_range(value: object) -> tuple[int, int]:
    text = value.text if isinstance(value, Number) else value
    ends = text.split("..") if isinstance(text, str) else []
    if len(ends) not in (1, 2) or not all(re.fullmatch("0x[0-9A-Fa-f]{1,2}|[0-9]{1,3}", end) for end in ends):
        raise wrong(f"{describe(value)} is not a byte's value; write one, or a range such as 0..0x1F")
    low, high = (int(end, 16 if end.startswith("0x") else 10) for end in (ends[0], ends[-1]))
    if high > 0xFF or low > high:
        raise wrong(f"{describe(value)} is not a range of byte values; write one such as 0..0x1F")
    return low, high


@dataclass(frozen=True)
class Magic:
    """``values``: any of these; ``by_end``: others for each sender instead, one pair for each value."""

    values: tuple[bytes, ...] = ()
    by_end: tuple[tuple[str, bytes], ...] = ()


def _magics(value: object) -> tuple[bytes, ...]:
    """Read one magic, or ``{any: [...]}``."""
    one = hex_bytes(4)
    if isinstance(value, list):
        raise wrong(
            "a list is not a byte here; write `0xAA 0x55` for two bytes in a row, "
            "or `{any: [0xFE, 0xFD]}` for one of several magics"
        )
    if not isinstance(value, dict):
        return (one(value),)
    if set(value) != {"any"}:
        raise wrong("this mapping is not a magic; write bytes, or `{any: [0xFE, 0xFD]}` for one of several")
    listed = value["any"]
    if not isinstance(listed, list) or not 2 <= len(listed) <= 4:
        raise wrong("`any` lists 2 to 4 magics; write `{any: [0xFE, 0xFD]}`")
    values = tuple(one(entry) for entry in listed)
    if len(set(values)) != len(values):
        raise wrong("two of these magics are the same; remove one")
    if len({len(entry) for entry in values}) != 1:
        raise wrong("magics of one frame need the same number of bytes; pad with a `constant` part")
    return values


def _magic(value: object) -> Magic:
    if not isinstance(value, dict) or set(value) == {"any"}:
        return Magic(_magics(value))
    if set(value) != {"host", "mcu"}:
        raise wrong(
            "this mapping is not a magic; write bytes, `{any: [0xFE, 0xFD]}` or `{host: 0xAA, mcu: 0xBB}`; for `mcu` "
            "or `host` several are possible, too: `{host: 0xAA, mcu: {any: [0xBB, 0xBC]}}`"
        )
    by_end = tuple((str(end), one) for end in ("host", "mcu") for one in _magics(value[end]))
    if len({len(one) for _, one in by_end}) != 1:
        raise wrong("both directions' magics need the same number of bytes; pad with a `constant` part")
    return Magic(by_end=by_end)


_MagicBytes: Any = bytes_schema(4)


_AnyMagic: Any = dict[Literal["any"], Annotated[list[_MagicBytes], Field(min_length=2, max_length=4)]]


MagicValue = Annotated[
    Magic,
    PlainValidator(
        _magic,
        json_schema_input_type=_MagicBytes | _AnyMagic | dict[Literal["host", "mcu"], _MagicBytes | _AnyMagic],
    ),
]


_CHECK_NAMES = (*algorithms.OWN_KINDS, *algorithms.ALGORITHMS, *algorithms.ALIASES)


CheckName = Annotated[
    str,
    PlainValidator(_validate_name, json_schema_input_type=Literal[_CHECK_NAMES]),
]


_OnePartRange = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*(\.\.[A-Za-z][A-Za-z0-9_]*)?$")]


_ByteValue: Any = (
    Annotated[int, Field(ge=0, le=255)] | Annotated[str, Field(pattern=r"^[0-9xA-Fa-f]+(\.\.[0-9xA-Fa-f]+)?$")]
)


ByteRanges = Annotated[
    tuple[tuple[int, int], ...],
    PlainValidator(
        _byte_ranges,
        json_schema_input_type=_ByteValue
        | Annotated[list[_ByteValue], Field(min_length=1, max_length=MOST_BYTE_RANGES)],
    ),
]


PartRanges = Annotated[
    tuple[tuple[str, str], ...],
    PlainValidator(
        _part_ranges,
        json_schema_input_type=_OnePartRange
        | Annotated[list[_OnePartRange], Field(min_length=1, max_length=MAX_RANGES)],
    ),
]
