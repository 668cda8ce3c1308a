"""A protocol as data that forms are made of: every message and field with what bounds it. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from wirebond.as_json import plain
from wirebond.codec import Codec
from wirebond.protocol.controlled import is_controlled
from wirebond.protocol.model import (
    Deadline,
    End,
    Field,
    GivenMessage,
    HeaderField,
    Message,
    Protocol,
    Service,
)
from wirebond.protocol.model.forms import header_fields
from wirebond.recording.history.history import History


def protocol_form(codec: Codec, history: History, path: str, port: str, baud: int) -> dict[str, Any]:
    """Return the protocol for JSON. ``history`` gives the names for plots."""
    model = codec.model
    line = model.link
    form: dict[str, Any] = plain(
        {
            "name": model.name,
            "hash": f"{codec.hash:016x}",
            "description": model.description,
            "text": model.text,
            "path": path,
            "link": {
                "baud": baud,
                "data_bits": line.data_bits,
                "parity": line.parity,
                "stop_bits": line.stop_bits,
                "bits_per_byte": line.bits_per_byte,
                "port": port,
            },
            "messages": [_message(model, history, message) for message in model.messages],
            "header": [_header(field) for field in header_fields(model.format.parts)],
            "emergency_stop": [_given(stop) for stop in model.emergency_stop],
            "deadlines": [_deadline(deadline) for deadline in model.deadlines],
            "services": [{"name": service.name, "messages": dict(service.messages)} for service in model.services],
            "parameters": _parameters(model, history),
        }
    )
    return form


def _deadline(deadline: Deadline) -> dict[str, Any]:
    by = deadline.recover_by
    return {**asdict(deadline), "recover_by": None if by is None else _given(by)}


def _given(message: GivenMessage) -> dict[str, Any]:
    return {"message": message.message, "fields": message.fields, "header": dict(message.header)}


def _message(model: Protocol, history: History, message: Message) -> dict[str, Any]:
    end = End.HOST if message.sender == End.HOST else End.MCU
    prefix = f"{message.name}."
    return {
        "name": message.name,
        "id": message.id,
        "sender": message.sender,
        "every": message.every,
        "reply": message.reply,
        "is_controlled": is_controlled(model, message),
        "queue": message.queue,
        "description": message.description,
        "log": message.log,
        "bytes": model.max_wire_bytes(message.max_payload),
        "fields": _fields(message.fields, set(history.columns(end, message.name)), prefix, ("",)),
    }


def _fields(fields: tuple[Field, ...], columns: set[str], prefix: str, within: tuple[str, ...]) -> list[dict[str, Any]]:
    """Describe the fields. ``within``: the names of the structs around them, of a group one for each element:
    ``("joints[0].", …)``. A number whose bits are shared is a struct, too."""
    out = []
    for field in fields:
        if not field.has_value:
            continue
        form = field_form(field)
        names = [f"{around}{field.name}" for around in within]
        count = field.count or field.max_count or 0
        elements = tuple(f"{name}[{i}]" for name in names for i in range(count))
        form["columns"] = [prefix + column for column in (*names, *elements) if column in columns]
        if field.fields:
            is_group = field.count is not None or field.is_list
            inner = elements if is_group else names
            form["fields"] = _fields(field.fields, columns, prefix, tuple(f"{name}." for name in inner))
        out.append(form)
    return out


def field_form(field: Field) -> dict[str, Any]:
    """Describe one field, without its columns."""
    values = field.enum or field.flags
    scale = abs(float(field.scale))
    return {
        "name": field.name,
        "kind": _kind(field),
        "is_integer": field.is_integer and not field.is_scaled,
        "unit": field.unit,
        "min": _bound(field, field.minimum, least=True),
        "max": _bound(field, field.maximum, least=False),
        "step": scale if field.is_integer else None,
        "on_range": field.on_range,
        "default": field.default,
        "values": dict(values) if values else None,
        "description": field.description,
        "count": field.count,
        "max_count": field.max_count or None,
        "size": field.room or None if field.is_string else None,
        "is_count": field.is_count,
        "is_time": field.clock is not None,
    }


def _kind(field: Field) -> str:
    if field.enum:
        return "enum"
    if field.flags:
        return "flags"
    if field.fields:
        return "struct"
    return "number" if field.is_number else field.kind.value


def _bound(field: Field, given: float | None, *, least: bool) -> float | None:
    """Return the bound in the file, else the one of the wire type."""
    if given is not None or not field.is_integer:
        return given
    ends = [wire * field.scale + field.offset for wire in field.whole_limits]
    value = min(ends) if least else max(ends)
    return int(value) if value.denominator == 1 else float(value)


def _header(field: HeaderField) -> dict[str, Any]:
    form = field_form(field.value)
    form["default"] = field.host_default
    form["is_sequence"] = field.is_sequence
    form["address"] = field.address
    return form


def _parameters(model: Protocol, history: History) -> dict[str, Any] | None:
    service: Service | None = model.service("parameter")
    if service is None:
        return None
    roles: Mapping[str, str] = dict(service.messages)
    value = model.message(roles["value"])
    read, write = model.message(roles["read"]), model.message(roles["set"])
    index = next(f for f in write.fields if f.name == "index")
    names = dict(index.enum) or dict(next(f for f in read.fields if f.name == "index").enum)
    of_value = next(f for f in write.fields if f.name == "value")
    columns = set(history.columns(End.MCU, value.name))
    form = field_form(of_value)
    form["columns"] = [f"{value.name}.value"] if "value" in columns else []
    return {"names": names, "field": form, **{role: roles[role] for role in ("read", "set", "value")}}
