"""One frame: its parts in their order, the size of its payload, and what refuses it."""

from __future__ import annotations

from tests.reference.checks import check_holds
from tests.reference.conditions import Header, Sizes, telling_values, truth
from tests.reference.header import CONSTANTS, fixed_bits_hold, header_values, read_header
from tests.reference.match import Seen, find, header_numbers, is_late
from tests.reference.messages import fits
from tests.reference.order import order_of
from tests.reference.outcome import Incomplete, Rejected
from tests.reference.payload import Broken, TooShort, constants_hold, counted_size, most_bytes
from tests.reference.sizes import longest_frame
from tests.reference.stuffing import overhead, undone, unstuffed
from wirebond.protocol.model import (
    BitRole,
    End,
    LengthCounts,
    Message,
    Part,
    PartKind,
    PayloadRule,
    Protocol,
    Subject,
)

# Causes, as one after the other can be decided. Stuffing is undone before.
IN_ORDER = (
    "constant_mismatch", "length_out_of_range", "unknown_message", "header_check_mismatch", "check_mismatch",
)  # fmt: skip


def examine_start(protocol: Protocol, data: bytes, sender: End | None) -> tuple[int, int, str, dict[str, object]]:
    """Size on the wire, id, message name and header values of the frame at the start of ``data``; raises Rejected or
    Incomplete."""
    if protocol.format.is_sized:
        return _examine_sized(protocol, data, sender)
    return _examine(protocol, data, sender, None)


def examine_block(protocol: Protocol, block: bytes, sender: End | None) -> tuple[int, str, dict[str, object]]:
    """The same, but for the size, of a frame whose ends are known."""
    longest = longest_frame(protocol, sender)
    if len(block) > longest + overhead(protocol, longest):
        raise Rejected("length_out_of_range", 0)
    frame = unstuffed(protocol, block)
    if frame is None:
        raise Rejected("bad_stuffing", 0)
    try:
        _, message_id, name, header = _examine(protocol, frame, sender, block)
    except Incomplete:
        raise Rejected("length_out_of_range", 0) from None
    return message_id, name, header


def _examine_sized(protocol: Protocol, data: bytes, sender: End | None) -> tuple[int, int, str, dict[str, object]]:
    """Of a stuffed frame that its length ends. Sizes and extents are those on the wire."""
    parts = protocol.format.parts
    payload_at = next(i for i, p in enumerate(parts) if p.kind == PartKind.PAYLOAD)
    prefix = sum(part.size for part in parts[:payload_at])
    back = sum(part.size for part in parts[max(i for i, p in enumerate(parts) if not p.is_plain) + 1 :])
    size = seen = 0
    while size == 0:  # counts within the payload are read one after the other
        head = undone(protocol, data, prefix + seen, None)
        try:
            _examine(protocol, head.data, sender, None)
            size = len(head.data)  # there is nothing behind it
        except Rejected as outcome:
            raise Rejected(outcome.cause, head.used if outcome.extent > 1 else outcome.extent) from None
        except Incomplete as waits:
            size = waits.size
        if head.is_bad:
            raise Rejected("bad_stuffing", head.used + 1)
        if not head.is_complete:
            raise Incomplete
        seen += 1
    if protocol.format.length_on_wire:
        wire, end = size, size - back
        if len(data) < wire:
            raise Incomplete
        if head.used > end:
            raise Rejected("length_out_of_range", wire)
        inner = undone(protocol, data[:end], None, None)
        if inner.is_bad or not inner.is_complete:
            raise Rejected("bad_stuffing", inner.used + 1 if inner.is_bad else wire)
        content = inner.data + data[end:wire]
    else:
        whole = undone(protocol, data, size, size - back)
        if whole.is_bad:
            raise Rejected("bad_stuffing", whole.used + 1)
        if not whole.is_complete:
            raise Incomplete
        content, wire = whole.data, whole.used
    try:
        _, message_id, name, header = _examine(protocol, content, sender, data[:wire])
    except Rejected as outcome:
        raise Rejected(outcome.cause, wire) from None
    except Incomplete:
        raise Rejected("length_out_of_range", wire) from None
    return wire, message_id, name, header


def _examine(
    protocol: Protocol, data: bytes, sender: End | None, block: bytes | None
) -> tuple[int, int, str, dict[str, object]]:
    """Size, id, message name and header values of the frame at the start of ``data``; raises Rejected or Incomplete.

    Where conditions ask for the sender or for the payload's size, each possible answer is tried: the first that gives a
    frame counts, else the one that got furthest.
    """
    conditions = [part.condition for part in protocol.format.parts if part.condition is not None]
    compared = dict.fromkeys(c for condition in conditions for c in condition.comparisons)
    sized = [c for c in compared if c.subject == Subject.SIZE]
    asks = any(c.subject == Subject.SENDER for c in compared)
    senders = (sender,) if sender in (End.HOST, End.MCU) or not asks else (End.HOST, End.MCU)
    sizes = sorted(telling_values(sized, 0xFFFF))
    furthest: Rejected | None = None
    waits: Incomplete | None = None  # the one that needs least
    for end in senders:
        for holding in dict.fromkeys(frozenset(c for c in sized if c.holds(n)) for n in sizes):
            try:
                return _examine_as(protocol, data, sender, block, end, holding)
            except Incomplete as found:
                waits = found if waits is None or found.size < waits.size else waits
            except Rejected as rejected:
                reach = (rejected.extent, IN_ORDER.index(rejected.cause))
                if furthest is None or reach > (furthest.extent, IN_ORDER.index(furthest.cause)):
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
    header, before = read_header(frame_format.parts[:payload_at], data, Header(end), holding)
    after = [
        p
        for p in frame_format.parts[payload_at + 1 :]
        if p.condition is None or truth(p.condition, header, holding) is True
    ]
    parts = (*before, frame_format.parts[payload_at], *after)
    prefix, suffix = sum(p.size for p in before), sum(p.size for p in after)

    size, known_size = _payload_size(protocol, parts, header, data, prefix, suffix, sender, block is not None)
    late_match = is_late(protocol, sender)
    early_id = header.id is not None and not late_match
    message_id = header.id
    numbers = header_numbers(before, data, 0)
    message = None if late_match else find(protocol, Seen(header.id, numbers, size), sender)
    late_id = late_match or (
        not early_id and any(p.kind == PartKind.ID or any(run.role == BitRole.ID for run in p.bits) for p in after)
    )
    trims = frame_format.parts[payload_at].trims_zeros
    if not (late_id and trims) and not _sizes_hold(parts[len(before)], message, size, header, holding):
        raise Rejected("length_out_of_range", prefix)
    if (
        early_id
        and not frame_format.deliver_unknown
        and (block is not None or not frame_format.length_on_wire)
        and not fits(frame_format.parts[payload_at], message, size, known_size)
    ):
        raise Rejected("unknown_message", prefix)

    header_parts = {id(p) for p in before}
    places = {id(p): i for i, p in enumerate(frame_format.parts)}
    for part in before:  # checks of the header
        if (
            part.kind == PartKind.CHECK
            and max(part.covered) < payload_at
            and not check_holds(frame_format.parts, parts, places[id(part)], data, data, payload_at, 0, message)
        ):
            raise Rejected("header_check_mismatch", prefix)

    total = prefix + size + suffix
    if block is not None and total != len(data):
        raise Rejected("length_out_of_range", len(data))
    if len(data) < total:
        raise Incomplete(total)
    data = data[:total]

    at = prefix + size
    for part in after:
        piece = data[at : at + part.size]
        number = int.from_bytes(piece, order_of(part.order))
        if part.kind in CONSTANTS and piece != part.value:
            raise Rejected("constant_mismatch", total)
        if not fixed_bits_hold(part, piece):
            raise Rejected("constant_mismatch", total)
        for run in part.bits:
            if run.role == BitRole.ID:
                message_id = number >> run.shift & run.mask
        if part.kind == PartKind.ID:
            message_id = number
        at += part.size
    if not early_id:
        numbers = header_numbers(parts, data, size)
        payload = data[prefix : prefix + size]
        message = find(protocol, Seen(message_id, numbers, size, payload, trims), sender)
        if late_id and trims and not _sizes_hold(parts[len(before)], message, size, header, holding):
            raise Rejected("length_out_of_range", total)
        if not frame_format.deliver_unknown and not fits(frame_format.parts[payload_at], message, size, known_size):
            raise Rejected("unknown_message", total)

    is_bounded = message is not None and not frame_format.deliver_unknown and not known_size
    if message is not None and is_bounded and size > most_bytes(message.fields, data[prefix : prefix + size]):
        raise Rejected("unknown_message", total)
    trims = frame_format.parts[payload_at].trims_zeros
    decodable = message is not None and (trims or size >= message.min_payload)
    if message is not None and decodable and not constants_hold(message.fields, data[prefix : prefix + size], trims):
        raise Rejected("constant_mismatch", total)

    for part in parts:
        in_header = id(part) in header_parts and max(part.covered) < payload_at
        if (
            part.kind == PartKind.CHECK
            and not in_header
            and not check_holds(
                frame_format.parts, parts, places[id(part)], data, block or data, payload_at, size, message
            )
        ):
            raise Rejected("check_mismatch", total)
    name = message.name if message is not None and decodable else "unknown"
    return total, message_id or 0, name, header_values(parts, data, size)


def _sizes_hold(payload: Part, message: Message | None, size: int, header: Header, holding: Sizes) -> bool:
    """Has the payload, with its zeros put back, a size as it was taken to have? The end of a frame that is found by its
    delimiter or its silence says nothing about that."""
    if payload.payload == PayloadRule.REST:
        return True
    whole = max(size, message.min_payload) if payload.trims_zeros and message is not None else size
    return all(compared.holds(whole) == (compared in holding) for compared in header.asked)


def _payload_size(
    protocol: Protocol,
    parts: tuple[Part, ...],
    header: Header,
    data: bytes,
    prefix: int,
    suffix: int,
    sender: End | None,
    is_whole: bool,
) -> tuple[int, bool]:
    """Payload bytes, and whether the format itself fixes them."""
    payload = next(p for p in parts if p.kind == PartKind.PAYLOAD)
    most = protocol.format.max_payload_from(sender)
    if payload.payload == PayloadRule.FIXED:
        return payload.fixed_payload, True
    if payload.payload == PayloadRule.REST:
        size = len(data) - prefix - suffix
        if not 0 <= size <= most:
            raise Rejected("length_out_of_range", len(data))
        return size, False
    if payload.payload == PayloadRule.BY_ID:
        before = list(parts[: parts.index(payload)])
        message = find(protocol, Seen(header.id, header_numbers(before, data, 0)), sender)
        if message is None:
            raise Rejected("unknown_message", prefix)
        if message.min_payload == message.max_payload:
            return message.max_payload, True
        try:
            return counted_size(message.fields, data[prefix:]), True
        except TooShort:
            raise Incomplete from None
        except Broken:
            raise Rejected("length_out_of_range", prefix) from None
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
        most += overhead(protocol, longest_frame(protocol, sender))
    if not 0 <= size <= most:
        raise Rejected("length_out_of_range", prefix)
    if protocol.format.length_on_wire and is_whole:
        size = len(data) - prefix - suffix
        if not 0 <= size <= protocol.format.max_payload_from(sender):
            raise Rejected("length_out_of_range", 0)
    return size, False
