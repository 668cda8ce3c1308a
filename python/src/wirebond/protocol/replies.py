"""Finds the fields that a reply repeats from its request."""

from __future__ import annotations

from wirebond.protocol.model import Field, Message


def carried_back(reply: Message, request: Message) -> list[str]:
    """Return fields that both have, of one kind; without counts and counted fields, which only fit together."""
    asked = {f.name: f for f in request.fields if f.has_value}
    return [
        f.name
        for f in reply.fields
        if f.name in asked and not f.is_count and not f.counted_by and _shape(f) == _shape(asked[f.name])
    ]


def identifying(reply: Message, request: Message) -> list[str]:
    """Return those of these fields by which a reply identifies its request: integers, names and flags. A measured value
    may come back changed, such as a set point that the peer clamped."""
    asked = {f.name: f for f in request.fields}
    return [name for name in carried_back(reply, request) if _names_something(asked[name])]


def _names_something(f: Field) -> bool:
    return f.value_type in (int, bool, str)


def _shape(f: Field) -> tuple[object, ...]:
    return f.kind, f.coding, f.count, f.is_list, f.is_scaled, f.enum, f.flags, f.fields
