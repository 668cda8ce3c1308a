"""Where frames lie in a stream: by their start, by delimiters, between silences; and what other bytes count as."""

from __future__ import annotations

from dataclasses import replace

from tests.reference.conditions import Header, truth
from tests.reference.frame import examine_block, examine_start
from tests.reference.header import CONSTANTS, fixed_bits_hold, magics_of
from tests.reference.messages import meant_messages
from tests.reference.outcome import Frame, Incomplete, Rejected, Result
from tests.reference.sizes import longest_on_wire, longest_together
from wirebond.protocol.model import End, PartKind, Protocol


def decode(protocol: Protocol, stream: bytes, sender: End | None = None, request: str | None = None) -> Result:
    """Everything in ``stream``, as if nothing ever followed it. ``request`` went out before it."""
    protocol = replace(protocol, messages=meant_messages(protocol, sender, request))
    frame_format = protocol.format
    if frame_format.ends_by_silence:
        return _decode_block(protocol, stream, sender)
    if frame_format.delimiter is None:
        return _decode_by_start(protocol, stream, sender)
    if frame_format.opening in (None, frame_format.delimiter):
        return _decode_delimited(protocol, stream, sender)
    return _decode_bracketed(protocol, stream, sender)


def decode_blocks(protocol: Protocol, blocks: list[bytes], sender: End | None = None) -> Result:
    """Where silence ends a frame: what lies between the silences, one by one."""
    total = Result()
    begin = 0
    for block in blocks:
        result = _decode_block(protocol, block, sender)
        total.frames += [replace(frame, offset=begin + frame.offset) for frame in result.frames]
        total.discarded_bytes += result.discarded_bytes
        total.rejected_candidates += result.rejected_candidates
        begin += len(block)
    return total


def _decode_by_start(protocol: Protocol, stream: bytes, sender: End | None) -> Result:
    result = Result()
    payload_at = next(i for i, p in enumerate(protocol.format.parts) if p.kind == PartKind.PAYLOAD)
    header = longest_together(protocol.format.parts[:payload_at], sender)
    blame_end, blame = 0, ""
    at = 0
    while at < len(stream):
        failed = 1
        if _may_start(protocol, stream[at], sender):
            try:
                size, message_id, name, header_values = examine_start(protocol, stream[at:], sender)
            except Rejected as outcome:
                cause, extent = outcome.cause, outcome.extent
            except Incomplete:
                cause, extent = "incomplete", len(stream) - at
            else:
                result.frames.append(Frame(at, stream[at : at + size], message_id, name, header_values))
                at += size
                continue
            result.rejected_candidates[cause] += 1
            if at + extent > max(blame_end, at):
                blame_end, blame = at + extent, cause
            if protocol.format.is_strict and extent > header:
                failed = extent
        for place in range(at, at + failed):
            result.discarded_bytes[blame if place < blame_end else "no_start"] += 1
        at += failed
    return result


def _may_start(protocol: Protocol, byte: int, sender: End | None) -> bool:
    """Is this byte the first of a frame, as far as its constants tell? A part that need not be there may be missing."""
    parts = [
        part
        for part in protocol.format.parts
        if part.condition is None or truth(part.condition, Header(sender=sender), None) is not False
    ]
    if any(part.kind == PartKind.MAGIC for part in protocol.format.parts):
        starts = [magics_of(part, sender) for part in parts if part.kind == PartKind.MAGIC]
        return any(value[0] == byte for values in starts for value in values)
    for part in parts:
        agrees = part.value[0] == byte if part.kind in CONSTANTS else fixed_bits_hold(part, bytes([byte]))
        if agrees or part.condition is None:
            return agrees
    return True


def _decode_delimited(protocol: Protocol, stream: bytes, sender: End | None) -> Result:
    result = Result()
    assert protocol.format.delimiter is not None
    delimiter = protocol.format.delimiter
    opens = protocol.format.opening is not None  # or delimiters only end frames
    longest = longest_on_wire(protocol, sender)
    at = 0
    while at < len(stream):
        opening = len(delimiter) if stream.startswith(delimiter, at) else 0
        if opening and (not opens or at + opening == len(stream) or stream.startswith(delimiter, at + opening)):
            result.fill_bytes += opening
            at += opening
            continue
        begin = at + opening
        end = stream.find(delimiter, begin)
        closed = end >= 0
        end = end if closed else len(stream)
        try:
            if not closed:
                raise Rejected("length_out_of_range" if end - at >= longest else "incomplete", 0)
            message_id, name, header = examine_block(protocol, stream[begin:end], sender)
        except Rejected as outcome:
            result.rejected_candidates[outcome.cause] += 1
            stop = end + len(delimiter) if closed and not opens else end
            result.discarded_bytes[outcome.cause] += stop - at
            at = stop
        else:
            result.frames.append(Frame(at, stream[at : end + len(delimiter)], message_id, name, header))
            at = end + len(delimiter)
    return result


def _decode_bracketed(protocol: Protocol, stream: bytes, sender: End | None) -> Result:
    result = Result()
    opening, closing = protocol.format.opening, protocol.format.delimiter
    assert opening is not None and closing is not None
    longest = longest_on_wire(protocol, sender)
    blame_end, blame = 0, ""
    at = 0
    while at < len(stream):
        failed = 1
        if stream.startswith(opening, at):
            candidate = stream[at : at + longest]
            content, outcome = _bracketed_content(protocol, candidate, opening, closing)
            end = len(opening) + len(content) + len(closing)
            try:
                if outcome == "incomplete" and len(candidate) == longest and len(opening) + len(content) == longest:
                    outcome = "length_out_of_range"
                if outcome:
                    end -= len(closing) if outcome != "bad_stuffing" else len(opening) % 2  # its last two bytes
                    raise Rejected(outcome, 0)
                message_id, name, header = examine_block(protocol, content, sender)
            except Rejected as rejected:
                result.rejected_candidates[rejected.cause] += 1
                if at + end > max(blame_end, at):
                    blame_end, blame = at + end, rejected.cause
                failed = end if protocol.format.is_strict and not outcome else 1  # its closing delimiter was found
            else:
                result.frames.append(Frame(at, stream[at : at + end], message_id, name, header))
                at += end
                continue
        for place in range(at, at + failed):
            result.discarded_bytes[blame if place < blame_end else "no_start"] += 1
        at += failed
    return result


def _bracketed_content(protocol: Protocol, candidate: bytes, opening: bytes, closing: bytes) -> tuple[bytes, str]:
    """What lies behind the opening delimiter, and why it is no frame; "" where the closing delimiter ends it."""
    escapes = protocol.format.escapes
    doubled = None
    if escapes is not None and escapes.escape == opening[0]:
        doubled = opening[0]
    at = len(opening)
    alone = doubled is not None and len(opening) == 1
    if alone and len(candidate) > 1 and candidate[1] in closing:
        return b"", "bad_stuffing"  # a doubled byte, or a closing delimiter
    while at < len(candidate):
        content = candidate[len(opening) : at]
        if candidate[at : at + len(closing)] == closing:
            return content, ""
        if not alone and candidate[at : at + len(opening)] == opening:
            return content, "incomplete"
        if candidate[at] == doubled and at + 1 < len(candidate):
            if candidate[at + 1] != doubled and alone:
                return content, "incomplete"  # another frame opens here
            if candidate[at + 1] != doubled:
                return content, "bad_stuffing"  # two bytes of no meaning, where the delimiter would be
            at += 1
        at += 1
    return candidate[len(opening) :], "incomplete"


def _decode_block(protocol: Protocol, block: bytes, sender: End | None) -> Result:
    """What lies between two silences."""
    result = Result()
    try:
        message_id, name, header = examine_block(protocol, block, sender)
    except Rejected as outcome:
        result.rejected_candidates[outcome.cause] += 1
        result.discarded_bytes[outcome.cause] += len(block)
    else:
        result.frames.append(Frame(0, block, message_id, name, header))
    return result
