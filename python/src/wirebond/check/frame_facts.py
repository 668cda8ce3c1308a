"""Sizes and bounds that a frame's layout implies by itself, and a protocol that believes every header."""

from __future__ import annotations

import math
from dataclasses import replace

from wirebond.protocol.model import BitRole, End, Field, FieldKind, Message, PartKind, PayloadRule, Protocol
from wirebond.protocol.plan import Layout, plan_for

ENDS = (End.HOST, End.MCU)
ANY = "any"  # the one message of `open_protocol`
ANY_CONTENT = "content"  # its one field


def senders(protocol: Protocol) -> list[End]:
    """The ends that send anything."""
    return [end for end in ENDS if any(message.sent_by(end) for message in protocol.messages)]


def layouts(protocol: Protocol, sender: End) -> tuple[Layout, ...]:
    """The forms that a frame of this end can take; the first is the one that is sent unless header values say else."""
    return plan_for(protocol, sender).layouts


def has_id(protocol: Protocol) -> bool:
    return any(p.kind == PartKind.ID or any(run.role == BitRole.ID for run in p.bits) for p in protocol.frame.parts)


def has_header_check(layout: Layout) -> bool:
    """Is a check over the length complete before the payload comes?"""
    length = layout.length
    return any(
        length is None
        or (
            not length.at.from_end
            and rule.start.offset <= length.at.offset
            and length.at.offset + length.bytes <= rule.stop.offset
        )
        for rule in layout.checks[: layout.header_checks]
    )


def payload_sizes(layout: Layout, most: int) -> range | None:
    """The payload sizes up to ``most`` that the length can tell; None without a length."""
    if layout.length is None:
        return None
    greatest = layout.length.mask * layout.length_unit + layout.length_bias
    least = layout.length_bias
    if least < 0:
        least += -(least // layout.length_unit) * layout.length_unit  # the first that is not negative
    return range(least, min(most, greatest) + 1, layout.length_unit)


def wire_bytes(protocol: Protocol, sender: End, payload: int) -> int:
    """Bytes that a frame with so many payload bytes takes of the line: its usual form, worst COBS, usual escapes.

    Escaping may double a frame; counted is what random content brings. Where silence ends a frame it is counted, too.
    """
    frame = protocol.frame
    layout = layouts(protocol, sender)[0]
    content = layout.fixed_payload if layout.payload == PayloadRule.FIXED else payload
    size = layout.prefix + content + layout.suffix
    if frame.stuffing == "cobs":
        size += 1 + size // 254
    elif frame.escapes is not None:
        size = math.ceil(size * (1 + len(frame.escapes.pairs) / 256))
    if frame.ends_by_silence:
        size += math.ceil(protocol.idle_seconds * protocol.link.baud / protocol.link.bits_per_byte)
    return size + len(frame.opening or b"") + len(frame.delimiter or b"")


def open_protocol(protocol: Protocol, sender: End, payload: int) -> Protocol | None:
    """The same frame, read by a receiver that knows no message: any id, any size up to ``payload`` is taken.

    None where such a receiver cannot be: the id tells the size or seeds the check, or delimiters stand around bytes
    that are not stuffed, so that not every content can be carried.
    """
    frame = protocol.frame
    part = frame.part(PartKind.PAYLOAD)
    assert part is not None, "every frame has a payload part"
    unstuffed = frame.delimiter is not None and frame.stuffing == "none"
    if part.payload == PayloadRule.BY_ID or unstuffed or any(p.seeded for p in frame.parts):
        return None
    if part.payload == PayloadRule.FIXED:
        payload = part.fixed_payload
        content = Field(ANY_CONTENT, FieldKind.BYTES, payload)
    else:
        content = Field(ANY_CONTENT, FieldKind.BYTES, 0, max_size=payload)
    message = Message(ANY, 1 if has_id(protocol) else 0, sender, (content,) if payload else ())
    return replace(
        protocol,
        frame=replace(frame, max_payload=payload, deliver_unknown=True),
        messages=(message,),
        deadlines=(),
        emergency_stop=None,
        services=(),
        examples=(),
    )
