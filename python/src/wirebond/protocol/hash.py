"""A protocol's fingerprint: equal on two ends exactly when they read the same bytes as the same values.

In it: stuffing and delimiter; of every part its kind, size, byte order and bytes, what a length counts, the
payload's rule, a check's parameters and range, what header fields mean where they are more than unsigned numbers;
of every message its name, id, match, sender and the layout of its
fields (name, kind, size, byte order, elements, scale, offset, enum, flags, bits and their order, what counts them, and
the same of the fields in them); which messages serve as which service.

Not in it, for it does not change what bytes mean: the protocol's name, descriptions, units (a matter of
display), the order of the file's keys, names of parts, of check algorithms, of types and of padding, line
settings, `max_payload`, `unknown`, `idle`, ranges, defaults, schedule, replies, `asked_by`, `clock`, log lines,
deadlines, emergency stop.
"""

from __future__ import annotations

import hashlib
import json
from typing import Any

from wirebond.protocol.model import (
    SIGN_MAGNITUDE,
    TWOS_COMPLEMENT,
    Algorithm,
    BitRole,
    Bits,
    Comparison,
    Condition,
    End,
    Field,
    FieldKind,
    Message,
    Part,
    PartKind,
    Protocol,
    Subject,
)
from wirebond.protocol.model.forms import header_of
from wirebond.protocol.planning import mixes_ids

_CANONICAL_TEXT = 1  # its version: raised when it changes, so that old and new hashes do not meet by chance


def protocol_hash(protocol: Protocol) -> int:
    """Return the first 64 bits of SHA-256 over the canonical text, most significant byte first."""
    text = json.dumps(_protocol(protocol), sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big")


def _protocol(protocol: Protocol) -> dict[str, Any]:
    frame_format = protocol.format
    mixed = mixes_ids(frame_format.parts, End.HOST) or mixes_ids(frame_format.parts, End.MCU)
    insertion = frame_format.insertion
    # Features added after the first release are included only if they are used, so other hashes stay the same.
    added = {} if insertion is None else {"insertion": [insertion.after.hex(), insertion.byte]}
    return added | {
        "form": _CANONICAL_TEXT,
        "delimiter": _mark(frame_format.delimiter),
        "opening": _mark(frame_format.opening),
        "escapes": None if frame_format.escapes is None else [*vars(frame_format.escapes).values()],
        "silence": frame_format.ends_by_silence,
        "stuffing": frame_format.stuffing.value,
        "parts": [_part(part) for part in frame_format.parts],
        "messages": {message.name: _message(message, mixed) for message in protocol.messages},
        "services": {service.name: dict(service.messages) for service in protocol.services},
    }


def _mark(delimiter: bytes | None) -> int | str | None:
    """Represent a delimiter of one byte as a number, as before there were two."""
    if delimiter is None:
        return None
    return delimiter[0] if len(delimiter) == 1 else delimiter.hex()


def _part(part: Part) -> dict[str, Any]:
    entry: dict[str, Any] = {"size": part.size}
    if part.is_plain:
        entry["plain"] = True
    if part.condition is not None:
        entry["when"] = _condition(part.condition)
    if part.alternatives or part.by_sender:
        entry["magics"] = [value.hex() for value in part.alternatives]
        entry["by_sender"] = [[end.value, value.hex()] for end, value in part.by_sender]
    if part.bits:
        entry["bits"] = [[run.name, run.role.value, run.shift, run.width, _run_value(run)] for run in part.bits]
        rule = [part.counts.value, part.length_offset, part.length_unit]
        if any(run.role == BitRole.LENGTH for run in part.bits) and rule != ["payload", 0, 1]:
            entry["counts"] = rule
    if any(field.per_message for field in header_of(part)):
        entry["per"] = "message"
    meanings = [meaning for field in header_of(part) if (meaning := _header_meaning(field.value))]
    if meanings:
        entry["header"] = meanings
    if part.kind in (PartKind.MAGIC, PartKind.CONSTANT, PartKind.TAIL):
        return {**entry, "kind": "constant", "value": part.value.hex()}
    entry["kind"] = part.kind.value
    if part.size > 1 and part.kind != PartKind.RESERVED:
        entry["order"] = part.order.value
    if part.kind == PartKind.LENGTH:
        entry |= {"counts": part.counts.value, "offset": part.length_offset, "unit": part.length_unit}
    elif part.kind == PartKind.PAYLOAD:
        entry |= {"payload": part.payload.value, "fixed": part.fixed_payload, "trims": part.trims_zeros}
    elif part.algorithm is not None:
        a = part.algorithm
        entry["algorithm"] = [a.kind.value, a.width, a.poly, a.init, a.refin, a.refout, a.xorout, a.modulus, a.negate]
        entry["algorithm"] += _more_than_before(a)
        (first, last), *more = part.ranges
        entry |= {"first": first, "last": last, "shift": part.shift}
        entry |= {"more_ranges": more} if more else {}
        entry |= {"seeded": part.seeded, "as_hex": part.as_hex}
        entry |= {"as_decimal": True} if part.as_decimal else {}
        entry |= {"in_bits": part.in_bits.name} if part.in_bits is not None else {}
    return entry


def _more_than_before(a: Algorithm) -> list[Any]:
    """Return the properties of a check that exist since hashes do; empty for older ones."""
    more = [a.unit, a.unit_order.value if a.unit > 1 else "", a.odd.value, a.end_around, a.plus, a.kept]
    more = [] if more == [1, "", "pad", False, 0, (1 << a.width) - 1] else more
    last = ["bcd"] * a.bcd + (["avoid", a.avoided, a.avoided_plus] if a.avoided else [])
    return more + last


def _condition(condition: Condition) -> list[Any]:
    """Represent one bit of a field, or one magic, as it was when there was nothing else."""
    first = condition.terms[0]
    if len(condition.terms) == 1 and isinstance(first, Comparison) and not condition.negated:
        if first.subject == Subject.MAGIC and len(first.ranges) == 1:
            return ["", 0, first.ranges[0][0].to_bytes(first.size, "big").hex()]
        mask = first.mask or 0
        if first.subject == Subject.FIELD and mask.bit_count() == 1 and first.ranges == ((mask, mask),):
            return [first.name, mask.bit_length() - 1, ""]
    return ["not" if condition.negated else "and", [_term(term) for term in condition.terms]]


def _term(term: Comparison | Condition) -> list[Any]:
    if isinstance(term, Condition):
        return _condition(term)
    return [term.subject.value, term.name, term.mask, [list(bounds) for bounds in term.ranges]]


def _run_value(run: Bits) -> int:
    """Return a constant; of a header field what the host sends by default, as before there were defaults of each
    end."""
    return run.value if run.header is None else run.header.default_bits(End.HOST)


def _header_meaning(field: Field) -> dict[str, Any]:
    """Return the properties that make a header field more than an unsigned number; empty if there are none."""
    added = {
        "signed": field.coding.is_signed,
        "sign_magnitude": field.coding == SIGN_MAGNITUDE,
        "scale": [field.scale.numerator, field.scale.denominator] if field.is_scaled else None,
        "offset": [field.offset.numerator, field.offset.denominator] if field.is_scaled else None,
        "enum": dict(field.enum),
        "flags": dict(field.flags),
    }
    found: dict[str, Any] = {key: value for key, value in added.items() if value}
    return {"name": field.name, **found} if found else {}


def _message(message: Message, mixed: bool) -> dict[str, Any]:
    """Represent a message. ``mixed``: some frames of one sender have an id and others do not, so 0 and none differ."""
    match = [[m.of.value, m.name, m.mask, [list(bounds) for bounds in m.ranges]] for m in message.match]
    return ({"match": match} if match else {}) | {
        "id": None if mixed and not message.has_id else message.id,
        "sender": message.sender.value,
        "seed": message.seed,
        "fields": [_field(field) for field in message.fields],
    }


def _kind(field: Field) -> str:
    """Return the kind by its name in hashes, which is older than codings: numbers with a sign were of one kind."""
    if not field.is_integer:
        return field.kind.value
    return TWOS_COMPLEMENT.name if field.coding.is_signed else field.coding.name


def _field(field: Field) -> dict[str, Any]:
    if not field.has_value:
        fixed = {} if field.constant is None else {"constant": [field.constant, field.order.value]}
        return {"kind": field.kind.value, "size": field.size, "bits": field.bits, **fixed}
    entry: dict[str, Any] = {"name": field.name, "kind": _kind(field), "size": field.size}
    if field.size > 1 and not field.is_characters:
        entry["order"] = field.order.value
    entry |= {
        "count": field.count,
        "max": field.max_size,
        "scale": [field.scale.numerator, field.scale.denominator],
        "offset": [field.offset.numerator, field.offset.denominator],
        "enum": dict(field.enum),
        "flags": dict(field.flags),
    }
    # Features added after the first release are included only if they are used, so other hashes stay the same.
    added = {
        "bits": field.bits,
        "split": [list(piece) for piece in field.split],
        "sign_magnitude": field.coding == SIGN_MAGNITUDE,
        "packed": field.packed and field.packed.value,
        "first": field.first.value if field.kind == FieldKind.BITS else None,
        "fields": [_field(member) for member in field.fields],
        "max_count": field.max_count,
        "counted_by": field.counted_by,
        "counted_in_bytes": field.counted_in_bytes,
        "bytes_counted_by": field.bytes_counted_by,
        "ends_with": None if field.ends_with is None else f"{field.ends_with:02x}",
        "digits": field.digits and [field.digits.base, field.digits.decimals],
    }
    return entry | {key: value for key, value in added.items() if value}
