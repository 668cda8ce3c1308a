"""Messages of the protocol as JSON text, for topics of std_msgs/String."""

from __future__ import annotations

import json
from typing import Any

from wirebond.as_json import plain
from wirebond.codec import Message
from wirebond.protocol.json_values import from_json_values
from wirebond.protocol.model import Message as MessageModel


def to_json(message: Message) -> str:
    """Write its fields, with ``header`` beside them if the frame has fields of its own. Bytes are hexadecimal, and
    numbers that JSON lacks are null."""
    values = dict(message.fields)
    if message.header and "header" not in values:
        values["header"] = dict(message.header)
    return json.dumps(plain(values), ensure_ascii=False)


def from_json(text: str, message: MessageModel) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """Return the values of this message, and those of its frame.

    :raises ValueError: it is not a JSON object, or bytes are not hexadecimal digits.
    """
    try:
        values = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"this is not JSON ({error})") from None
    if not isinstance(values, dict):
        raise ValueError('a JSON object is expected, such as {"speed": 0.5}')
    has_own = any(field.name == "header" for field in message.fields)
    header = None if has_own else values.pop("header", None)
    if header is not None and not isinstance(header, dict):
        raise ValueError("`header` is not a JSON object")
    return from_json_values(message.fields, values), header
