"""A protocol and its plans as the tables that the engine reads, in bytes (MessagePack). Pure.

The engine needs no Python to read them (`engine/src/protocol.cpp`, `engine/src/field_table.cpp`): it runs in a browser,
too. What it does not need of the model is not in them.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any, assert_never

import msgspec

from wirebond.protocol.apart import ends_look_alike
from wirebond.protocol.model import End, Field, Message, Protocol
from wirebond.protocol.model.layout import (
    Array,
    BitMember,
    Bits,
    Characters,
    Constant,
    Group,
    List,
    Number,
    Padding,
    Step,
)
from wirebond.protocol.payload_rules import payload_rules
from wirebond.protocol.plan import Form, Plan
from wirebond.protocol.planning import ids_collide, plan_for

Table = dict[str, Any]


def protocol_table(model: Protocol) -> bytes:
    """Return the messages with their layouts."""
    return msgspec.msgpack.encode({"name": model.name, "messages": [_message(message) for message in model.messages]})


def format_table(plan: Plan) -> bytes:
    """Return the frame format of one end."""
    table = _members(plan)
    table["forms"] = [_form(form) for form in plan.forms]
    table["header"] = [_field(field.value) for field in plan.header]
    table["algorithms"] = [{**_members(one), "kept": one.kept} for one in plan.algorithms]
    return msgspec.msgpack.encode(table)


def session_table(model: Protocol, adapter_latency: float = 0.0) -> bytes:
    """Return all tables of a protocol, for the engine in a browser (`engine/wasm/module.cpp`).

    :param adapter_latency: seconds that the port may hold bytes back: so much longer it waits for the rest of a frame.

    `either` is the format of frames of both ends; None if they cannot be distinguished.
    """
    is_told = not ids_collide(model) and not ends_look_alike(model.format.parts)
    table = {
        "protocol": protocol_table(model),
        "mcu": format_table(plan_for(model, End.MCU)),
        "host": format_table(plan_for(model, End.HOST)),
        "either": format_table(plan_for(model, None)) if is_told else None,
        "idle_seconds": float(model.idle_seconds) + adapter_latency,
    }
    return msgspec.msgpack.encode(table)


def _members(value: Any) -> Table:
    """Return the members of a dataclass, as they are: those that are dataclasses become tables when they are packed."""
    return {member.name: getattr(value, member.name) for member in fields(value)}


def _form(form: Form) -> Table:
    table = _members(form)
    del table["choices"]  # the engine chooses by `exclusions`
    return table


def _message(message: Message) -> Table:
    return {
        "name": message.name,
        "sender": message.sender,
        "min_payload": message.min_payload,
        "max_payload": message.max_payload,
        "steps": _steps(message.layout),
        "constants": payload_rules(message).constants,
    }


def _field(field: Field) -> Table:
    """Return the meaning of a field, and the bytes of one number of it; not how often it occurs."""
    table: Table = {
        "name": field.name,
        "kind": field.kind,
        "order": field.order,
        "is_variable": field.is_variable,
        "size": field.size,
        "width": field.width,
        "factors": [float(factor) for factor in field.double_factors] if field.is_scaled else None,
        "unit": field.unit,
        "range": _range(field),
        "default": field.default,
        "enum": field.enum,
        "flags": field.flags,
        "digits": None if field.digits is None else (field.digits.base, field.digits.decimals),
    }
    if field.is_integer:
        least, greatest = field.whole_limits
        table |= {"coding": field.coding.cpp, "is_signed": field.coding.is_signed, "least": least, "greatest": greatest}
    return table


def _range(field: Field) -> tuple[float, ...] | None:
    """Return the bounds, by how much a double may exceed them, and the bounds as the wire carries them."""
    accepted = field.accepted_limits
    if field.minimum is None or field.maximum is None or accepted is None:
        return None
    return (
        float(field.minimum),
        float(field.maximum),
        float(field.double_slack),
        float(accepted[0]),
        float(accepted[1]),
    )


def _steps(steps: tuple[Step, ...]) -> list[Table]:
    return [
        {
            "step": type(step).__name__,
            "field": _field(step.field),
            "at": step.at,
            "stride": step.field.element_min_bytes,
            **_own(step),
        }
        for step in steps
        if step.field.has_value
    ]


def _own(step: Step) -> Table:
    """Return the entries that only a step of this kind has."""
    field = step.field
    match step:
        case Number():
            return {"slot": step.slot}
        case Array():
            return _times(field)
        case Bits():
            return {"size": field.size, "members": [_member(one) for one in step.members if one.field.has_value]}
        case Characters():
            sizes = {"size": field.size, "max_size": field.max_size}
            return {**sizes, "ends_with": field.ends_with, "excludes": field.excludes, "told": step.told}
        case Group():
            return {**_times(field), "steps": _steps(step.steps)}
        case List():
            return {"max_count": field.max_count, "steps": _steps(step.steps), "told": step.told}
        case Padding() | Constant():
            return {}  # they have no value: a receiver's rules have the constants
        case _:
            assert_never(step)


def _times(field: Field) -> Table:
    return {"count": field.count, "packed": field.packed}


def _member(member: BitMember) -> Table:
    return {"field": _field(member.field), "low": member.low, "pieces": member.pieces, "slot": member.slot}
