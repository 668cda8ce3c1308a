"""Sizes and bounds that a frame's form implies by itself, and a protocol that believes every header."""

from __future__ import annotations

import math
from dataclasses import replace

from wirebond.protocol.model import (
    BitRole,
    End,
    Field,
    FieldKind,
    Message,
    PartKind,
    PayloadRule,
    Protocol,
    Stuffing,
    cobs_overhead,
)
from wirebond.protocol.plan import Form
from wirebond.protocol.planning import plan_for

ENDS = (End.HOST, End.MCU)
ANY = "any"  # the one message of `open_protocol`
ANY_CONTENT = "content"  # its one field


def senders(protocol: Protocol) -> list[End]:
    """Return the ends that send anything."""
    return [end for end in ENDS if any(message.sent_by(end) for message in protocol.messages)]


def forms(protocol: Protocol, sender: End) -> tuple[Form, ...]:
    """Return the forms that a frame of this end can take; the first is the one that is sent unless header values say
    else."""
    return plan_for(protocol, sender).forms


def has_id(protocol: Protocol) -> bool:
    return any(p.kind == PartKind.ID or any(run.role == BitRole.ID for run in p.bits) for p in protocol.format.parts)


def has_header_check(form: Form) -> bool:
    """Check whether a check over the length is complete before the payload comes."""
    length = form.length
    return any(
        length is None
        or (
            not length.at.from_end
            and any(
                start.offset <= length.at.offset and length.at.offset + length.bytes <= stop.offset
                for start, stop in rule.ranges
            )
        )
        for rule in form.checks[: form.header_checks]
    )


def payload_sizes(form: Form, most: int) -> range | None:
    """Return the payload sizes up to ``most`` that the length can express; None in a format without one."""
    if form.length is None:
        return range(1) if form.payload == PayloadRule.BY_LENGTH else None
    greatest = form.length.mask * form.length_unit + form.length_bias
    least = form.length_bias
    if least < 0:
        least += -(least // form.length_unit) * form.length_unit  # the first that is not negative
    return range(least, min(most, greatest) + 1, form.length_unit)


def wire_bytes(protocol: Protocol, sender: End, payload: int) -> int:
    """Return the bytes of line of a frame with this many payload bytes: its usual form, worst COBS, usual escapes.

    Escaping may double a frame; counted is what random content brings. Where silence ends a frame the sender's pause is
    counted, too.
    """
    frame_format = protocol.format
    form = forms(protocol, sender)[0]
    content = form.fixed_payload if form.payload == PayloadRule.FIXED else payload
    size = form.prefix + content + form.suffix
    if frame_format.stuffing == Stuffing.COBS:
        size += cobs_overhead(size)
    elif frame_format.escapes is not None:
        size = math.ceil(size * (1 + len(frame_format.escapes.pairs) / 256))
    elif frame_format.stuffing == Stuffing.HEX:
        size *= 2
    elif frame_format.stuffing == Stuffing.HEX_AFTER_DIGIT:
        size = 2 * size - 1
    elif frame_format.stuffing == Stuffing.DECIMAL_CHECK:
        size += frame_format.overhead(size)
    if frame_format.ends_by_silence:
        size += math.ceil(protocol.pause_seconds * protocol.link.baud / protocol.link.bits_per_byte)
    return size + len(frame_format.opening or b"") + len(frame_format.delimiter or b"")


def open_protocol(protocol: Protocol, sender: End, payload: int) -> Protocol | None:
    """Return the same frame format for a receiver without messages: it accepts any id, and any size up to ``payload``.

    None where such a receiver is impossible: the id determines the size or seeds the check, or delimiters enclose bytes
    that are not stuffed, so that not every content can be carried.
    """
    frame_format = protocol.format
    part = frame_format.part(PartKind.PAYLOAD)
    assert part is not None, "every frame has a payload part"
    unstuffed = frame_format.delimiter is not None and not frame_format.stuffing.hides_delimiters
    if part.payload == PayloadRule.BY_ID or unstuffed or any(p.seeded for p in frame_format.parts):
        return None
    if part.payload == PayloadRule.FIXED:
        payload = part.fixed_payload
        content = Field(ANY_CONTENT, FieldKind.BYTES, payload)
    else:
        content = Field(ANY_CONTENT, FieldKind.BYTES, 0, max_size=payload)
    with_id = forms(protocol, sender)[0].id is not None
    fields = (content,) if payload else ()
    message = Message(ANY, int(with_id), sender, fields, has_id=with_id)
    return replace(
        protocol,
        format=replace(frame_format, max_payload=payload, longest_sent=(), deliver_unknown=True),
        messages=(message,),
        deadlines=(),
        emergency_stop=(),
        services=(),
        examples=(),
    )
