"""A stream as the decoder goes through it: frames, fill, and which candidate's failure each discarded byte carries.

The whole stream lies here in one piece, as if nothing followed it. Work is one judgement for each possible start.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace

from wirebond.explain.judge import CONSTANTS, Judgement, Outcome, fixed_bits, forms, judge, payload_index
from wirebond.explain.stuffing import Impossible, Unstuffed, overhead, plain, unstuff
from wirebond.protocol.model import ByteOrder, End, PayloadRule, Protocol


@dataclass(frozen=True)
class Found:
    """A delivered frame: stream[offset : offset + size], delimiters included. Its content begins at ``begin``."""

    offset: int
    size: int
    judgement: Judgement
    content: Unstuffed
    begin: int


@dataclass(frozen=True)
class Candidate:
    """Bytes that could have been a frame. ``extent``: so many wire bytes carry its cause when rescanned in vain.

    The content is stream[begin : end]; the rest of the extent are delimiters. Where frames are found by their start,
    ``end`` is None: the candidate says itself how long it is.
    """

    offset: int
    extent: int
    cause: str
    begin: int
    end: int | None = None
    judgement: Judgement | None = None  # None: it failed before its parts could be looked at
    content: Unstuffed | None = None
    reason: str = ""  # what is wrong, where there is no judgement


@dataclass
class Scan:
    frames: list[Found] = field(default_factory=list)
    fill: list[int] = field(default_factory=list)  # offsets of delimiters between frames
    blamed: dict[int, Candidate | None] = field(default_factory=dict)  # each discarded byte's offset; None: no start
    rejected: Counter[str] = field(default_factory=Counter)  # candidates, by cause

    @property
    def discarded(self) -> Counter[str]:
        """Bytes by cause."""
        return Counter("no_start" if c is None else c.cause for c in self.blamed.values())

    def reject(self, candidate: Candidate) -> None:
        """A candidate that is not rescanned: all its bytes carry its cause."""
        self.rejected[candidate.cause] += 1
        self.blamed.update(dict.fromkeys(range(candidate.offset, candidate.offset + candidate.extent), candidate))


def scan(protocol: Protocol, stream: bytes, sender: End | None) -> Scan:
    """Everything in ``stream``, as if nothing ever followed it."""
    frame = protocol.frame
    if frame.ends_by_silence:
        return _between_silences(protocol, stream, sender)
    if frame.delimiter is None:
        return _by_start(protocol, stream, sender)
    if frame.opening in (None, frame.delimiter):
        return _between_delimiters(protocol, stream, sender, frame.delimiter)
    assert frame.opening is not None
    return _in_brackets(protocol, stream, sender, frame.opening, frame.delimiter)


def start_bytes(protocol: Protocol, sender: End | None) -> set[int]:
    """The values that a frame's first byte can have, as far as its constants tell."""
    starts = set()
    for form in forms(protocol, sender):
        first = form.parts[0]
        if first.kind in CONSTANTS:
            starts.add(first.value[0])
            continue
        mask, value = fixed_bits(first, form.bits)
        place = 8 * (first.size - 1) if first.order == ByteOrder.BIG else 0
        mask, value = mask >> max(place, 0) & 0xFF, value >> max(place, 0) & 0xFF
        starts |= {byte for byte in range(256) if byte & mask == value}
    return starts


def longest_frame(protocol: Protocol, sender: End | None) -> int:
    """Of all forms of the frame the longest, before stuffing and without delimiters."""
    longest = 0
    for form in forms(protocol, sender):
        payload = form.parts[payload_index(form.parts)]
        size = payload.fixed_payload if payload.payload == PayloadRule.FIXED else protocol.frame.max_payload
        longest = max(longest, sum(part.size for part in form.parts) + size)
    return longest


def _by_start(protocol: Protocol, stream: bytes, sender: End | None) -> Scan:
    result = Scan()
    starts = start_bytes(protocol, sender)
    longest = longest_frame(protocol, sender)
    blame: Candidate | None = None
    at = 0
    while at < len(stream):
        if stream[at] in starts:
            data = stream[at : at + longest]
            judgement = judge(protocol, data, sender)
            if judgement.is_frame:
                content = plain(stream[at : at + judgement.extent])
                result.frames.append(Found(at, judgement.extent, judgement, content, at))
                at += judgement.extent
                continue
            left = len(stream) - at
            extent = left if judgement.outcome == Outcome.INCOMPLETE else judgement.extent
            candidate = Candidate(at, extent, judgement.cause, at, None, judgement, plain(data))
            result.rejected[judgement.cause] += 1
            if blame is None or at + extent > max(blame.offset + blame.extent, at):
                blame = candidate
        result.blamed[at] = blame if blame is not None and at < blame.offset + blame.extent else None
        at += 1
    return result


def _between_delimiters(protocol: Protocol, stream: bytes, sender: End | None, delimiter: int) -> Scan:
    result = Scan()
    at = 0
    while at < len(stream):
        lead = int(stream[at] == delimiter)
        if lead and (at + 1 == len(stream) or stream[at + 1] == delimiter):
            result.fill.append(at)
            at += 1
            continue
        end = stream.find(bytes([delimiter]), at + lead)
        if end < 0:
            result.reject(_unended(protocol, stream, sender, at, at + lead, len(stream), delimiter))
            return result
        judged = _judge_block(protocol, stream, sender, at, at + lead, end)
        if isinstance(judged, Found):
            result.frames.append(judged)
            at = end + 1
        else:
            result.reject(judged)
            at = end
    return result


def _in_brackets(protocol: Protocol, stream: bytes, sender: End | None, opening: int, closing: int) -> Scan:
    result = Scan()
    longest = _longest_on_wire(protocol, sender)
    at = 0
    while at < len(stream):
        if stream[at] != opening:
            result.blamed[at] = None
            at += 1
            continue
        end = next((i for i in range(at + 1, len(stream)) if stream[i] in (opening, closing)), len(stream))
        if end == len(stream) or stream[end] == opening or end - at >= longest:
            result.reject(_unended(protocol, stream, sender, at, at + 1, end, closing))
            at = end
            continue
        judged = _judge_block(protocol, stream, sender, at, at + 1, end)
        if isinstance(judged, Found):
            result.frames.append(judged)
        else:
            result.reject(replace(judged, extent=end + 1 - at))  # the closing one opens nothing
        at = end + 1
    return result


def _between_silences(protocol: Protocol, stream: bytes, sender: End | None) -> Scan:
    """Bytes without times are one block."""
    result = Scan()
    if not stream:
        return result
    judged = _judge_block(protocol, stream, sender, 0, 0, len(stream), closed=False)
    if isinstance(judged, Found):
        result.frames.append(judged)
    else:
        result.reject(judged)
    return result


def _longest_on_wire(protocol: Protocol, sender: End | None) -> int:
    longest = longest_frame(protocol, sender)
    return longest + overhead(protocol.frame, longest) + 2


def _unended(
    protocol: Protocol, stream: bytes, sender: End | None, offset: int, begin: int, end: int, closing: int
) -> Candidate:
    size, longest = end - offset, _longest_on_wire(protocol, sender)
    cause = "length_out_of_range" if size >= longest else "incomplete"
    reason = f"{size} bytes without a delimiter; the largest frame has {longest}"
    if size < longest:
        reason = f"the delimiter {closing:02X} that ends the frame is missing"
        if end < len(stream):
            reason = f"another frame opens at {end}, before the delimiter {closing:02X} that ends this one"
    return Candidate(offset, size, cause, begin, end, reason=reason)


def _judge_block(
    protocol: Protocol, stream: bytes, sender: End | None, offset: int, begin: int, end: int, *, closed: bool = True
) -> Found | Candidate:
    frame = protocol.frame
    block = stream[begin:end]
    longest = longest_frame(protocol, sender)
    most = longest + overhead(frame, longest)
    extent = end - offset
    if len(block) > most:
        reason = f"{len(block)} bytes are more than the {most} that a frame can have"
        return Candidate(offset, extent, "length_out_of_range", begin, end, reason=reason)
    content = unstuff(frame, block)
    if isinstance(content, Impossible):
        reason = f"at {begin + content.at}: {content.reason}"
        return Candidate(offset, extent, "bad_stuffing", begin, end, reason=reason)
    judgement = judge(protocol, content.data, sender, whole=True)
    if judgement.is_frame:
        return Found(offset, end + closed - offset, judgement, content, begin)
    return Candidate(offset, extent, judgement.cause, begin, end, judgement, content)
