"""Turning ``field=value`` words and hex text of a command line into values, with sentences for what is wrong."""

from __future__ import annotations

import json
import math
import re
from typing import Any

from wirebond.errors import MessageError, UsageError
from wirebond.protocol.model import Field, FieldKind, Message

_TRUE = {"true", "yes", "on", "1"}
_FALSE = {"false", "no", "off", "0"}


def parse_assignments(message: Message, words: list[str]) -> dict[str, Any]:
    """``["linear=0.5", "angular=0"]`` to values that ``encode`` takes."""
    fields = {f.name: f for f in message.fields}
    values: dict[str, Any] = {}
    for word in words:
        name, equals, text = word.partition("=")
        if not equals:
            raise UsageError(f"'{word}' is no assignment; write field=value, for example {_example(message)}")
        if name not in fields:
            known = ", ".join(fields) or "no fields"
            raise MessageError(f"{message.name} has no field '{name}'; it has {known}")
        if name in values:
            raise UsageError(f"{name} is given twice")
        values[name] = _parse(fields[name], text)
    return values


def parse_hex(text: str) -> bytes:
    """``AA 55 01``, ``aa5501``, ``0xAA,0x55``, ``AA:55``: any of these."""
    digits = re.sub(r"0[xX]|[\s:,;_-]", "", text)
    wrong = re.search(r"[^0-9a-fA-F]", digits)
    if wrong:
        raise UsageError(f"'{wrong.group()}' is no hex digit; write bytes as AA 55 01 or aa5501")
    if len(digits) % 2:
        raise UsageError(f"{len(digits)} hex digits are no whole number of bytes; write two digits a byte")
    return bytes.fromhex(digits)


def _example(message: Message) -> str:
    return f"{message.fields[0].name}=0" if message.fields else f"nothing: {message.name} has no fields"


def _parse(described: Field, text: str) -> Any:
    if described.kind == FieldKind.TEXT:
        return text
    if described.kind == FieldKind.BYTES:
        return parse_hex(text)
    if described.flags:
        return [_number_or_name(word) for word in _items(text)]
    if described.count is not None:
        return [_parse_one(described, item) for item in _items(text)]
    return _parse_one(described, text)


def _items(text: str) -> list[str]:
    return [item.strip() for item in text.strip().removeprefix("[").removesuffix("]").split(",") if item.strip()]


def _parse_one(described: Field, text: str) -> Any:
    if described.kind == FieldKind.BOOL:
        word = text.strip().lower()
        if word in _TRUE | _FALSE:
            return word in _TRUE
        raise MessageError(f"{described.name} is '{text}'; expected true or false")
    value = _number_or_name(text)
    if isinstance(value, str) and not described.enum:
        unit = f" in {described.unit}" if described.unit else ""
        raise MessageError(f"{described.name} is '{text}'; expected a number{unit}")
    return value


def _number_or_name(text: str) -> int | float | str:
    text = text.strip()
    for convert in (lambda t: int(t, 0), int, float):
        try:
            return convert(text)
        except ValueError:
            continue
    return text


def hex_of(data: bytes) -> str:
    """As documents write frames: ``AA 55 01``."""
    return data.hex(" ").upper()


def to_json(value: Any) -> str:
    """Compact JSON. Bytes become hex; numbers that JSON has not (NaN, infinities) become null."""
    return json.dumps(_plain(value), ensure_ascii=False, separators=(", ", ": "))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, bytes):
        return hex_of(value)
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
