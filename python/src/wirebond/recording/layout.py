"""The layout of a recording in an MCAP file: names of channels, metadata and the attached protocol file. Reads and
writes nothing.

The channels ``rx`` and ``tx`` have a message for each read and each write of the port: its bytes, the log time when it
was done, and the publish time when a read began. ``events`` has JSON. A closed recording also has a channel of JSON for
each message of the protocol, ``mcu/odometry`` or ``host/velocity``. Times are nanoseconds since 1970.
"""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Mapping
from typing import Any

import msgspec

from wirebond.codec import Codec, Message
from wirebond.protocol.model import Field

VERSION = "1"
ENDING = ".mcap"  #: of the file's name
PROFILE = "wirebond"
METADATA = "wirebond"
CHECKSUM = "crc32"  #: key in the metadata of a closed recording
CAPTURE = "capture"  #: key in the metadata of a raw capture: the baud rate that its times are of
NOTE = "note"  #: name of the metadata that hold a person's text about the recording
PROTOCOL_FILE = "protocol.yaml"
MEDIA_TYPE = "application/yaml"
RECEIVED, SENT, EVENTS = "rx", "tx", "events"
RAW = "raw"  #: encoding of the bytes as they were on the wire
DIRECTIONS = {RECEIVED: "received", SENT: "sent"}

_encode = msgspec.json.Encoder().encode
_SIMPLE = {bool, int, float, str, type(None)}  # types without parts
_EVENT_SCHEMA = {
    "title": "wirebond.Event",
    "type": "object",
    "properties": {"t": {"type": "number", "description": "seconds since the start"}, "kind": {"type": "string"}},
    "required": ["t", "kind"],
}
_JSON_TYPES = {bool: "boolean", int: "integer", float: "number", str: "string", bytes: "string", dict: "object"}


def with_checksum(values: Mapping[str, str]) -> dict[str, str]:
    """Return the metadata of a recording with a checksum: MCAP has none for metadata."""
    plain = {key: value for key, value in values.items() if key != CHECKSUM}
    return {**plain, CHECKSUM: _checksum(plain)}


def is_intact(values: Mapping[str, str]) -> bool:
    """Return whether the checksum is right; metadata of a file that was not closed have none."""
    plain = {key: value for key, value in values.items() if key != CHECKSUM}
    return values.get(CHECKSUM, "") in ("", _checksum(plain))


def _checksum(values: Mapping[str, str]) -> str:
    return f"{zlib.crc32(_encode(sorted(values.items()))):08x}"


def event_schema() -> bytes:
    return json.dumps(_EVENT_SCHEMA).encode()


def topic_of(message: Message, sender: str) -> str:
    """Return the channel of a decoded message; ``sender``: of its bytes."""
    return f"{sender}/{message.name}"


def message_schema(codec: Codec, name: str) -> bytes:
    """Return the JSON Schema of a message's decoded values."""
    model = next((m for m in codec.model.messages if m.name == name), None)
    properties = {} if model is None else {f.name: _schema_of(f) for f in model.fields if f.has_value}
    return json.dumps({"title": name, "type": "object", "properties": properties}, ensure_ascii=False).encode()


def _schema_of(field: Field) -> dict[str, Any]:
    described: dict[str, Any]
    if field.enum:
        described = {"type": ["string", "integer"]}
    elif field.flags:
        described = {"type": "array", "items": {"type": ["string", "integer"]}}
    else:
        assert field.value_type is not None, "padding is not described"
        described = {"type": _JSON_TYPES[field.value_type]}
    if field.unit:
        described["description"] = field.unit
    if field.count is not None or field.max_count:
        described = {"type": "array", "items": described}
    return described


def message_json(message: Message, has_header: bool) -> bytes:
    """Return a decoded message as its channel has it: its fields; ``header`` where its frame has fields; ``stamp.t``
    and ``stamp.error`` where the MCU's time stamp is known in the recording's time."""
    values: Mapping[str, Any] = message.fields
    if message.name == "unknown":
        values = {"id": message.id, "payload": message.payload}
    if has_header and (header := message.header):
        values = {**values, "header": header}
    if (stamp := message.stamp) is not None:
        values = {**values, "stamp.t": stamp, "stamp.error": message.stamp_error}
    return to_json(values)


def to_json(values: Mapping[str, Any]) -> bytes:
    """Write compact JSON. Numbers that JSON lacks become null, and bytes hexadecimal."""
    try:
        return _encode(values if _SIMPLE.issuperset(map(type, values.values())) else _without_bytes(values))
    except (OverflowError, UnicodeEncodeError):  # a number of more than 64 bits, half a surrogate pair
        return json.dumps(_without_bytes(values), separators=(",", ":")).encode()


def _without_bytes(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _without_bytes(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_without_bytes(entry) for entry in value]
    if isinstance(value, bytes | bytearray | memoryview):
        return bytes(value).hex(" ")
    return None if isinstance(value, float) and not math.isfinite(value) else value
