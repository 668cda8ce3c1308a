"""A protocol's fingerprint: equal on two ends exactly when they read the same bytes as the same values.

In it: stuffing and delimiter; of every part its kind, size, byte order and bytes, what a length counts, the
payload's rule, a check's parameters and range; of every message its name, id, sender and the layout of its
fields (name, kind, size, byte order, elements, scale, offset, enum, flags, bits and their order, what counts them, and
the same of the fields in them); which messages serve as which service.

Not in it, for it does not change what bytes mean: the protocol's name, descriptions, units (a matter of
display), the order of the file's keys, names of parts, of check algorithms, of types and of padding, line
settings, `max_payload`, `unknown`, `idle`, ranges, defaults, schedule, replies, log lines, deadlines, emergency stop.
"""

from __future__ import annotations

import hashlib
import json
from typing import Any

from wirebond.protocol.model import Field, FieldKind, Message, Part, PartKind, Protocol

_CANONICAL_FORM = 1  # of the form itself: raised when it changes, so that old and new hashes do not meet by chance


def protocol_hash(protocol: Protocol) -> int:
    """The first 64 bits of SHA-256 over the canonical form, most significant byte first."""
    text = json.dumps(_form(protocol), sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big")


def _form(protocol: Protocol) -> dict[str, Any]:
    frame = protocol.frame
    return {
        "form": _CANONICAL_FORM,
        "delimiter": _mark(frame.delimiter),
        "opening": _mark(frame.opening),
        "escapes": None if frame.escapes is None else [*vars(frame.escapes).values()],
        "silence": frame.ends_by_silence,
        "stuffing": frame.stuffing,
        "parts": [_part(part) for part in frame.parts],
        "messages": {message.name: _message(message) for message in protocol.messages},
        "services": {service.name: dict(service.messages) for service in protocol.services},
    }


def _mark(delimiter: bytes | None) -> int | str | None:
    """One byte is a number, as it was before there were two."""
    if delimiter is None:
        return None
    return delimiter[0] if len(delimiter) == 1 else delimiter.hex()


def _part(part: Part) -> dict[str, Any]:
    form: dict[str, Any] = {"size": part.size}
    if part.is_plain:
        form["plain"] = True
    if part.condition is not None:
        form["when"] = [part.condition.field, part.condition.bit, part.condition.magic.hex()]
    if part.alternatives or part.by_sender:
        form["magics"] = [value.hex() for value in part.alternatives]
        form["by_sender"] = [[end.value, value.hex()] for end, value in part.by_sender]
    if part.bits:
        form["bits"] = [[run.name, run.role.value, run.shift, run.width, run.value] for run in part.bits]
    if part.kind in (PartKind.MAGIC, PartKind.CONSTANT, PartKind.TAIL):
        return {**form, "kind": "constant", "value": part.value.hex()}
    form["kind"] = part.kind.value
    if part.size > 1 and part.kind != PartKind.RESERVED:
        form["order"] = part.order.value
    if part.kind == PartKind.LENGTH:
        form |= {"counts": part.counts.value, "offset": part.length_offset, "unit": part.length_unit}
    elif part.kind == PartKind.PAYLOAD:
        form |= {"payload": part.payload.value, "fixed": part.fixed_payload, "trims": part.trims_zeros}
    elif part.algorithm is not None:
        a = part.algorithm
        form["algorithm"] = [a.kind, a.width, a.poly, a.init, a.refin, a.refout, a.xorout, a.modulus, a.negate]
        form |= {"first": part.first, "last": part.last, "shift": part.shift}
        form |= {"seeded": part.seeded, "as_hex": part.as_hex}
    return form


def _message(message: Message) -> dict[str, Any]:
    return {
        "id": message.id,
        "sender": message.sender.value,
        "seed": message.seed,
        "fields": [_field(field) for field in message.fields],
    }


def _field(field: Field) -> dict[str, Any]:
    if field.kind == FieldKind.PADDING:
        return {"kind": field.kind.value, "size": field.size, "bits": field.bits}
    form: dict[str, Any] = {"name": field.name, "kind": field.kind.value, "size": field.size}
    if field.size > 1 and not field.is_string:
        form["order"] = field.order.value
    form |= {
        "count": field.count,
        "max": field.max_size,
        "scale": [field.scale.numerator, field.scale.denominator],
        "offset": [field.offset.numerator, field.offset.denominator],
        "enum": dict(field.enum),
        "flags": dict(field.flags),
    }
    # What was added after the first release stands here only where it is used, so that other hashes stay.
    added = {
        "bits": field.bits,
        "sign_magnitude": field.sign_magnitude,
        "packed": field.packed and field.packed.value,
        "first": field.first.value if field.kind == FieldKind.BITS else None,
        "fields": [_field(member) for member in field.fields],
        "max_count": field.max_count,
        "counted_by": field.counted_by,
    }
    return form | {key: value for key, value in added.items() if value}
