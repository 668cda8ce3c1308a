"""Makes a plan: which forms frames take, how messages are identified, which replies only their request identifies."""

from __future__ import annotations

import itertools
from collections import Counter
from dataclasses import replace

from wirebond.protocol.matching import are_matched, id_key, one_id, overlap, told_by
from wirebond.protocol.model import (
    Address,
    Algorithm,
    BitRole,
    End,
    FrameFormat,
    HeaderField,
    Match,
    MatchOf,
    Message,
    Part,
    PartKind,
    PayloadRule,
    Protocol,
)
from wirebond.protocol.model.forms import header_fields, own_forms, parts_of_forms
from wirebond.protocol.offsets import offsets_of
from wirebond.protocol.payload_rules import PayloadRules, bounded, payload_rules
from wirebond.protocol.plan import NO_ID, Form, Framing, MatchTest, MessageRow, Plan
from wirebond.protocol.registers import register_of


def plan_for(protocol: Protocol, sender: End | None) -> Plan:
    """Return the plan for frames that ``sender`` sends; None: from either end (their ids must then differ)."""
    frame_format = protocol.format
    dependent = told_by_request(protocol.messages, sender)
    no_id = NO_ID if any(mixes_ids(frame_format.parts, end) for end in (sender, End.HOST, End.MCU)) else 0
    header = header_fields(frame_format.parts)
    address = _place_of(header, Address.RECEIVER, Address.MCU if sender == End.HOST else None)
    peer = _place_of(header, Address.SENDER, Address.MCU if sender == End.MCU else None)
    sequence = next((place for place, field in enumerate(header) if field.is_sequence), None)
    sent = tuple(m for m in protocol.messages if m.sent_by(sender))
    matches = are_matched(sent)
    id_place = next((place for place, field in enumerate(header) if is_id(field, frame_format.parts)), None)
    rows = [
        MessageRow(
            m.id if m.has_id else no_id,
            index,
            m.min_payload,
            m.max_payload,
            m.seed or 0,
            m.name in dependent,
            _applied_rules(m, frame_format),
            _match_tests(m, header, no_id) if matches or id_place is not None else (),
        )
        for index, m in enumerate(protocol.messages)
        if m.sent_by(sender)
    ]
    return Plan(
        framing=_framing(protocol),
        opening=frame_format.opening or frame_format.delimiter or b"",
        closing=frame_format.delimiter or b"",
        sends_opening=frame_format.opening is not None,
        stuffing=frame_format.stuffing,
        escapes=frame_format.escapes,
        starts=_starts(frame_format) if frame_format.is_sized and frame_format.escapes is not None else 0,
        insertion=frame_format.insertion,
        length_on_wire=frame_format.length_on_wire,
        deliver_unknown=frame_format.deliver_unknown,
        skips_failed=frame_format.is_strict,
        plain_front=sum(part.size for part in itertools.takewhile(lambda part: part.is_plain, frame_format.parts)),
        plain_back=sum(
            part.size for part in itertools.takewhile(lambda part: part.is_plain, reversed(frame_format.parts))
        ),
        decimal_bytes=frame_format.decimal_bytes,
        max_payload=frame_format.max_payload_from(sender),
        no_id=no_id,
        own_forms=own_forms(frame_format.parts, sender),
        forms=forms(frame_format.parts, sender),
        header=header,
        address=address,
        broadcast=() if address is None else header[address].broadcast_bits,
        peer=peer,
        sequence=sequence if sender is not None or peer is not None else None,  # one stream of two ends: counted apart
        sequence_per_message=sequence is not None and header[sequence].per_message,
        algorithms=tuple(_algorithms(frame_format.parts)),
        matches=matches,
        matches_late=matches_late(sent, frame_format.parts),
        id_place=id_place,
        messages=tuple(sorted(rows, key=lambda row: (row.id, not row.only_expected))),
    )


def _place_of(header: tuple[HeaderField, ...], *kinds: Address | None) -> int | None:
    """Return the place of the field that is one of these addresses."""
    found = (place for place, field in enumerate(header) if field.address is not None and field.address in kinds)
    return next(found, None)


def is_id(field: HeaderField, parts: tuple[Part, ...]) -> bool:
    """Check whether this header field is the id: it is one if a message has several."""
    return any(
        (part.kind == PartKind.ID and part.header is field)
        or any(run.role == BitRole.ID and run.header is field for run in part.bits)
        for part in parts
    )


def matches_late(messages: tuple[Message, ...], parts: tuple[Part, ...]) -> bool:
    """Return whether the bytes that distinguish these messages are in the payload or after it."""
    payload = next(index for index, part in enumerate(parts) if part.kind == PartKind.PAYLOAD)
    behind = {field.name for field in header_fields(parts[payload:])}
    behind |= {"id"} if any(part.kind == PartKind.ID for part in parts[payload:]) else set()
    matched = [match for message in messages for match in message.match]
    return any(
        match.of == MatchOf.PAYLOAD or (match.of == MatchOf.HEADER and match.name in behind) for match in matched
    )


def _match_tests(message: Message, header: tuple[HeaderField, ...], no_id: int) -> tuple[MatchTest, ...]:
    places = {field.name: place for place, field in enumerate(header)}
    without = () if message.has_id or no_id == 0 else (one_id(no_id),)
    return tuple(test for match in (*without, *told_by(message)) for test in _tests_of(match, places))


def _tests_of(match: Match, places: dict[str, int]) -> list[MatchTest]:
    in_payload = {} if match.place is None else {k: v for k, v in vars(match.place).items() if k != "mask"}
    place = places[match.name] if match.of == MatchOf.HEADER else 0
    mask = match.mask if match.place is None else match.mask & match.place.mask
    return [
        MatchTest(
            match.of,
            mask,
            low,
            high,
            number + 1 < len(match.ranges),
            match.is_one_value,
            match.name,
            place=place,
            **in_payload,
        )
        for number, (low, high) in enumerate(match.ranges)
    ]


def _applied_rules(message: Message, frame_format: FrameFormat) -> PayloadRules:
    """Return constants with the counts that decide their places; and all counts, if nothing else gives the size, or if
    a payload longer than they allow is refused."""
    rules = payload_rules(message)
    size = next(part.payload for part in frame_format.parts if part.kind == PartKind.PAYLOAD)
    if size == PayloadRule.BY_ID and message.min_payload != message.max_payload:
        return PayloadRules(rules.constants, rules.counts)
    if size in (PayloadRule.BY_LENGTH, PayloadRule.REST) and not frame_format.deliver_unknown:
        return bounded(message, PayloadRules(rules.constants, rules.counts))
    return PayloadRules(rules.constants, rules.counts[: rules.needed_counts])


def forms(parts: tuple[Part, ...], sender: End | None) -> tuple[Form, ...]:
    """Return every form that a frame of this sender can take, as offsets; in the order of ``parts_of_forms``."""
    algorithms = _algorithms(parts)
    places = {field.name: place for place, field in enumerate(header_fields(parts))}
    return tuple(offsets_of(form_parts, algorithms, places, sender) for form_parts in parts_of_forms(parts, sender))


def mixes_ids(parts: tuple[Part, ...], sender: End | None) -> bool:
    """Check whether some frames of this sender have an id, and others do not."""
    return len({form.id is None for form in forms(parts, sender)}) > 1


def _algorithms(parts: tuple[Part, ...]) -> list[Algorithm]:
    return list(dict.fromkeys(register_of(part.algorithm)[0] for part in parts if part.algorithm is not None))


def _framing(protocol: Protocol) -> Framing:
    frame_format = protocol.format
    if frame_format.ends_by_silence:
        return Framing.SILENCE
    if frame_format.delimiter is None:
        return Framing.SIZED if frame_format.is_sized else Framing.BY_START
    is_delimited = frame_format.opening in (None, frame_format.delimiter)
    return Framing.DELIMITED if is_delimited else Framing.BRACKETED


def _starts(frame_format: FrameFormat) -> int:
    """Return how many values the first byte of a frame can have."""
    magic = frame_format.parts[0]
    values = [value for _, value in magic.by_sender] or magic.alternatives or (magic.value,)
    return len({value[0] for value in values})


def told_by_request(messages: tuple[Message, ...], sender: End | None) -> set[str]:
    """Return the names of replies that share their id with another message of ``sender``: only their request identifies
    them."""
    replies = {m.reply for m in messages}
    sent = [m for m in messages if m.sent_by(sender)]
    if are_matched(sent):
        asked = [m for m in sent if m.name in replies]
        return {m.name for m in asked if any(o is not m and overlap(m, o) is not None for o in sent)}
    uses = Counter(id_key(m) for m in sent)
    return {m.name for m in sent if uses[id_key(m)] > 1 and m.name in replies}


def expecting(protocol: Protocol, name: str) -> Protocol:
    """Return the protocol as a receiver understands it that expects the reply ``name``: what shares its id is gone."""
    reply = protocol.message(name)
    if not any(name in told_by_request(protocol.messages, end) for end in (End.HOST, End.MCU)):
        return protocol
    hidden = {
        m.name
        for m in protocol.messages
        if m is not reply
        and overlap(m, reply) is not None
        and any(m.sent_by(e) and reply.sent_by(e) for e in (End.HOST, End.MCU))
    }
    return replace(protocol, messages=tuple(m for m in protocol.messages if m.name not in hidden))


def ids_collide(protocol: Protocol) -> list[tuple[Message, Message]]:
    """Return pairs of messages of different senders that share an id: such streams need ``sender``."""
    if are_matched(protocol.messages):
        return [
            (one, other)
            for one, other in itertools.combinations(protocol.messages, 2)
            if one.sender != other.sender and overlap(one, other) is not None
        ]
    by_id: dict[int | None, Message] = {}
    pairs = []
    for message in protocol.messages:
        other = by_id.setdefault(id_key(message), message)
        if other.sender != message.sender:
            pairs.append((other, message))
    return pairs
