"""Messages of the protocol as JSON text, for topics of std_msgs/String."""

from __future__ import annotations

import json
from typing import Any

from wirebond.as_json import plain
from wirebond.codec import Message
from wirebond.protocol.model import Field, FieldKind
from wirebond.protocol.model import Message as MessageModel


def to_json(message: Message) -> str:
    """Its fields, with ``header`` beside them where the frame has fields of its own. Bytes are hexadecimal, and numbers
    that JSON does not have are null."""
    values = dict(message.fields)
    if message.header and "header" not in values:
        values["header"] = dict(message.header)
    return json.dumps(plain(values), ensure_ascii=False)


def from_json(text: str, message: MessageModel) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """The values of this message, and those of its frame.

    :raises ValueError: it is no JSON object, or bytes are no hexadecimal digits.
    """
    try:
        values = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"this is not JSON ({error})") from None
    if not isinstance(values, dict):
        raise ValueError('a JSON object is expected, such as {"speed": 0.5}')
    fields = {field.name: field for field in message.fields}
    header = values.pop("header", None) if "header" not in fields else None
    if header is not None and not isinstance(header, dict):
        raise ValueError("`header` is no JSON object")
    return {name: _from_plain(fields.get(name), value) for name, value in values.items()}, header


def _from_plain(field: Field | None, value: Any) -> Any:
    if field is None:
        return value
    if field.kind == FieldKind.BYTES and isinstance(value, str):
        try:
            return bytes.fromhex(value)
        except ValueError:
            raise ValueError(f"{field.name} is {value!r:.40}; expected bytes as hexadecimal digits") from None
    if isinstance(value, dict):
        inner = {one.name: one for one in field.fields}
        return {name: _from_plain(inner.get(name), one) for name, one in value.items()}
    return [_from_plain(field, one) for one in value] if isinstance(value, list) else value
