"""Turning ``field=value`` words and hex text of a command line into values, with sentences for what is wrong."""

from __future__ import annotations

import json
import math
import re
from functools import partial
from typing import Any

from wirebond.arguments import hex_bytes
from wirebond.errors import MessageError, UsageError
from wirebond.protocol.model import End, Field, Message, Protocol
from wirebond.protocol.model.forms import header_fields
from wirebond.protocol.planning import plan_for
from wirebond.visible import visible_json

_TRUE = {"true", "yes", "on", "1"}
_FALSE = {"false", "no", "off", "0"}
# As Python reads them, but without its underscores and the digits of other scripts; int() takes 4300 digits at most.
_WHOLE = re.compile(r"[+-]?([0-9]{1,4000}|0[xX][0-9a-fA-F]{1,64}|0[oO][0-7]{1,64}|0[bB][01]{1,64})")
_DECIMAL = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?|[+-]?(inf|infinity|nan)", re.IGNORECASE)


def parse_assignments(message: Message, words: list[str]) -> dict[str, Any]:
    """Read ``["linear=0.5", "angular=0"]`` as values for ``encode``.

    A field within a struct is given as ``position.x=1``, or the whole struct as JSON: ``position={"x": 1}``.
    """
    values: dict[str, Any] = {}
    for word in words:
        path, equals, text = word.partition("=")
        if not equals:
            raise UsageError(f"'{word}' is not an assignment; write field=value, for example {_example(message, word)}")
        *structs, name = path.split(".")
        owner, fields, inner = message.name, message.fields, values
        for struct in structs:
            described = _field_of(fields, struct, owner)
            if not described.fields or described.count is not None or described.is_list:
                raise UsageError(f"{struct} has no fields of its own to give one by one; write {struct}=value")
            owner, fields, inner = f"{owner}.{struct}", described.fields, inner.setdefault(struct, {})
            if not isinstance(inner, dict):
                raise UsageError(f"{struct} is given twice")
        described = _field_of(fields, name, owner)
        if name in inner:
            raise UsageError(f"{path} is given twice")
        inner[name] = _parse(described, text)
    return values


def parse_header(protocol: Protocol, words: list[str]) -> dict[str, Any]:
    """Read ``["servo=3", "kind=ping"]`` as header values for ``encode``."""
    fields = tuple(field.value for field in header_fields(protocol.format.parts))
    if words and not fields:
        raise UsageError(f"frames of {protocol.name} have no header fields; remove --header")
    return parse_assignments(Message("header", 0, End.BOTH, fields), words)


def parse_addresses(protocol: Protocol, words: list[str]) -> tuple[int | str, ...]:
    """Read the addresses of a virtual MCU, as the file's `address` field takes them."""
    plan = plan_for(protocol, End.HOST)
    place = plan.address
    if not words:
        return ()
    if place is None:
        raise UsageError(f"frames of {protocol.name} carry no address (`address:`); remove --address")
    field = plan.header[place].value
    values = [_parse_one(field, word) for word in words]
    for value in values:
        known = dict(field.enum)
        if isinstance(value, float) or (isinstance(value, str) and value not in known):
            raise UsageError(f"--address is {value}; expected a whole number, or a name of `{field.name}`")
        if isinstance(value, int) and not 0 <= value < 1 << field.width:
            raise UsageError(f"--address is {value}; `{field.name}` takes 0 to {(1 << field.width) - 1}")
        if value in plan.header[place].broadcast:
            raise UsageError(f"--address is {value}, the broadcast of `{field.name}`; give the address of one MCU")
    return tuple(values)


def _field_of(fields: tuple[Field, ...], name: str, owner: str) -> Field:
    values = {f.name: f for f in fields if f.has_value}
    if name not in values:
        raise MessageError(f"{owner} has no field '{name}'; it has {', '.join(values) or 'no fields'}")
    return values[name]


def _example(message: Message, word: str) -> str:
    """Return an assignment to the field that ``word`` names, or to the first."""
    fields = [f for f in message.fields if f.has_value]
    first = next((f for f in fields if f.name == word), fields[0] if fields else None)
    if first is None:
        return f"nothing: {message.name} has no fields"
    single = bool(first.fields) and first.count is None and not first.is_list
    return f"{first.name}.{first.fields[0].name}=0" if single else f"{first.name}=0"


def _parse(described: Field, text: str) -> Any:
    if described.value_type is str:
        return text
    if described.value_type is bytes:
        return hex_bytes(text)
    if described.fields:
        return _from_json(described, text)
    is_array = described.count is not None or described.is_list
    if described.flags and not is_array:
        return [_number_or_name(word) for word in _items(described, text)]
    if is_array and text.lstrip().startswith(("[[", '["')):
        return _from_json(described, text)
    if is_array:
        return [_parse_one(described, item) for item in _items(described, text)]
    return _parse_one(described, text)


def _from_json(described: Field, text: str) -> Any:
    try:
        unique = partial(_unique, described)
        return _with_bytes(described, json.loads(text, object_pairs_hook=unique, parse_int=_number_or_name))
    except (json.JSONDecodeError, RecursionError) as error:
        reason = error.msg if isinstance(error, json.JSONDecodeError) else "nested too deep"
        names = ", ".join(f'"{f.name}": 0' for f in described.fields[:2])
        one = f"{{{names}}}" if described.fields else "0"
        example = one if described.count is None and not described.is_list else f"[{one}]"
        raise UsageError(
            f"{described.name} is '{text[:60]}', which is not JSON ({reason}); write '{described.name}={example}'"
        ) from error


def _unique(described: Field, pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return a mapping of JSON, in which no name appears twice."""
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise UsageError(f"{described.name} has '{twice}' twice in one JSON object; give it once")
    return found


def _with_bytes(described: Field, value: Any) -> Any:
    """Convert texts of hex digits to bytes, which JSON does not have."""
    if isinstance(value, list):
        return [_with_bytes(described, item) for item in value]
    if isinstance(value, dict):
        fields = {f.name: f for f in described.fields}
        return {name: _with_bytes(fields[name], item) if name in fields else item for name, item in value.items()}
    return hex_bytes(value) if described.value_type is bytes and isinstance(value, str) else value


def _items(described: Field, text: str) -> list[str]:
    """Split ``1,2`` and ``[1, 2]``; an empty text is an empty list."""
    listed = text.strip()
    if listed.startswith("[") != listed.endswith("]"):
        raise UsageError(f"{described.name} is '{text[:60]}'; write '{described.name}=[1, 2]', or without brackets")
    items = [item.strip() for item in listed.removeprefix("[").removesuffix("]").split(",")]
    if items == [""]:
        return []
    if "" in items:
        raise UsageError(f"{described.name} is '{text[:60]}'; a value is missing next to a comma")
    return items


def _parse_one(described: Field, text: str) -> Any:
    if described.value_type is bool:
        word = text.strip().lower()
        if word in _TRUE | _FALSE:
            return word in _TRUE
        raise MessageError(f"{described.name} is '{text}'; expected true or false")
    value = _number_or_name(text)
    if isinstance(value, str) and not described.enum:
        unit = f" in {described.unit}" if described.unit else ""
        raise MessageError(f"{described.name} is '{text}'; expected a number{unit}, such as 12 or 0.5")
    return value


def _number_or_name(text: str) -> int | float | str:
    text = text.strip()
    if _WHOLE.fullmatch(text):
        return int(text, 10 if text.lstrip("+-").isdigit() else 0)
    return float(text) if _DECIMAL.fullmatch(text) else text


def hex_of(data: bytes) -> str:
    """Write bytes as specifications do: ``AA 55 01``."""
    return data.hex(" ").upper()


def to_json(value: Any) -> str:
    """Write compact JSON. Bytes become hex; numbers that JSON lacks (NaN, infinities) become null. Characters that
    could command a terminal are escaped."""
    return visible_json(json.dumps(_plain(value), ensure_ascii=False, separators=(", ", ": ")))


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
