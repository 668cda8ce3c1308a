"""A stream as the decoder goes through it: frames, fill, and which candidate's failure each discarded byte carries.

The whole stream is here in one piece, as if nothing followed it. Work is one verdict for each possible start.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace

from wirebond.analysis.explain.examine import examine
from wirebond.analysis.explain.layout import CONSTANTS, fixed_bits, hex_of, payload_index
from wirebond.analysis.explain.shapes import forms
from wirebond.analysis.explain.sized import examine_sized
from wirebond.analysis.explain.stuffing import Impossible, Unstuffed, plain, unstuff
from wirebond.analysis.explain.verdict import Cause, Outcome, Verdict
from wirebond.protocol.model import ByteOrder, End, PayloadRule, Protocol


@dataclass(frozen=True)
class Found:
    """A delivered frame: stream[offset : offset + size], delimiters included. Its content begins at ``begin``."""

    offset: int
    size: int
    verdict: Verdict
    content: Unstuffed
    begin: int


@dataclass(frozen=True)
class Candidate:
    """Bytes that could have been a frame. ``extent``: this many wire bytes carry its cause when rescanned in vain.

    The content is stream[begin : end]; the rest of the extent are delimiters. Where frames are found by their start,
    ``end`` is None: the candidate says itself how long it is.
    """

    offset: int
    extent: int
    cause: Cause
    begin: int
    end: int | None = None
    verdict: Verdict | None = None  # None: it failed before its parts could be looked at
    content: Unstuffed | None = None
    reason: str = ""  # why there is no verdict


@dataclass
class Scan:
    frames: list[Found] = field(default_factory=list)
    fill: list[int] = field(default_factory=list)  # offsets of delimiters between frames
    blamed: dict[int, Candidate | None] = field(default_factory=dict)  # each discarded byte's offset; None: no start
    rejected: Counter[Cause] = field(default_factory=Counter)  # candidates, by cause

    @property
    def discarded(self) -> Counter[Cause]:
        """Bytes by cause."""
        return Counter(Cause.NO_START if c is None else c.cause for c in self.blamed.values())

    def reject(self, candidate: Candidate) -> None:
        """Reject a candidate without a rescan: all its bytes get its cause."""
        self.rejected[candidate.cause] += 1
        self.blamed.update(dict.fromkeys(range(candidate.offset, candidate.offset + candidate.extent), candidate))


def scan(protocol: Protocol, stream: bytes, sender: End | None) -> Scan:
    """Scan all of ``stream``, as if nothing ever followed it."""
    frame_format = protocol.format
    if frame_format.ends_by_silence:
        return _between_silences(protocol, stream, sender)
    if frame_format.delimiter is None:
        return _by_start(protocol, stream, sender)
    if frame_format.opening in (None, frame_format.delimiter):
        return _between_delimiters(protocol, stream, sender, frame_format.delimiter)
    assert frame_format.opening is not None
    return _in_brackets(protocol, stream, sender, frame_format.opening, frame_format.delimiter)


def start_bytes(protocol: Protocol, sender: End | None) -> set[int]:
    """Return the values that a frame's first byte can have, according to its constants."""
    starts = set()
    for form in forms(protocol, sender):
        first = form.parts[0]
        if first.kind in CONSTANTS:
            starts.add(first.value[0])
            continue
        mask, value = fixed_bits(first, form.choices)
        place = 8 * (first.size - 1) if first.order == ByteOrder.BIG else 0
        mask, value = mask >> max(place, 0) & 0xFF, value >> max(place, 0) & 0xFF
        starts |= {byte for byte in range(256) if byte & mask == value}
    return starts


def longest_frame(protocol: Protocol, sender: End | None) -> int:
    """Return the size of the longest form of the frame, before stuffing and without delimiters."""
    longest = 0
    for form in forms(protocol, sender):
        payload = form.parts[payload_index(form.parts)]
        size = (
            payload.fixed_payload if payload.payload == PayloadRule.FIXED else protocol.format.max_payload_from(sender)
        )
        longest = max(longest, sum(part.size for part in form.parts) + size)
    return longest


def _by_start(protocol: Protocol, stream: bytes, sender: End | None) -> Scan:
    result = Scan()
    starts = start_bytes(protocol, sender)
    longest = longest_frame(protocol, sender)
    header = max(sum(p.size for p in form.parts[: payload_index(form.parts)]) for form in forms(protocol, sender))
    blame: Candidate | None = None
    at = 0
    while at < len(stream):
        failed = 1
        if stream[at] in starts:
            examined = _examine_start(protocol, stream, sender, at, longest)
            if isinstance(examined, Found):
                result.frames.append(examined)
                at += examined.size
                continue
            candidate, extent = examined, examined.extent
            result.rejected[candidate.cause] += 1
            if blame is None or at + extent > max(blame.offset + blame.extent, at):
                blame = candidate
            if protocol.format.is_strict and extent > header:
                failed = extent
        for place in range(at, at + failed):
            result.blamed[place] = blame if blame is not None and place < blame.offset + blame.extent else None
        at += failed
    return result


def _examine_start(protocol: Protocol, stream: bytes, sender: End | None, at: int, longest: int) -> Found | Candidate:
    left = len(stream) - at
    if protocol.format.is_sized:
        sized = examine_sized(protocol, stream[at : at + longest + protocol.format.overhead(longest)], sender)
        if sized.outcome == Outcome.FRAME and sized.verdict is not None:
            return Found(at, sized.extent, sized.verdict, sized.content, at)
        extent = left if sized.outcome == Outcome.INCOMPLETE else sized.extent
        end = at + extent if sized.verdict is None else None
        return Candidate(at, extent, sized.cause, at, end, sized.verdict, sized.content, sized.reason)
    data = stream[at : at + longest]
    verdict = examine(protocol, data, sender)
    if verdict.is_frame:
        return Found(at, verdict.extent, verdict, plain(stream[at : at + verdict.extent]), at)
    extent = left if verdict.outcome == Outcome.INCOMPLETE else verdict.extent
    return Candidate(at, extent, verdict.cause, at, None, verdict, plain(data))


def _between_delimiters(protocol: Protocol, stream: bytes, sender: End | None, delimiter: bytes) -> Scan:
    """Scan the bytes between delimiters. A delimiter that may open a frame belongs to the bytes after a failed
    block; one that only ends frames does not."""
    result = Scan()
    opens = protocol.format.opening is not None
    at = 0
    while at < len(stream):
        lead = len(delimiter) * stream.startswith(delimiter, at)
        if lead and (not opens or at + lead == len(stream) or stream.startswith(delimiter, at + lead)):
            result.fill += range(at, at + lead)
            at += lead
            continue
        end = stream.find(delimiter, at + lead)
        if end < 0:
            result.reject(_unended(protocol, stream, sender, at, at + lead, len(stream), delimiter))
            return result
        examined = _examine_block(protocol, stream, sender, at, at + lead, end, len(delimiter))
        if isinstance(examined, Found):
            result.frames.append(examined)
            at = end + len(delimiter)
        else:
            stop = end if opens else end + len(delimiter)
            result.reject(replace(examined, extent=stop - at))
            at = stop
    return result


def _in_brackets(protocol: Protocol, stream: bytes, sender: End | None, opening: bytes, closing: bytes) -> Scan:
    """Scan frames between an opening and a closing delimiter. Each opening one begins a candidate, also within a failed
    one."""
    result = Scan()
    blame: Candidate | None = None
    at = 0
    while at < len(stream):
        failed = 1
        if stream.startswith(opening, at):
            examined = _examine_bracket(protocol, stream, sender, at, opening, closing)
            if isinstance(examined, Found):
                result.frames.append(examined)
                at += examined.size
                continue
            result.rejected[examined.cause] += 1
            if blame is None or at + examined.extent > max(blame.offset + blame.extent, at):
                blame = examined
            is_closed = examined.end is not None and examined.extent == examined.end + len(closing) - at
            failed = examined.extent if protocol.format.is_strict and is_closed else 1
        for place in range(at, at + failed):
            result.blamed[place] = blame if blame is not None and place < blame.offset + blame.extent else None
        at += failed
    return result


def _examine_bracket(
    protocol: Protocol, stream: bytes, sender: End | None, at: int, opening: bytes, closing: bytes
) -> Found | Candidate:
    begin = at + len(opening)
    limit = min(len(stream), at + _longest_on_wire(protocol, sender))
    doubled = protocol.format.escapes.escape if protocol.format.escapes and protocol.format.escapes.doubles else None
    end = begin
    alone = doubled is not None and len(opening) == 1  # it opens a frame where the next byte makes no pair of it
    if alone and begin < limit and stream[begin] in closing:
        reason = f"at {at}: {stream[at]:02X} {stream[begin]:02X} does not open a frame"
        return Candidate(at, 2, Cause.BAD_STUFFING, begin, begin + 1, reason=reason)
    marks = (closing,) if alone else (opening, closing)
    while end < limit and not any(stream.startswith(mark, end, limit) for mark in marks):
        if stream[end] == doubled and end + 1 < limit and stream[end + 1] != doubled:
            if alone:
                return _unended(protocol, stream, sender, at, begin, end, closing)
            reason = f"at {end}: {stream[end]:02X} {stream[end + 1]:02X} is neither a delimiter nor a doubled byte"
            return Candidate(at, end + 2 - at, Cause.BAD_STUFFING, begin, end + 2, reason=reason)
        end += 2 if stream[end] == doubled else 1
    if end >= limit or (not alone and stream.startswith(opening, end, limit)):
        return _unended(protocol, stream, sender, at, begin, min(end, limit), closing)
    examined = _examine_block(protocol, stream, sender, at, begin, end, len(closing))
    if isinstance(examined, Found):
        return examined
    return replace(examined, extent=end + len(closing) - at)


def _between_silences(protocol: Protocol, stream: bytes, sender: End | None) -> Scan:
    """Scan frames between silences. Bytes without times are one block."""
    result = Scan()
    if not stream:
        return result
    examined = _examine_block(protocol, stream, sender, 0, 0, len(stream), 0)
    if isinstance(examined, Found):
        result.frames.append(examined)
    else:
        result.reject(examined)
    return result


def _longest_on_wire(protocol: Protocol, sender: End | None) -> int:
    longest = longest_frame(protocol, sender)
    closing = protocol.format.delimiter or b""
    return longest + protocol.format.overhead(longest) + len(protocol.format.opening or closing) + len(closing)


def _unended(
    protocol: Protocol, stream: bytes, sender: End | None, offset: int, begin: int, end: int, closing: bytes
) -> Candidate:
    size, longest = end - offset, _longest_on_wire(protocol, sender)
    mark = hex_of(closing)
    cause = Cause.LENGTH_OUT_OF_RANGE if size >= longest else Cause.INCOMPLETE
    reason = f"{size} bytes without a delimiter; the largest frame has {longest}"
    if size < longest:
        reason = f"the delimiter {mark} that ends the frame is missing"
        if end < len(stream):
            reason = f"another frame opens at {end}, before the delimiter {mark} that ends this one"
    return Candidate(offset, size, cause, begin, end, reason=reason)


def _examine_block(
    protocol: Protocol, stream: bytes, sender: End | None, offset: int, begin: int, end: int, closing: int
) -> Found | Candidate:
    """Examine a block. ``closing``: bytes of the delimiter after it."""
    frame_format = protocol.format
    block = stream[begin:end]
    longest = longest_frame(protocol, sender)
    most = longest + frame_format.overhead(longest)
    extent = end - offset
    if len(block) > most:
        reason = f"{len(block)} bytes are more than the {most} that a frame can have"
        return Candidate(offset, extent, Cause.LENGTH_OUT_OF_RANGE, begin, end, reason=reason)
    content = unstuff(frame_format, block)
    if isinstance(content, Impossible):
        reason = f"at {begin + content.at}: {content.reason}"
        return Candidate(offset, extent, Cause.BAD_STUFFING, begin, end, reason=reason)
    verdict = examine(protocol, content.data, sender, block=block)
    if verdict.is_frame:
        return Found(offset, end + closing - offset, verdict, content, begin)
    return Candidate(offset, extent, verdict.cause, begin, end, verdict, content)
