"""A slow and obvious decoder: the whole stream in one piece, bit-by-bit checks, straight from the parts of the model.

It shares no code with the engine: no plan, no tables, no state between calls. Tests compare the two, byte for byte.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from wirebond.protocol.model import (
    Algorithm,
    ByteOrder,
    End,
    LengthCounts,
    Message,
    Part,
    PartKind,
    PayloadRule,
    Protocol,
)

CONSTANTS = (PartKind.MAGIC, PartKind.CONSTANT, PartKind.TAIL)


@dataclass(frozen=True)
class Frame:
    offset: int
    wire: bytes
    id: int
    name: str  # of the message, or "unknown"


@dataclass
class Result:
    frames: list[Frame] = field(default_factory=list)
    fill_bytes: int = 0
    discarded_bytes: Counter[str] = field(default_factory=Counter)
    rejected_candidates: Counter[str] = field(default_factory=Counter)


@dataclass(frozen=True)
class _Rejected(Exception):  # noqa: N818  (an outcome, not an error)
    cause: str
    extent: int


class _Incomplete(Exception):  # noqa: N818
    pass


def decode(protocol: Protocol, stream: bytes, sender: End | None = None) -> Result:
    """Everything in ``stream``, as if nothing ever followed it."""
    if protocol.frame.delimiter is not None:
        return _decode_delimited(protocol, stream, sender)
    return _decode_by_start(protocol, stream, sender)


def _decode_by_start(protocol: Protocol, stream: bytes, sender: End | None) -> Result:
    result = Result()
    blame_end, blame = 0, ""
    at = 0
    first = protocol.frame.parts[0]
    while at < len(stream):
        starts = first.kind not in CONSTANTS or stream[at] == first.value[0]
        if starts:
            try:
                size, message_id, name = _judge(protocol, stream[at:], sender, whole=False)
            except _Rejected as outcome:
                cause, extent = outcome.cause, outcome.extent
            except _Incomplete:
                cause, extent = "incomplete", len(stream) - at
            else:
                result.frames.append(Frame(at, stream[at : at + size], message_id, name))
                at += size
                continue
            result.rejected_candidates[cause] += 1
            if at + extent > max(blame_end, at):
                blame_end, blame = at + extent, cause
        result.discarded_bytes[blame if at < blame_end else "no_start"] += 1
        at += 1
    return result


def _decode_delimited(protocol: Protocol, stream: bytes, sender: End | None) -> Result:
    result = Result()
    assert protocol.frame.delimiter is not None
    delimiter = bytes([protocol.frame.delimiter])
    longest = protocol.max_wire_bytes()
    at = 0
    while at < len(stream):
        opening = stream[at : at + 1] == delimiter
        if opening and stream[at + 1 : at + 2] in (delimiter, b""):
            result.fill_bytes += 1
            at += 1
            continue
        begin = at + opening
        end = stream.find(delimiter, begin)
        closed = end >= 0
        end = end if closed else len(stream)
        try:
            if not closed:
                raise _Rejected("length_out_of_range" if end - at >= longest else "incomplete", 0)
            message_id, name = _judge_block(protocol, stream[begin:end], sender)
        except _Rejected as outcome:
            result.rejected_candidates[outcome.cause] += 1
            result.discarded_bytes[outcome.cause] += end - at
            at = end
        else:
            result.frames.append(Frame(at, stream[at : end + 1], message_id, name))
            at = end + 1
    return result


def _judge_block(protocol: Protocol, block: bytes, sender: End | None) -> tuple[int, str]:
    parts = sum(p.size for p in protocol.frame.parts)
    longest = parts + protocol.frame.max_payload
    if len(block) > longest + 1 + longest // 254:
        raise _Rejected("length_out_of_range", 0)
    frame = uncobs(block)
    if frame is None:
        raise _Rejected("bad_stuffing", 0)
    try:
        _, message_id, name = _judge(protocol, frame, sender, whole=True)
    except _Incomplete:
        raise _Rejected("length_out_of_range", 0) from None
    return message_id, name


def uncobs(block: bytes) -> bytes | None:
    """COBS undone; None where a code points past the end."""
    out = bytearray()
    at = 0
    while at < len(block):
        code = block[at]
        if code == 0 or at + code > len(block):
            return None
        out += block[at + 1 : at + code]
        at += code
        if code != 0xFF and at < len(block):
            out.append(0)
    return bytes(out)


def _judge(protocol: Protocol, data: bytes, sender: End | None, whole: bool) -> tuple[int, int, str]:
    """Size, id and message name of the frame at the start of ``data``; raises _Rejected or _Incomplete."""
    frame = protocol.frame
    parts = frame.parts
    payload_at = next(i for i, p in enumerate(parts) if p.kind == PartKind.PAYLOAD)
    before, after = parts[:payload_at], parts[payload_at + 1 :]
    prefix, suffix = sum(p.size for p in before), sum(p.size for p in after)

    at = 0
    for part in before:  # constants as soon as their bytes are there
        if part.kind in CONSTANTS:
            for i, byte in enumerate(part.value):
                if at + i >= len(data):
                    raise _Incomplete
                if data[at + i] != byte:
                    raise _Rejected("constant_mismatch", 1)
        at += part.size
    if len(data) < prefix:
        raise _Incomplete

    size, known_size = _payload_size(protocol, parts, data, prefix, suffix, sender)
    early_id = any(p.kind == PartKind.ID for p in before)
    message_id = _number(before, data, PartKind.ID) if early_id else 0
    message = _message(protocol, message_id, sender)
    if early_id and not frame.deliver_unknown and not _fits(message, size, known_size):
        raise _Rejected("unknown_message", prefix)

    for i, part in enumerate(before):  # checks of the header
        if part.kind == PartKind.CHECK and part.last < payload_at and not _holds(parts, i, data, payload_at, 0):
            raise _Rejected("header_check_mismatch", prefix)

    total = prefix + size + suffix
    if whole and total != len(data):
        raise _Rejected("length_out_of_range", 0)
    if len(data) < total:
        raise _Incomplete
    data = data[:total]

    at = prefix + size
    for part in after:
        if part.kind in CONSTANTS and data[at : at + part.size] != part.value:
            raise _Rejected("constant_mismatch", total)
        at += part.size
    if not early_id:
        has_id = any(p.kind == PartKind.ID for p in after)
        message_id = _number(after, data[prefix + size :], PartKind.ID) if has_id else 0
        message = _message(protocol, message_id, sender)
        if not frame.deliver_unknown and not _fits(message, size, known_size):
            raise _Rejected("unknown_message", total)

    for i, part in enumerate(parts):
        in_header = i < payload_at and part.last < payload_at
        if part.kind == PartKind.CHECK and not in_header and not _holds(parts, i, data, payload_at, size):
            raise _Rejected("check_mismatch", total)
    decodable = message is not None and size >= message.min_payload
    return total, message_id, message.name if message is not None and decodable else "unknown"


def _payload_size(
    protocol: Protocol, parts: tuple[Part, ...], data: bytes, prefix: int, suffix: int, sender: End | None
) -> tuple[int, bool]:
    """Payload bytes, and whether the format itself fixes them."""
    payload = next(p for p in parts if p.kind == PartKind.PAYLOAD)
    most = protocol.frame.max_payload
    if payload.payload == PayloadRule.FIXED:
        return payload.fixed_payload, True
    if payload.payload == PayloadRule.REST:
        size = len(data) - prefix - suffix
        if not 0 <= size <= most:
            raise _Rejected("length_out_of_range", 0)
        return size, False
    if payload.payload == PayloadRule.BY_ID:
        message = _message(protocol, _number(parts, data, PartKind.ID), sender)
        if message is None:
            raise _Rejected("unknown_message", prefix)
        return message.max_payload, True
    index = next(i for i, p in enumerate(parts) if p.kind == PartKind.LENGTH)
    length = parts[index]
    follows = sum(p.size for p in parts[index + 1 :])
    counted = {
        LengthCounts.PAYLOAD: 0,
        LengthCounts.REST: follows,
        LengthCounts.SELF_AND_REST: length.size + follows,
        LengthCounts.FRAME: prefix + suffix,
    }[length.counts]
    size = _number(parts, data, PartKind.LENGTH) - counted - length.length_offset
    if not 0 <= size <= most:
        raise _Rejected("length_out_of_range", prefix)
    return size, False


def _number(parts: tuple[Part, ...], data: bytes, kind: PartKind) -> int:
    at = 0
    for part in parts:
        if part.kind == kind:
            return int.from_bytes(data[at : at + part.size], _order(part.order))
        at += part.size
    raise AssertionError(f"no {kind} part")


def _order(order: ByteOrder) -> str:
    return "little" if order == ByteOrder.LITTLE else "big"


def _message(protocol: Protocol, message_id: int, sender: End | None) -> Message | None:
    return next((m for m in protocol.messages if m.id == message_id and m.sent_by(sender)), None)


def _fits(message: Message | None, size: int, known_size: bool) -> bool:
    return message is not None and (known_size or message.min_payload <= size <= message.max_payload)


def _holds(parts: tuple[Part, ...], index: int, data: bytes, payload_at: int, payload_size: int) -> bool:
    sizes = [payload_size if i == payload_at else p.size for i, p in enumerate(parts)]
    part = parts[index]
    assert part.algorithm is not None
    covered = data[sum(sizes[: part.first]) : sum(sizes[: part.last + 1])]
    at = sum(sizes[:index])
    found = int.from_bytes(data[at : at + part.size], _order(part.order))
    return found == (checksum(part.algorithm, covered) >> part.shift) % 256**part.size


def checksum(algorithm: Algorithm, data: bytes) -> int:
    """One bit at a time, as the definition says."""
    width = algorithm.width
    if algorithm.kind == "xor":
        value = algorithm.init
        for byte in data:
            value ^= byte
        return value ^ algorithm.xorout
    if algorithm.kind == "sum":
        return (algorithm.init + sum(data)) % 2**width ^ algorithm.xorout
    register = algorithm.init
    for byte in data:
        for bit in range(8):
            incoming = byte >> (bit if algorithm.refin else 7 - bit) & 1
            top = register >> (width - 1) & 1
            register = (register << 1) % 2**width
            if top ^ incoming:
                register ^= algorithm.poly
    if algorithm.refout:
        register = int(f"{register:0{width}b}"[::-1], 2)
    return register ^ algorithm.xorout
