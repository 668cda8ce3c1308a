"""A slow and obvious decoder: the whole stream in one piece, bit-by-bit checks, straight from the parts of the model.

It shares no code with the engine: no plan, no tables, no state between calls. Tests compare the two, byte for byte.
"""

from __future__ import annotations

import itertools
import re
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import Literal

from tests.reference_payload import Broken, TooShort, constants_hold, counted_size
from wirebond.protocol.model import (
    Algorithm,
    BitRole,
    ByteOrder,
    CheckKind,
    Comparison,
    Condition,
    End,
    Escapes,
    Field,
    FieldKind,
    LengthCounts,
    Message,
    Part,
    PartKind,
    PayloadRule,
    Protocol,
    Stuffing,
    Subject,
)

CONSTANTS = (PartKind.CONSTANT, PartKind.TAIL)


@dataclass(frozen=True)
class Frame:
    offset: int
    wire: bytes
    id: int
    name: str  # of the message, or "unknown"
    header: dict[str, object] = field(default_factory=dict)


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
    """``size``: of the whole frame, where that is known."""

    def __init__(self, size: int = 0) -> None:
        self.size = size


def decode(protocol: Protocol, stream: bytes, sender: End | None = None, request: str | None = None) -> Result:
    """Everything in ``stream``, as if nothing ever followed it. ``request`` went out before it."""
    protocol = replace(protocol, messages=_meant(protocol, sender, request))
    frame_format = protocol.format
    if frame_format.ends_by_silence:
        return _decode_block(protocol, stream, sender)
    if frame_format.delimiter is None:
        return _decode_by_start(protocol, stream, sender)
    if frame_format.opening in (None, frame_format.delimiter):
        return _decode_delimited(protocol, stream, sender)
    return _decode_bracketed(protocol, stream, sender)


def _meant(protocol: Protocol, sender: End | None, request: str | None) -> tuple[Message, ...]:
    """Without replies that share an id and were not asked for; the one that was goes before all others."""
    replies = {m.name: m.reply for m in protocol.messages if m.reply}
    sent = [m for m in protocol.messages if m.sent_by(sender)]
    meant = []
    for message in sent:
        shares = any((m.id, m.has_id) == (message.id, message.has_id) and m is not message for m in sent)
        if not shares or message.name not in replies.values():
            meant.append(message)
        elif message.name == replies.get(request or ""):
            meant.insert(0, message)
    return tuple(meant)


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
    header = _longest(protocol.format.parts[:payload_at], sender)
    blame_end, blame = 0, ""
    at = 0
    while at < len(stream):
        failed = 1
        if _may_start(protocol, stream[at], sender):
            try:
                examined = _examine_sized if protocol.format.is_sized else _examine_plain
                size, message_id, name, header_values = examined(protocol, stream[at:], sender)
            except _Rejected as outcome:
                cause, extent = outcome.cause, outcome.extent
            except _Incomplete:
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


def _examine_plain(protocol: Protocol, data: bytes, sender: End | None) -> tuple[int, int, str, dict[str, object]]:
    return _examine(protocol, data, sender, None)


def _examine_sized(protocol: Protocol, data: bytes, sender: End | None) -> tuple[int, int, str, dict[str, object]]:
    """The same for a stuffed frame that its length ends. Sizes and extents are those on the wire."""
    parts = protocol.format.parts
    payload_at = next(i for i, p in enumerate(parts) if p.kind == PartKind.PAYLOAD)
    prefix = sum(part.size for part in parts[:payload_at])
    back = sum(part.size for part in parts[max(i for i, p in enumerate(parts) if not p.is_plain) + 1 :])
    head = _undone(protocol, data, prefix, None)
    try:
        _examine(protocol, head.data, sender, None)
        size = prefix  # there is nothing behind the header
    except _Rejected as outcome:
        raise _Rejected(outcome.cause, head.used if outcome.extent > 1 else outcome.extent) from None
    except _Incomplete as waits:
        size = waits.size
    if head.is_bad:
        raise _Rejected("bad_stuffing", head.used + 1)
    if not head.is_complete:
        raise _Incomplete
    if protocol.format.length_on_wire:
        wire, end = size, size - back
        if len(data) < wire:
            raise _Incomplete
        if head.used > end:
            raise _Rejected("length_out_of_range", wire)
        inner = _undone(protocol, data[:end], None, None)
        if inner.is_bad or not inner.is_complete:
            raise _Rejected("bad_stuffing", inner.used + 1 if inner.is_bad else wire)
        content = inner.data + data[end:wire]
    else:
        whole = _undone(protocol, data, size, size - back)
        if whole.is_bad:
            raise _Rejected("bad_stuffing", whole.used + 1)
        if not whole.is_complete:
            raise _Incomplete
        content, wire = whole.data, whole.used
    try:
        _, message_id, name, header = _examine(protocol, content, sender, data[:wire])
    except _Rejected as outcome:
        raise _Rejected(outcome.cause, wire) from None
    except _Incomplete:
        raise _Rejected("length_out_of_range", wire) from None
    return wire, message_id, name, header


@dataclass(frozen=True)
class _Undone:
    """What the first ``used`` bytes were before stuffing. ``is_bad``: the byte behind them is none that a sender makes;
    ``is_complete``: they are all that was asked for, and no half of a pair is left."""

    data: bytes
    used: int
    is_bad: bool
    is_complete: bool


def _undone(protocol: Protocol, wire: bytes, count: int | None, stuffed_end: int | None) -> _Undone:
    """The first ``count`` bytes of the frame; None: all. Those from ``stuffed_end`` on were not stuffed."""
    frame_format = protocol.format
    front = sum(part.size for part in frame_format.parts[: [p.is_plain for p in frame_format.parts].index(False)])
    magic = frame_format.parts[0]
    starts = {value[0] for value in _magics(magic, None)} if frame_format.escapes is not None else set()
    out = bytearray()
    at = 0
    owes = False
    while at < len(wire) and (len(out) != count or owes):
        if owes:
            assert frame_format.insertion is not None
            if wire[at] != frame_format.insertion.byte:
                return _Undone(bytes(out), at, True, False)
            at, owes = at + 1, False
            continue
        stuffed = front <= len(out) and (stuffed_end is None or len(out) < stuffed_end)
        byte, size = wire[at], 1
        if stuffed and frame_format.escapes is not None:
            if byte in starts:
                return _Undone(bytes(out), at, True, False)
            if byte == frame_format.escapes.escape:
                if at + 1 == len(wire):
                    return _Undone(bytes(out), at, False, False)
                if wire[at + 1] in starts:
                    return _Undone(bytes(out), at + 1, True, False)
                byte, size = wire[at + 1] ^ frame_format.escapes.exclusive_or, 2
        out.append(byte)
        at += size
        if stuffed and frame_format.insertion is not None:
            owes = bytes(out[front:]).endswith(frame_format.insertion.after)
    return _Undone(bytes(out), at, False, not owes and count in (None, len(out)))


def _may_start(protocol: Protocol, byte: int, sender: End | None) -> bool:
    """Is this byte the first of a frame, as far as its constants tell? A part that need not be there may be missing."""
    parts = [
        part
        for part in protocol.format.parts
        if part.condition is None or _truth(part.condition, _Header(sender=sender), None) is not False
    ]
    if any(part.kind == PartKind.MAGIC for part in protocol.format.parts):
        return any(value[0] == byte for part in parts if part.kind == PartKind.MAGIC for value in _magics(part, sender))
    for part in parts:
        starts = part.value[0] == byte if part.kind in CONSTANTS else _fixed_bits_hold(part, bytes([byte]))
        if starts or part.condition is None:
            return starts
    return True


def _decode_delimited(protocol: Protocol, stream: bytes, sender: End | None) -> Result:
    result = Result()
    assert protocol.format.delimiter is not None
    delimiter = protocol.format.delimiter
    opens = protocol.format.opening is not None  # or delimiters only end frames
    longest = _longest_on_wire(protocol, sender)
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
                raise _Rejected("length_out_of_range" if end - at >= longest else "incomplete", 0)
            message_id, name, header = _examine_block(protocol, stream[begin:end], sender)
        except _Rejected as outcome:
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
    longest = _longest_on_wire(protocol, sender)
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
                    raise _Rejected(outcome, 0)
                message_id, name, header = _examine_block(protocol, content, sender)
            except _Rejected as rejected:
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
        message_id, name, header = _examine_block(protocol, block, sender)
    except _Rejected as outcome:
        result.rejected_candidates[outcome.cause] += 1
        result.discarded_bytes[outcome.cause] += len(block)
    else:
        result.frames.append(Frame(0, block, message_id, name, header))
    return result


def _longest_frame(protocol: Protocol, sender: End | None) -> int:
    """Of all forms of this sender's frames the longest, before stuffing."""
    return _longest(protocol.format.parts, sender) + protocol.format.max_payload


def _longest(parts: tuple[Part, ...], sender: End | None) -> int:
    """The most bytes that these parts have together, whichever of them are there: every header is tried that could
    make a difference."""
    conditions = [part.condition for part in parts if part.condition is not None]
    compared = list(dict.fromkeys(c for condition in conditions for c in condition.comparisons))
    magics = [value for part in parts if part.kind == PartKind.MAGIC for value in _magics(part, sender)] or [b""]
    names = list(
        dict.fromkeys((c.subject, c.name) for c in compared if c.subject not in (Subject.MAGIC, Subject.SENDER))
    )
    longest = 0
    for end, magic in itertools.product((End.HOST, End.MCU) if sender is None else (sender,), magics):
        for values in itertools.product(
            *(_telling_values([c for c in compared if (c.subject, c.name) == n], _most(parts, *n)) for n in names)
        ):
            known = dict(zip(names, values, strict=True))
            header = _Header(sender=end, magic=magic)
            size = 0
            for part in parts:
                if part.condition is not None and _truth(part.condition, header, frozenset(), known) is not True:
                    continue
                size += part.size
                for name in (part.name, *(run.name for run in part.bits)):
                    header.numbers[name] = known.get((Subject.FIELD, name), 0)
                if part.kind == PartKind.ID or any(run.role == BitRole.ID for run in part.bits):
                    header.id = known.get((Subject.ID, ""), 0)
            longest = max(longest, size)
    return longest


def _most(parts: tuple[Part, ...], subject: Subject, name: str) -> int:
    """The greatest value of what is compared."""
    if subject == Subject.SIZE:
        return 0xFFFF
    wholes = [part.size for part in parts if (part.kind == PartKind.ID if subject == Subject.ID else part.name == name)]
    role = BitRole.ID if subject == Subject.ID else None
    runs = [run.mask for part in parts for run in part.bits if (run.role == role if role else run.name == name)]
    return max([*(256**size - 1 for size in wholes), *runs])


def _telling_values(compared: list[Comparison], most: int) -> set[int]:
    """Values of one number, up to its greatest, among which each answer to these comparisons occurs."""
    bounds = {0} | {n for c in compared for low, high in c.ranges for n in (low - 1, low, high, high + 1) if n >= 0}
    masks = [c.mask for c in compared if c.mask is not None]
    found = set(bounds)
    for size in range(1, len(masks) + 1):
        for some in itertools.combinations(masks, size):
            together = 0
            for mask in some:
                together |= mask
            found |= {value | together for value in bounds} | {value & ~together for value in bounds}
    return {value for value in found if value <= most}


def _longest_on_wire(protocol: Protocol, sender: End | None) -> int:
    longest = _longest_frame(protocol, sender)
    closing = protocol.format.delimiter or b""
    return longest + _overhead(protocol, longest) + len(protocol.format.opening or closing) + len(closing)


def _overhead(protocol: Protocol, size: int) -> int:
    if protocol.format.insertion is not None:
        return size // len(protocol.format.insertion.after)
    return {Stuffing.NONE: 0, Stuffing.COBS: 1 + size // 254}.get(protocol.format.stuffing, size)


def _examine_block(protocol: Protocol, block: bytes, sender: End | None) -> tuple[int, str, dict[str, object]]:
    longest = _longest_frame(protocol, sender)
    if len(block) > longest + _overhead(protocol, longest):
        raise _Rejected("length_out_of_range", 0)
    frame = _unstuffed(protocol, block)
    if frame is None:
        raise _Rejected("bad_stuffing", 0)
    try:
        _, message_id, name, header = _examine(protocol, frame, sender, block)
    except _Incomplete:
        raise _Rejected("length_out_of_range", 0) from None
    return message_id, name, header


def _unstuffed(protocol: Protocol, block: bytes) -> bytes | None:
    """What the sender stuffed, and around it what it sent as it is."""
    if protocol.format.stuffing == Stuffing.NONE:
        return block
    stuffed = [i for i, part in enumerate(protocol.format.parts) if not part.is_plain]
    front = sum(part.size for part in protocol.format.parts[: stuffed[0]])
    back = sum(part.size for part in protocol.format.parts[stuffed[-1] + 1 :])
    if len(block) < front + back:
        return None
    middle = block[front : len(block) - back]
    escapes = protocol.format.escapes
    if protocol.format.stuffing == Stuffing.HEX:
        content = bytes.fromhex(middle.decode()) if re.fullmatch(rb"([0-9A-Fa-f]{2})*", middle) else None
    else:
        content = unescape(escapes, middle) if escapes is not None else uncobs(middle)
    return None if content is None else block[:front] + content + block[len(block) - back :]


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


def unescape(rule: Escapes, block: bytes) -> bytes | None:
    """Escapes undone; None where one stands at the end or has a code that means nothing."""
    out = bytearray()
    stream = iter(block)
    for byte in stream:
        if byte != rule.escape:
            out.append(byte)
            continue
        code = next(stream, None)
        if code is None:
            return None
        plain = code ^ rule.exclusive_or if rule.exclusive_or else {c: p for p, c in rule.pairs}.get(code)
        if plain is None:
            return None
        out.append(plain)
    return bytes(out)


def _magics(part: Part, sender: End | None) -> list[bytes]:
    if part.by_sender:
        return [value for end, value in part.by_sender if sender in (None, end)]
    return list(part.alternatives or (part.value,))


@dataclass
class _Header:
    """What the parts before the payload say."""

    sender: End | None = None
    magic: bytes = b""
    numbers: dict[str, int] = field(default_factory=dict)
    id: int | None = None
    length: int | None = None
    asked: set[Comparison] = field(default_factory=set)  # of the payload's size


Known = dict[tuple[Subject, str], int]
Sizes = frozenset[Comparison]  # of the payload: those comparisons that are taken to hold


def _truth(condition: Condition, header: _Header, sizes: Sizes | None, known: Known | None = None) -> bool | None:
    """Does it hold? None where that depends on what is not known. ``sizes``: None if nothing is known of the payload's
    size; ``known``: numbers that are taken for granted. What is asked of ``sizes`` is noted in the header."""
    if sizes is not None and known is None:
        without = _truth(condition, header, None)
        if without is not None:
            return without
    whole: bool | None = True
    for term in condition.terms:
        answer = _holds_now(term, header, sizes, known)
        if answer is False:
            return condition.negated
        if answer is None:
            whole = None
    return None if whole is None else not condition.negated


def _holds_now(term: Comparison | Condition, header: _Header, sizes: Sizes | None, known: Known | None) -> bool | None:
    if isinstance(term, Condition):
        return _truth(term, header, sizes, known)
    if term.subject == Subject.SENDER:
        ends = (End.HOST, End.MCU)
        return None if header.sender not in ends else term.holds(ends.index(header.sender))
    if term.subject == Subject.MAGIC:
        return bool(header.magic) and term.holds(int.from_bytes(header.magic, "big"))
    if term.subject == Subject.SIZE:
        if known is not None:
            return term.holds(known[Subject.SIZE, ""])
        if sizes is None:
            return None
        header.asked.add(term)
        return term in sizes
    if term.subject == Subject.ID:
        return header.id is not None and term.holds(header.id)
    return term.name in header.numbers and term.holds(header.numbers[term.name])


def _examine(
    protocol: Protocol, data: bytes, sender: End | None, block: bytes | None
) -> tuple[int, int, str, dict[str, object]]:
    """Size, id, message name and header values of the frame at the start of ``data``; raises _Rejected or _Incomplete.

    Where conditions ask for the sender or for the payload's size, each possible answer is tried: the first that gives a
    frame counts, else the one that got furthest.
    """
    conditions = [part.condition for part in protocol.format.parts if part.condition is not None]
    compared = dict.fromkeys(c for condition in conditions for c in condition.comparisons)
    sized = [c for c in compared if c.subject == Subject.SIZE]
    asks = any(c.subject == Subject.SENDER for c in compared)
    senders = (sender,) if sender in (End.HOST, End.MCU) or not asks else (End.HOST, End.MCU)
    sizes = sorted(_telling_values(sized, 0xFFFF))
    furthest: _Rejected | None = None
    waits: _Incomplete | None = None  # the one that needs least
    for end in senders:
        for holding in dict.fromkeys(frozenset(c for c in sized if c.holds(n)) for n in sizes):
            try:
                return _examine_as(protocol, data, sender, block, end, holding)
            except _Incomplete as found:
                waits = found if waits is None or found.size < waits.size else waits
            except _Rejected as rejected:
                reach = (rejected.extent, rejected.cause != "constant_mismatch")
                if furthest is None or reach > (furthest.extent, furthest.cause != "constant_mismatch"):
                    furthest = rejected
    if waits is not None:
        raise waits
    assert furthest is not None
    raise furthest


def _examine_as(
    protocol: Protocol,
    data: bytes,
    sender: End | None,
    block: bytes | None,
    end: End | None,
    holding: Sizes,
) -> tuple[int, int, str, dict[str, object]]:
    """As `_examine`, if ``end`` sent it and its payload has a size with which ``holding`` hold, and no others.

    ``block``: the frame ends where ``data`` does, and was this on the wire.
    """
    frame_format = protocol.format
    payload_at = next(i for i, p in enumerate(frame_format.parts) if p.kind == PartKind.PAYLOAD)
    header, before = _read_header(frame_format.parts[:payload_at], data, _Header(end), holding)
    after = [
        p
        for p in frame_format.parts[payload_at + 1 :]
        if p.condition is None or _truth(p.condition, header, holding) is True
    ]
    parts = (*before, frame_format.parts[payload_at], *after)
    prefix, suffix = sum(p.size for p in before), sum(p.size for p in after)

    size, known_size = _payload_size(protocol, parts, header, data, prefix, suffix, sender, block is not None)
    early_id = header.id is not None
    message_id = header.id
    message = _message(protocol, header.id, sender)
    late_id = not early_id and any(
        p.kind == PartKind.ID or any(run.role == BitRole.ID for run in p.bits) for p in after
    )
    trims = frame_format.parts[payload_at].trims_zeros
    if not (late_id and trims) and not _sizes_hold(parts[len(before)], message, size, header, holding):
        raise _Rejected("length_out_of_range", prefix)
    if (
        early_id
        and not frame_format.deliver_unknown
        and (block is not None or not frame_format.length_on_wire)
        and not _fits(frame_format.parts[payload_at], message, size, known_size)
    ):
        raise _Rejected("unknown_message", prefix)

    header_parts = {id(p) for p in before}
    places = {id(p): i for i, p in enumerate(frame_format.parts)}
    for part in before:  # checks of the header
        if (
            part.kind == PartKind.CHECK
            and part.last < payload_at
            and not _holds(frame_format.parts, parts, places[id(part)], data, data, payload_at, 0, message)
        ):
            raise _Rejected("header_check_mismatch", prefix)

    total = prefix + size + suffix
    if block is not None and total != len(data):
        raise _Rejected("length_out_of_range", len(data))
    if len(data) < total:
        raise _Incomplete(total)
    data = data[:total]

    at = prefix + size
    for part in after:
        piece = data[at : at + part.size]
        number = int.from_bytes(piece, _order(part.order))
        if part.kind in CONSTANTS and piece != part.value:
            raise _Rejected("constant_mismatch", total)
        if not _fixed_bits_hold(part, piece):
            raise _Rejected("constant_mismatch", total)
        for run in part.bits:
            if run.role == BitRole.ID:
                message_id = number >> run.shift & run.mask
        if part.kind == PartKind.ID:
            message_id = number
        at += part.size
    if not early_id:
        message = _message(protocol, message_id, sender)
        if late_id and trims and not _sizes_hold(parts[len(before)], message, size, header, holding):
            raise _Rejected("length_out_of_range", total)
        if not frame_format.deliver_unknown and not _fits(frame_format.parts[payload_at], message, size, known_size):
            raise _Rejected("unknown_message", total)

    trims = frame_format.parts[payload_at].trims_zeros
    decodable = message is not None and (trims or size >= message.min_payload)
    if message is not None and decodable and not constants_hold(message.fields, data[prefix : prefix + size], trims):
        raise _Rejected("constant_mismatch", total)

    for part in parts:
        in_header = id(part) in header_parts and part.last < payload_at
        if (
            part.kind == PartKind.CHECK
            and not in_header
            and not _holds(frame_format.parts, parts, places[id(part)], data, block or data, payload_at, size, message)
        ):
            raise _Rejected("check_mismatch", total)
    name = message.name if message is not None and decodable else "unknown"
    return total, message_id or 0, name, _header_values(parts, data, size)


def _sizes_hold(payload: Part, message: Message | None, size: int, header: _Header, holding: Sizes) -> bool:
    """Has the payload, with its zeros put back, a size as it was taken to have? The end of a frame that is found by its
    delimiter or its silence says nothing about that."""
    if payload.payload == PayloadRule.REST:
        return True
    whole = max(size, message.min_payload) if payload.trims_zeros and message is not None else size
    return all(compared.holds(whole) == (compared in holding) for compared in header.asked)


def _header_values(parts: tuple[Part, ...], data: bytes, payload_size: int) -> dict[str, object]:
    """What the header fields of these parts mean, by name."""
    found: dict[str, object] = {}
    at = 0
    for part in parts:
        size = payload_size if part.kind == PartKind.PAYLOAD else part.size
        number = int.from_bytes(data[at : at + size], "big" if part.kind == PartKind.MAGIC else _order(part.order))
        at += size
        if part.header is not None:
            found[part.header.name] = _meant_by(part.header.value, 8 * part.size, number)
        for run in part.bits:
            if run.header is not None:
                found[run.header.name] = _meant_by(run.header.value, run.width, number >> run.shift & run.mask)
    return found


def _meant_by(field: Field, width: int, bits: int) -> object:
    """A number's bits as the API gives them."""
    value = bits
    if field.kind == FieldKind.SIGNED and bits >> (width - 1):
        value = -(bits - 2 ** (width - 1)) if field.sign_magnitude else bits - 2**width
    names = {number: name for name, number in field.enum}
    if value in names:
        return names[value]
    if field.flags:
        known = [name for name, bit in field.flags if bits >> bit & 1]
        taken = sum(1 << bit for _, bit in field.flags)
        return known + [1 << bit for bit in range(width) if bits & ~taken & 1 << bit]
    if field.scale != 1 or field.offset != 0:
        return float(value * field.scale + field.offset)
    return value


def _read_header(parts: tuple[Part, ...], data: bytes, header: _Header, sizes: Sizes) -> tuple[_Header, list[Part]]:
    """Part by part: constants as soon as their bytes are there, then what the numbers say."""
    sender = header.sender
    present: list[Part] = []
    at = 0
    for part in parts:
        if part.condition is not None and _truth(part.condition, header, sizes) is not True:
            continue
        present.append(part)
        piece = data[at : at + part.size]
        if part.kind == PartKind.MAGIC:
            found = [m for m in _magics(part, sender) if m[: len(piece)] == piece]
            if not found:
                raise _Rejected("constant_mismatch", 1)
            header.magic = found[0]
        if part.kind in CONSTANTS and part.value[: len(piece)] != piece:
            raise _Rejected("constant_mismatch", 1)
        if not _fixed_bits_hold(part, piece):
            raise _Rejected("constant_mismatch", 1)
        if len(piece) < part.size:
            raise _Incomplete
        number = int.from_bytes(piece, _order(part.order))
        if part.kind == PartKind.ID:
            header.id = number
        elif part.kind == PartKind.LENGTH:
            header.length = number
        elif part.kind in (PartKind.FIELD, PartKind.SEQUENCE):
            header.numbers[part.name] = number
        for run in part.bits:
            value = number >> run.shift & run.mask
            if run.role == BitRole.ID:
                header.id = value
            elif run.role == BitRole.LENGTH:
                header.length = value
            else:
                header.numbers[run.name] = value
        at += part.size
    return header, present


def _fixed_bits_hold(part: Part, piece: bytes) -> bool:
    """Have those bytes of the part that are there the bits that never change?"""
    runs = [run for run in part.bits if run.role == BitRole.CONSTANT]
    masks = sum(run.mask << run.shift for run in runs).to_bytes(part.size, _order(part.order))
    values = sum(run.value << run.shift for run in runs).to_bytes(part.size, _order(part.order))
    return all(byte & mask == value for byte, mask, value in zip(piece, masks, values, strict=False))


def _payload_size(
    protocol: Protocol,
    parts: tuple[Part, ...],
    header: _Header,
    data: bytes,
    prefix: int,
    suffix: int,
    sender: End | None,
    is_whole: bool,
) -> tuple[int, bool]:
    """Payload bytes, and whether the format itself fixes them."""
    payload = next(p for p in parts if p.kind == PartKind.PAYLOAD)
    most = protocol.format.max_payload
    if payload.payload == PayloadRule.FIXED:
        return payload.fixed_payload, True
    if payload.payload == PayloadRule.REST:
        size = len(data) - prefix - suffix
        if not 0 <= size <= most:
            raise _Rejected("length_out_of_range", len(data))
        return size, False
    if payload.payload == PayloadRule.BY_ID:
        message = _message(protocol, header.id, sender)
        if message is None:
            raise _Rejected("unknown_message", prefix)
        if message.min_payload == message.max_payload:
            return message.max_payload, True
        try:
            return counted_size(message.fields, data[prefix:]), True
        except TooShort:
            raise _Incomplete from None
        except Broken:
            raise _Rejected("length_out_of_range", prefix) from None
    holds_length = [p.kind == PartKind.LENGTH or any(r.role == BitRole.LENGTH for r in p.bits) for p in parts]
    if True not in holds_length:
        return 0, False
    index = holds_length.index(True)
    length = parts[index]
    follows = sum(p.size for p in parts[index + 1 :])
    counted = {
        LengthCounts.PAYLOAD: 0,
        LengthCounts.REST: follows,
        LengthCounts.SELF_AND_REST: length.size + follows,
        LengthCounts.FRAME: prefix + suffix,
    }[length.counts]
    assert header.length is not None
    size = header.length * length.length_unit - counted - length.length_offset
    if protocol.format.length_on_wire:
        most += _overhead(protocol, _longest_frame(protocol, sender))
    if not 0 <= size <= most:
        raise _Rejected("length_out_of_range", prefix)
    if protocol.format.length_on_wire and is_whole:
        size = len(data) - prefix - suffix
        if not 0 <= size <= protocol.format.max_payload:
            raise _Rejected("length_out_of_range", 0)
    return size, False


def _order(order: ByteOrder) -> Literal["little", "big"]:
    return "little" if order == ByteOrder.LITTLE else "big"


def _message(protocol: Protocol, message_id: int | None, sender: End | None) -> Message | None:
    """None: the frame has no id."""
    key = (message_id or 0, message_id is not None)
    return next((m for m in protocol.messages if (m.id, m.has_id) == key and m.sent_by(sender)), None)


def _fits(payload: Part, message: Message | None, size: int, known_size: bool) -> bool:
    if message is None:
        return False
    return known_size or ((payload.trims_zeros or message.min_payload <= size) and size <= message.max_payload)


def _holds(
    everything: tuple[Part, ...],
    present: tuple[Part, ...],
    index: int,
    data: bytes,
    wire: bytes,
    payload_at: int,
    payload_size: int,
    message: Message | None,
) -> bool:
    """``wire``: what ``data`` was before unstuffing. ``index`` and ``payload_at`` count all parts of the format, there
    or not: those that are not have no bytes.
    """
    there = {id(p) for p in present}
    sizes = [payload_size if i == payload_at else p.size if id(p) in there else 0 for i, p in enumerate(everything)]
    part = everything[index]
    assert part.algorithm is not None
    covered = data[sum(sizes[: part.first]) : sum(sizes[: part.last + 1])]
    if part.is_plain and any(not other.is_plain for other in everything[part.first : part.last + 1]):
        covered = wire[sum(sizes[: part.first]) : len(wire) - sum(sizes[part.last + 1 :])]
    if part.seeded:
        covered += bytes([message.seed or 0 if message is not None else 0])
    at = sum(sizes[:index])
    piece = data[at : at + part.size]
    width = part.size
    if part.as_hex:
        width //= 2
        if not re.fullmatch(rb"[0-9A-Fa-f]*", piece):
            return False
        found = int(piece, 16)
    else:
        found = int.from_bytes(piece, _order(part.order))
    return found == (checksum(part.algorithm, covered) >> part.shift) % 256**width


def checksum(algorithm: Algorithm, data: bytes) -> int:
    """One bit at a time, as the definition says."""
    width = algorithm.width
    if algorithm.kind == CheckKind.XOR:
        value = algorithm.init
        for byte in data:
            value ^= byte
        return value ^ algorithm.xorout
    if algorithm.kind == CheckKind.SUM:
        value = algorithm.init + sum(data)
        return (-value if algorithm.negate else value) % 2**width ^ algorithm.xorout
    if algorithm.kind == CheckKind.FLETCHER:
        modulus = algorithm.modulus or 2 ** (width // 2)
        first = second = 0
        for byte in data:
            first = (first + byte) % modulus
            second = (second + first) % modulus
        return second << (width // 2) | first
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
