"""What a reply repeats of its request."""

from __future__ import annotations

from wirebond.protocol.model import Field, FieldKind, Message


def carried_back(reply: Message, request: Message) -> list[str]:
    """Fields that both have, of one kind; not what counts or is counted, which only fits together."""
    asked = {f.name: f for f in request.fields if f.kind != FieldKind.PADDING}
    return [
        f.name
        for f in reply.fields
        if f.name in asked and not f.is_count and not f.counted_by and _shape(f) == _shape(asked[f.name])
    ]


def _shape(f: Field) -> tuple[object, ...]:
    return f.kind, f.count, f.is_list, f.is_scaled, f.enum, f.flags, f.fields
