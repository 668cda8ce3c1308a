"""Guesses at format and sender: what the length counts, byte orders, constants, unknown messages, the other end."""

from __future__ import annotations

import itertools
from dataclasses import replace

from wirebond.analysis.explain.counted import bound_by_counts
from wirebond.analysis.explain.guesses.guess import (
    Case,
    Guess,
    Guesses,
    constants_as_found,
    spelled,
    with_format,
    with_part,
)
from wirebond.analysis.explain.layout import (
    CONSTANTS,
    counted_beside_payload,
    hex_of,
    id_index,
    id_text,
    length_index,
    payload_index,
)
from wirebond.analysis.explain.sharing import sharing, wanted_text
from wirebond.analysis.explain.verdict import Verdict
from wirebond.protocol.meaning.messages import receiver_of, spoken
from wirebond.protocol.model import (
    ByteOrder,
    End,
    Field,
    FieldKind,
    LengthCounts,
    Message,
    Part,
    PartKind,
    PayloadRule,
    Protocol,
)
from wirebond.protocol.spelling import bytes_text

_COUNTS = {
    LengthCounts.PAYLOAD: "the payload alone",
    LengthCounts.REST: "all that follows it",
    LengthCounts.SELF_AND_REST: "itself and all that follows",
    LengthCounts.FRAME: "the whole frame",
}
_OFFSETS = (0, 1, -1, 2, -2, 3, -3, 4, -4)
MOST_LONGER = 64  # bytes that a payload may have more than the file says
_NUMBERS = (PartKind.LENGTH, PartKind.ID, PartKind.CHECK, PartKind.FIELD, PartKind.SEQUENCE, PartKind.BITS)


def _swapped(order: ByteOrder) -> ByteOrder:
    return ByteOrder.LITTLE if order == ByteOrder.BIG else ByteOrder.BIG


def other_sender(case: Case) -> Guesses:
    """Try the same bytes from the other end, or from either."""
    if case.sender is None:
        return
    other = receiver_of(case.sender)

    what = f"this is a frame that the {spoken(other)} sends, not the {spoken(case.sender)}"

    def remedy(verdict: Verdict) -> str:
        name = verdict.delivered_as
        remedy_in_file = f", or correct the `sender:` of {name} in the file" if name != "unknown" else ""
        return f"say `--sender {other.value}`{remedy_in_file}"

    yield Guess(case.protocol, case.block, other, what, remedy)


def unknown_message(case: Case) -> Guesses:
    """Guess a whole frame of a message, or of a payload size, that the file does not have."""
    verdict = case.verdict
    if verdict is None:
        return
    frame_format, rule = case.protocol.format, case.parts[payload_index(case.parts)]
    protocols = []
    if not frame_format.deliver_unknown:
        protocols.append(with_format(case.protocol, replace(frame_format, deliver_unknown=True)))
    longest = (
        0xFFFF
        if rule.payload in (PayloadRule.BY_LENGTH, PayloadRule.REST)
        else frame_format.max_payload_from(case.sender)
    )
    if longest > frame_format.max_payload_from(case.sender):
        protocols.append(
            with_format(
                case.protocol, replace(frame_format, deliver_unknown=True, max_payload=longest, longest_sent=())
            )
        )
    if rule.payload in (PayloadRule.BY_ID, PayloadRule.FIXED) and _size_in_question(case, rule) is None:
        size = len(case.data) - sum(part.size for part in case.parts)
        if size >= 0:
            fixed = replace(rule, payload=PayloadRule.FIXED, fixed_payload=size)
            relaxed = with_part(case.protocol, case.parts, payload_index(case.parts), fixed)
            protocols.append(with_format(relaxed, replace(relaxed.format, deliver_unknown=True)))

    def near_messages(found: Verdict) -> list[Message]:
        return sharing(case.protocol, case.sender, None if id_index(found.parts) is None else found.id)

    def what(found: Verdict) -> str:
        size = 0 if found.payload is None else found.payload[1] - found.payload[0]
        bytes_there = f"{size} payload byte{'s' * (size != 1)}"
        if found.message is None:
            near = near_messages(found)
            if near:
                number = "" if id_index(found.parts) is None else f" with the id {_id(case, found)}"
                return f"everything holds, but of the messages{number} it is none: {wanted_text(near)} ({bytes_there})"
            whose = "" if case.sender is None else f" of the {spoken(case.sender)}"
            return f"everything holds, but no message{whose} has the id {_id(case, found)} ({bytes_there})"
        message = found.message
        if rule.payload == PayloadRule.FIXED:
            return (
                f"everything holds, but every payload of this frame has {rule.fixed_payload} bytes, and here are {size}"
            )
        least, most = message.min_payload, message.max_payload
        bound = bound_by_counts(message, found.payload_of(case.data))
        if least <= size <= most and bound is not None and size > bound.most:
            return f"everything holds, but {message.name} has {bound.text}, and here are {size}"
        wanted = str(least) if least == most else f"{least} to {most}"
        return f"everything holds, but {message.name} has {wanted} payload bytes, and here are {size}"

    def remedy(found: Verdict) -> str:
        if found.message is not None:
            fixed = f"`payload: {rule.fixed_payload}` and " if rule.payload == PayloadRule.FIXED else ""
            return f"compare {fixed}the fields of {found.message.name} with the sender's code"
        near = near_messages(found)
        if near:
            names = " and ".join(message.name for message in near)
            return f"compare the `match` of {names} with the sender's code"
        sender = "" if case.sender is None else f" and `sender: {case.sender.value}`"
        number = f" with `id: {_id(case, found)}`{sender}" if case.verdict is not None else ""
        return f"add a message{number} to the file"

    for protocol in protocols:
        yield Guess(protocol, case.block, case.sender, what, remedy)


def unlisted_seed(case: Case) -> Guesses:
    """Guess a message that the file does not have, under a check that counts each message's own seed."""
    verdict = case.verdict
    if verdict is None or verdict.id is None or verdict.message is not None:
        return
    if not any(part.seeded for part in case.parts):
        return
    sender = case.sender or End.BOTH
    payload = Field("payload", FieldKind.BYTES, 0, max_size=case.protocol.format.max_payload)
    number = id_text(case.parts, verdict.id)
    for seed in range(256):
        message = Message(_UNLISTED, verdict.id, sender, (payload,), seed=seed)
        known = replace(case.protocol, messages=(*case.protocol.messages, message))
        what = f"everything holds if this is a message that the file does not list: id {number}, {len(case.data)} bytes"
        yield Guess(
            known,
            case.block,
            case.sender,
            f"{what}: seed {seed} fits",
            f"add a message with `id: {number}` and `seed: {seed}` to the file",
        )


_UNLISTED = "unlisted"


def _id(case: Case, verdict: Verdict) -> str:
    return id_text(case.parts, verdict.id or 0)


def lengths(case: Case) -> Guesses:
    """Guess another meaning of the length, in either byte order: parts that are usually forgotten or counted twice."""
    index = length_index(case.parts)
    if index is None:
        return
    own = case.parts[index]
    orders = [own.order, _swapped(own.order)] if own.size > 1 else [own.order]
    tried = {(own.order, counted_beside_payload(case.parts, index))}
    for offset, counts, order in itertools.product(_OFFSETS, LengthCounts, orders):
        part = replace(own, counts=counts, order=order, length_offset=offset)
        changed = (*case.parts[:index], part, *case.parts[index + 1 :])
        meaning = order, counted_beside_payload(changed, index)
        if meaning not in tried:
            tried.add(meaning)
            yield _with_length(case, index, part)


def _with_length(case: Case, index: int, part: Part) -> Guess:
    own = case.parts[index]
    protocol = with_part(case.protocol, case.parts, index, part)
    changes = []
    if part.order != own.order:
        changes.append(f"is {part.order.value}-endian")
    if (part.counts, part.length_offset) != (own.counts, own.length_offset):
        more = f", {part.length_offset:+d}" if part.length_offset else ""
        changes.append(f"counts {_COUNTS[part.counts]}{more}")
    what = f"everything holds if the {own.name} {' and '.join(changes)}"
    return Guess(protocol, case.block, case.sender, what, f"write {spelled(protocol, part.name)}")


def payload_sizes(case: Case) -> Guesses:
    """Guess another size of a fixed payload, nearest first: the firmware may have gained a field.

    Between delimiters the size is visible: see unknown_message.
    """
    at = payload_index(case.parts)
    own = _size_in_question(case, case.parts[at])
    if own is None:
        return
    beside = sum(part.size for part in case.parts)
    most = min(len(case.block) - beside, own + MOST_LONGER)
    for size in sorted(range(most + 1), key=lambda size: (abs(size - own), -size)):
        if size != own and _ends_well(case, beside + size):
            yield _with_payload(case, at, own, size)


def _ends_well(case: Case, size: int) -> bool:
    """Return whether a frame of this size ends at the end of the bytes, or at the begin of another frame."""
    first = case.parts[0]
    rest = case.block[size:]
    return not rest or first.kind not in CONSTANTS or rest.startswith(first.value)


def _size_in_question(case: Case, rule: Part) -> int | None:
    """Return the payload's size, where a number of the file alone says it."""
    if case.verdict is None or case.protocol.format.delimiter is not None or case.protocol.format.ends_by_silence:
        return None
    if rule.payload == PayloadRule.FIXED:
        return rule.fixed_payload
    message = case.verdict.message
    if rule.payload != PayloadRule.BY_ID or message is None or message.min_payload != message.max_payload:
        return None
    return message.max_payload


def with_payload_size(protocol: Protocol, parts: tuple[Part, ...], at: int, size: int) -> Protocol:
    """Return the protocol with payloads of ``size`` bytes, whatever its messages say; ``parts[at]`` is the payload."""
    rule = replace(parts[at], payload=PayloadRule.FIXED, fixed_payload=size)
    changed = with_part(protocol, parts, at, rule)
    longest = max(size, protocol.format.max_payload)
    return with_format(changed, replace(changed.format, deliver_unknown=True, max_payload=longest, longest_sent=()))


def _with_payload(case: Case, at: int, own: int, size: int) -> Guess:
    protocol = with_payload_size(case.protocol, case.parts, at, size)
    off = abs(size - own)
    much = f"{off} byte{'s' * (off != 1)} {'longer' if size > own else 'shorter'}"
    is_fixed = case.parts[at].payload == PayloadRule.FIXED
    name = "" if is_fixed or case.verdict is None or case.verdict.message is None else case.verdict.message.name

    whose = f"{name} is" if name else "the frames are"
    what = f"everything holds if the payload has {size} bytes, not {own}: {whose} {much} than the file says"

    def remedy(found: Verdict) -> str:
        fields = "" if found.message is None else f"compare the fields of {found.message.name} with the sender's code"
        if is_fixed:
            return f"write `- payload: {size}`" + (f", and {fields}" if fields else "")
        return fields

    return Guess(protocol, case.block, case.sender, what, remedy, key=f"{name}: payload {own} is {size}")


def other_byte_order(case: Case) -> Guesses:
    """Guess the other byte order for all numbers of the frame, and for the id alone."""
    swapped = [
        replace(part, order=_swapped(part.order)) if part.kind in _NUMBERS and part.size > 1 else part
        for part in case.protocol.format.parts
    ]
    whole = case.protocol.format.parts
    changed = [part.name for part, old in zip(swapped, whole, strict=True) if part != old]
    if not changed:
        return
    order = next(part.order for part, old in zip(swapped, whole, strict=True) if part != old)
    protocol = with_format(case.protocol, replace(case.protocol.format, parts=tuple(swapped)))
    messages = tuple(_with_order(message, order) for message in protocol.messages)
    what = f"everything holds if {' and '.join(changed)} {'is' if len(changed) == 1 else 'are'} {order}-endian"
    remedy = f"write `byte_order: {order.value}` at the top of the file"
    yield Guess(replace(protocol, messages=messages), case.block, case.sender, what, remedy)


def _with_order(message: Message, order: ByteOrder) -> Message:
    """Return the message with another `byte_order` of the file, fields included."""
    return replace(message, fields=tuple(replace(field, order=order) for field in message.fields))


def other_constants(case: Case) -> Guesses:
    """Guess that all constants are as received."""
    changed = constants_as_found(case)
    if changed is None:
        return
    parts = zip(case.protocol.format.parts, changed.protocol.format.parts, strict=True)
    pairs = [(old, new) for old, new in parts if old != new]
    texts = (f"the {old.name} is {hex_of(new.value)} instead of {hex_of(old.value)}" for old, new in pairs)
    what = f"everything holds but that {' and '.join(texts)}"
    remedy = "write " + " and ".join(f"`- {new.kind.value}: {bytes_text(new.value)}`" for _, new in pairs)
    yield Guess(changed.protocol, case.block, case.sender, what, remedy)


def other_protocols(case: Case) -> Guesses:
    """Guess that the bytes belong to another protocol file at hand."""
    for peer in case.peers:
        ours, theirs = case.protocol.format, peer.format
        same_cut = (ours.delimiter, ours.opening, ours.ends_by_silence) == (
            theirs.delimiter,
            theirs.opening,
            theirs.ends_by_silence,
        )
        if same_cut:  # else the bytes were cut at other places
            for sender in (End.HOST, End.MCU) if case.sender is None else (case.sender,):
                yield _of_peer(case, peer, sender)


def _of_peer(case: Case, peer: Protocol, sender: End) -> Guess:
    return Guess(
        peer,
        case.block,
        sender,
        f"this is a frame of the protocol {peer.name}, from the {spoken(sender)}",
        f"take the file {peer.path}",
    )
