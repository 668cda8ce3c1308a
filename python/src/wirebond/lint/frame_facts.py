"""Sizes and bounds that a frame's parts imply by themselves, and a protocol that believes every header."""

from __future__ import annotations

from dataclasses import replace

from wirebond.protocol.model import End, Field, FieldKind, Frame, LengthCounts, Message, PartKind, PayloadRule, Protocol

ENDS = (End.HOST, End.MCU)
ANY = "any"  # the one message of `open_protocol`
ANY_CONTENT = "content"  # its one field


def header_bytes(frame: Frame) -> int:
    """Bytes before the payload."""
    kinds = [part.kind for part in frame.parts]
    return sum(part.size for part in frame.parts[: kinds.index(PartKind.PAYLOAD)])


def fixed_bytes(frame: Frame) -> int:
    """Bytes of all parts but the payload, before stuffing and delimiters."""
    return sum(part.size for part in frame.parts)


def has_header_check(frame: Frame) -> bool:
    """Is a check complete, length included, before the payload comes?"""
    kinds = [part.kind for part in frame.parts]
    payload = kinds.index(PartKind.PAYLOAD)
    lengths = [i for i, kind in enumerate(kinds) if kind == PartKind.LENGTH]
    return any(
        part.kind == PartKind.CHECK and all(part.first <= at <= part.last for at in lengths)
        for part in frame.parts[:payload]
    )


def check_bits(frame: Frame) -> int:
    """Bits of all checks on the wire."""
    return 8 * sum(part.size for part in frame.parts if part.kind == PartKind.CHECK)


def longest_by_length(frame: Frame) -> int | None:
    """The longest payload that the length part can tell; None without one."""
    index = next((i for i, part in enumerate(frame.parts) if part.kind == PartKind.LENGTH), None)
    if index is None:
        return None
    length = frame.parts[index]
    follows = sum(part.size for part in frame.parts[index + 1 :])
    beside = {
        LengthCounts.PAYLOAD: 0,
        LengthCounts.REST: follows,
        LengthCounts.SELF_AND_REST: length.size + follows,
        LengthCounts.FRAME: fixed_bytes(frame),
    }[length.counts]
    greatest: int = 2 ** (8 * length.size) - 1
    return greatest - beside - length.length_offset


def open_protocol(protocol: Protocol, sender: End, payload: int) -> Protocol | None:
    """The same frame, read by a receiver that knows no message: any id, any size up to ``payload`` is taken.

    None where the frame does not tell its payload's size by itself.
    """
    part = protocol.frame.part(PartKind.PAYLOAD)
    assert part is not None, "every frame has a payload part"
    if part.payload == PayloadRule.BY_ID:
        return None
    if part.payload == PayloadRule.FIXED:
        payload = part.fixed_payload
        content = Field(ANY_CONTENT, FieldKind.BYTES, payload)
    else:
        content = Field(ANY_CONTENT, FieldKind.BYTES, 0, max_size=payload)
    message = Message(ANY, 1, sender, (content,) if payload else ())
    return replace(
        protocol,
        frame=replace(protocol.frame, max_payload=payload, deliver_unknown=True),
        messages=(message,),
        deadlines=(),
        emergency_stop=None,
        services=(),
        examples=(),
    )
