"""Parses what a message requires of its frames: a value, a list, a range or a mask, for an id or under `match`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import PlainValidator
from pydantic_core import PydanticCustomError

from wirebond.protocol.text.conditions import ValueText, parse_values
from wirebond.protocol.text.scalars import MAX_ID, describe, whole, wrong
from wirebond.protocol.text.yaml_tree import Number

MOST_VALUES = 32
_ADVICE = "write a value, a list (`[1, 4]`), a range (`0x10..0x1F`) or bits (`{mask: 0x80, value: 0x80}`)"


@dataclass(frozen=True)
class MatchText:
    """``value & mask in ranges``; ``mask`` is None where all bits count."""

    ranges: tuple[tuple[ValueText, ValueText], ...]
    mask: int | None = None


def _match(value: object) -> MatchText:
    if isinstance(value, dict):
        return _masked(value)
    listed = value if isinstance(value, list) else [value]
    if not 1 <= len(listed) <= MOST_VALUES:
        raise wrong(f"this list has {len(listed)} values; write 1 to {MOST_VALUES}")
    ranges: list[tuple[ValueText, ValueText]] = []
    for item in listed:
        text = item.text if isinstance(item, Number) else item
        if not isinstance(text, str):
            raise wrong(f"{describe(item)} is not a value that a frame can have; {_ADVICE}")
        try:
            ranges += parse_values(text)
        except PydanticCustomError:
            raise wrong(f"{describe(item)} is not a value that a frame can have; {_ADVICE}") from None
    return MatchText(tuple(ranges))


def _masked(value: dict[str, object]) -> MatchText:
    if set(value) != {"mask", "value"}:
        raise wrong("bits need a mask and a value, and nothing else; write `{mask: 0x80, value: 0x80}`")
    mask, wanted = (whole(0, 2**64 - 1)(value[key]) for key in ("mask", "value"))
    if mask == 0:
        raise wrong("a mask of 0 selects no bit; write the bits that count, such as `mask: 0x80`")
    if wanted & ~mask:
        raise wrong(f"0x{wanted:02X} has bits that 0x{mask:02X} does not select; a frame never has them")
    text = ValueText((str(wanted),))
    return MatchText(((text, text),), mask)


def _id(value: object) -> int | MatchText:
    return whole(0, MAX_ID)(value) if value is None or isinstance(value, Number | bool) else _match(value)


_Input: Any = int | str | list[int | str] | dict[Literal["mask", "value"], int]
MatchValue = Annotated[MatchText, PlainValidator(_match, json_schema_input_type=_Input)]
Ids = Annotated[int | MatchText, PlainValidator(_id, json_schema_input_type=_Input)]
