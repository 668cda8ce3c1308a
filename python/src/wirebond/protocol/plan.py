"""Lowering: a frame's parts become the offsets that the core works with (``wirebond/format.hpp``).

The engine is filled from this plan and the generated C++ prints it, so that both ends have one meaning.
"""

from __future__ import annotations

import itertools
from collections import Counter
from dataclasses import dataclass, replace
from enum import StrEnum

from wirebond.protocol.forms import (
    Choice,
    FormParts,
    complement,
    header_fields,
    own_forms,
    parts_of_forms,
)
from wirebond.protocol.matching import are_matched, id_key, one_id, overlap, told_by
from wirebond.protocol.model import (
    Address,
    Algorithm,
    BitRole,
    ByteOrder,
    End,
    Escapes,
    FrameFormat,
    HeaderField,
    Insertion,
    LengthCounts,
    Match,
    MatchOf,
    Message,
    Part,
    PartKind,
    PayloadRule,
    Protocol,
    Stuffing,
    Subject,
)
from wirebond.protocol.payload_rules import PayloadRules, payload_rules

MAX_CONSTANTS = 16
MAX_CHECKS = 4
MAX_ALGORITHMS = 4
MAX_FORMS = 8
MAX_HEADER_FIELDS = 16
MAX_ESCAPES = 6
MAX_EXCLUSIONS = 24
MAX_INSERTION = 4
NO_ID = 0xFFFFFFFF  # stands for "none" where some frames of a sender have an id and others not

_CONSTANT_KINDS = (PartKind.MAGIC, PartKind.CONSTANT, PartKind.TAIL)


@dataclass(frozen=True)
class Position:
    """``offset`` from the frame's first byte or, negative with ``from_end``, from one past its last."""

    offset: int
    from_end: bool = False


@dataclass(frozen=True)
class Constant:
    at: Position
    value: int
    mask: int = 0xFF


@dataclass(frozen=True)
class Number:
    at: Position
    bytes: int
    order: ByteOrder
    shift: int
    mask: int


@dataclass(frozen=True)
class CheckRule:
    algorithm: int
    start: Position
    stop: Position
    at: Position
    bytes: int
    order: ByteOrder
    shift: int
    seeded: bool
    as_hex: bool
    on_wire: bool  # over the bytes as they are sent, after stuffing
    continues: int  # index of an earlier check, or -1


@dataclass(frozen=True)
class HeaderNumber:
    """Where a form has a header field. Numbers are bits on the wire."""

    name: str
    number: Number
    default: int  # of this sender
    place: int  # in ``Plan.header``
    fixed_mask: int = 0  # bits of the number that tell this form from others,
    fixed_value: int = 0  # and what they are in it
    is_magic: bool = False  # any form will do where no magic is asked for


@dataclass(frozen=True)
class Exclusion:
    """A frame is not of this form if a number lies from ``low`` to ``high``; of it ``number.mask`` selects the bits.

    ``number`` is where a receiver finds it; None: the payload's size.
    """

    subject: Subject
    place: int  # of a header field
    number: Number | None
    low: int
    high: int
    on_receive: bool  # False: it only chooses the sender's form


@dataclass(frozen=True)
class FormChoice:
    """A choice of the form, with the place of its number; None: the payload's size."""

    choice: Choice
    number: Number | None


@dataclass(frozen=True)
class Form:
    """One shape that a frame can take: fixed bytes, the payload, fixed bytes; places are counted from either end."""

    prefix: int
    suffix: int
    payload: PayloadRule
    fixed_payload: int
    trims_zeros: bool
    length: Number | None
    length_unit: int
    length_bias: int
    id: Number | None
    constants: tuple[Constant, ...]
    prefix_constants: int
    checks: tuple[CheckRule, ...]
    header_checks: int
    header: tuple[HeaderNumber, ...]
    choices: tuple[FormChoice, ...] = ()
    exclusions: tuple[Exclusion, ...] = ()
    id_mask: int = 0  # bits of the id that tell this form from others,
    id_value: int = 0  # and what they are in it

    @property
    def most_payload(self) -> int:
        """The greatest payload that its length can tell. Without the length that other forms have it carries none."""
        if self.payload == PayloadRule.FIXED:
            return self.fixed_payload
        if self.payload != PayloadRule.BY_LENGTH:
            return 0xFFFF
        return 0 if self.length is None else self.length.mask * self.length_unit + self.length_bias

    def carries(self, payload: int) -> bool:
        """Can its length tell a payload of this size?"""
        if not 0 <= payload <= self.most_payload:
            return False
        counted = payload - self.length_bias
        return self.length is None or (counted >= 0 and counted % self.length_unit == 0)


@dataclass(frozen=True)
class MatchTest:
    """A number of a frame: its bits of ``mask`` lie from ``low`` to ``high``; with ``or_next`` or the next test holds.

    ``place``: of a header field, in ``Plan.header``. ``at`` to ``shift``: of a number of the payload.
    """

    of: MatchOf
    mask: int
    low: int
    high: int
    or_next: bool
    is_one: bool  # the whole number has one value, which a sender gives it by itself
    name: str  # of the header field, or of the field of the payload
    place: int = 0
    at: int = 0
    bytes: int = 0
    order: ByteOrder = ByteOrder.LITTLE
    shift: int = 0


@dataclass(frozen=True)
class MessageRow:
    """``index`` is the message's place in ``Protocol.messages``."""

    id: int
    index: int
    min_payload: int
    max_payload: int
    seed: int
    only_expected: bool  # shares its id with others of its sender: it is meant where its request has gone out
    rules: PayloadRules  # those that a receiver applies
    tests: tuple[MatchTest, ...] = ()  # all of what the message's frames have, where ids do not tell all messages


class Framing(StrEnum):
    """How a frame's place in a stream is found."""

    BY_START = "by_start"  # by its first constant and its size
    DELIMITED = "delimited"  # between two equal delimiters
    BRACKETED = "bracketed"  # between an opening and a closing delimiter that differ
    SILENCE = "silence"  # between two silences of the line
    SIZED = "sized"  # stuffed: by its first constant, and its length tells where it ends


@dataclass(frozen=True)
class Plan:
    """One end's view: how frames from ``sender`` look, and which messages they carry.

    A sender takes the first form that its header values allow, that has every field whose value was given, and that can
    carry the message. With the defaults of ``header`` these are among the ``own_forms`` first ones.
    """

    framing: Framing
    opening: bytes
    closing: bytes
    sends_opening: bool
    stuffing: Stuffing
    escapes: Escapes | None
    starts: int  # the first so many bytes of ``escapes`` begin frames that their length ends
    insertion: Insertion | None
    length_on_wire: bool  # the length counts the bytes as they are sent, after stuffing
    deliver_unknown: bool
    skips_failed: bool
    plain_front: int  # bytes before the stuffed ones, sent as they are
    plain_back: int  # bytes behind them
    max_payload: int
    no_id: int  # what stands for the message of a frame without an id
    own_forms: int
    forms: tuple[Form, ...]
    header: tuple[HeaderField, ...]  # of all forms, in the order of the parts and of their bits
    address: int | None  # place in ``header`` of the field that says for whom a frame of this sender is
    broadcast: tuple[int, ...]  # values of that field, as bits on the wire, that mean every receiver
    peer: int | None  # place of the field that says who sent the frame
    sequence: int | None  # place of the number that counts a sender's frames; None: a receiver has nothing to count by
    sequence_per_message: bool  # it counts the frames of each message
    algorithms: tuple[Algorithm, ...]
    matches: bool  # a message of this sender needs more than one id to be told
    matches_late: bool  # a test needs bytes that do not stand before the payload
    id_place: int | None  # place in ``header`` of the id, where a message has several
    messages: tuple[MessageRow, ...]  # by rising id; of one id those that are only expected first


def plan_for(protocol: Protocol, sender: End | None) -> Plan:
    """The plan for frames that ``sender`` sends; None: from either end (their ids must then differ)."""
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
            _applied_rules(m, frame_format.parts),
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
        max_payload=frame_format.max_payload,
        no_id=no_id,
        own_forms=own_forms(frame_format.parts, sender),
        forms=forms(frame_format.parts, sender),
        header=header,
        address=address,
        broadcast=() if address is None else header[address].broadcast_bits,
        peer=peer,
        sequence=sequence if sender is not None or peer is not None else None,  # two ends in one stream, told apart
        sequence_per_message=sequence is not None and header[sequence].per_message,
        algorithms=tuple(_algorithms(frame_format.parts)),
        matches=matches,
        matches_late=matches_late(sent, frame_format.parts),
        id_place=id_place,
        messages=tuple(sorted(rows, key=lambda row: (row.id, not row.only_expected))),
    )


def _place_of(header: tuple[HeaderField, ...], *kinds: Address | None) -> int | None:
    """The place of the field that is one of these addresses."""
    found = (place for place, field in enumerate(header) if field.address is not None and field.address in kinds)
    return next(found, None)


def is_id(field: HeaderField, parts: tuple[Part, ...]) -> bool:
    """Is this header field the id, which is one where a message has several?"""
    return any(
        (part.kind == PartKind.ID and part.header is field)
        or any(run.role == BitRole.ID and run.header is field for run in part.bits)
        for part in parts
    )


def matches_late(messages: tuple[Message, ...], parts: tuple[Part, ...]) -> bool:
    """Does what tells these messages apart stand behind the payload, or in it?"""
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


def _applied_rules(message: Message, parts: tuple[Part, ...]) -> PayloadRules:
    """Constants, with the counts that say where they lie; and all counts where nothing else tells the size."""
    rules = payload_rules(message)
    by_itself = any(part.kind == PartKind.PAYLOAD and part.payload == PayloadRule.BY_ID for part in parts)
    if by_itself and message.min_payload != message.max_payload:
        return PayloadRules(rules.constants, rules.counts)
    return PayloadRules(rules.constants, rules.counts[: rules.needed_counts])


def forms(parts: tuple[Part, ...], sender: End | None) -> tuple[Form, ...]:
    """Every form that a frame of this sender can take, as offsets; in the order of ``parts_of_forms``."""
    algorithms = _algorithms(parts)
    places = {field.name: place for place, field in enumerate(header_fields(parts))}
    return tuple(_form(form_parts, algorithms, places, sender) for form_parts in parts_of_forms(parts, sender))


def mixes_ids(parts: tuple[Part, ...], sender: End | None) -> bool:
    """Have some frames of this sender an id, and others none?"""
    return len({form.id is None for form in forms(parts, sender)}) > 1


def _algorithms(parts: tuple[Part, ...]) -> list[Algorithm]:
    return list(dict.fromkeys(part.algorithm for part in parts if part.algorithm is not None))


def _framing(protocol: Protocol) -> Framing:
    frame_format = protocol.format
    if frame_format.ends_by_silence:
        return Framing.SILENCE
    if frame_format.delimiter is None:
        return Framing.SIZED if frame_format.is_sized else Framing.BY_START
    is_delimited = frame_format.opening in (None, frame_format.delimiter)
    return Framing.DELIMITED if is_delimited else Framing.BRACKETED


def _starts(frame_format: FrameFormat) -> int:
    """How many values the first byte of a frame has."""
    magic = frame_format.parts[0]
    values = [value for _, value in magic.by_sender] or magic.alternatives or (magic.value,)
    return len({value[0] for value in values})


def told_by_request(messages: tuple[Message, ...], sender: End | None) -> set[str]:
    """Names of the replies that share their id with another message of ``sender``: only their request tells them."""
    replies = {m.reply for m in messages}
    sent = [m for m in messages if m.sent_by(sender)]
    if are_matched(sent):
        asked = [m for m in sent if m.name in replies]
        return {m.name for m in asked if any(o is not m and overlap(m, o) is not None for o in sent)}
    uses = Counter(id_key(m) for m in sent)
    return {m.name for m in sent if uses[id_key(m)] > 1 and m.name in replies}


def expecting(protocol: Protocol, name: str) -> Protocol:
    """The protocol as a receiver understands it that expects the reply ``name``: what shares its id is gone."""
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
    """Pairs of messages of different senders that share an id: such streams need ``sender`` to be told apart."""
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


# ---- one form to offsets


def _form(form_parts: FormParts, algorithms: list[Algorithm], places: dict[str, int], sender: End | None) -> Form:
    parts = form_parts.parts
    payload_index = next(i for i, p in enumerate(parts) if p.kind == PartKind.PAYLOAD)
    payload = parts[payload_index]
    prefix = sum(p.size for p in parts[:payload_index])
    suffix = sum(p.size for p in parts[payload_index + 1 :])

    def start_of(index: int) -> Position:
        if index <= payload_index:
            return Position(sum(p.size for p in parts[:index]))
        return Position(-sum(p.size for p in parts[index:]), from_end=True)

    def end_of(index: int) -> Position:
        if index < payload_index:
            return Position(sum(p.size for p in parts[: index + 1]))
        return Position(-sum(p.size for p in parts[index + 1 :]), from_end=True)

    before: list[Constant] = []
    after: list[Constant] = []
    length: Number | None = None
    length_bias, length_unit = 0, 1
    message_id: Number | None = None
    header: list[HeaderNumber] = []

    def held(field: HeaderField, number: Number) -> HeaderNumber:
        mask = value = 0
        for choice in form_parts.choices:
            if choice.number == (Subject.FIELD, field.name) and (fixed := choice.fixed_bits) is not None:
                mask, value = mask | fixed[0], value | fixed[1]
        return HeaderNumber(field.name, number, field.default_bits(sender), places[field.name], mask, value)

    checks: list[tuple[bool, int, Part]] = []
    for index, part in enumerate(parts):
        at = start_of(index)
        place = before if index < payload_index else after
        if part.kind in _CONSTANT_KINDS:
            place.extend(Constant(Position(at.offset + i, at.from_end), byte) for i, byte in enumerate(part.value))
            if part.header is not None:
                mask, magic = (1 << 8 * part.size) - 1, int.from_bytes(part.value, "big")
                number = Number(at, part.size, ByteOrder.BIG, 0, mask)
                place_of = places[part.header.name]
                header.append(HeaderNumber(part.header.name, number, magic, place_of, mask, magic, is_magic=True))
        elif part.kind == PartKind.LENGTH:
            length = _whole(at, part)
        elif part.kind == PartKind.ID:
            message_id = _whole(at, part)
            if part.header is not None:
                header.append(held(part.header, message_id))
        elif part.header is not None:
            header.append(held(part.header, _whole(at, part)))
        elif part.kind == PartKind.CHECK:
            in_header = index < payload_index and part.last < payload_index
            checks.append((not in_header, index, part))
        for run in part.bits:
            number = Number(at, part.size, part.order, run.shift, run.mask)
            if run.role == BitRole.LENGTH:
                length = number
            elif run.role == BitRole.ID:
                message_id = number
                header += [] if run.header is None else [held(run.header, number)]
            elif run.role == BitRole.CONSTANT:
                place.extend(_bits_constant(number, run.value))
            elif run.header is not None:
                header.append(held(run.header, number))
        if part.kind == PartKind.LENGTH or any(run.role == BitRole.LENGTH for run in part.bits):
            length_bias, length_unit = _length_rule(parts, index, prefix, suffix), part.length_unit
    choices: list[FormChoice] = []
    exclusions: list[Exclusion] = []
    id_mask = id_value = 0
    for choice in form_parts.choices:
        found = _number_of(choice, header, message_id)
        choices.append(FormChoice(choice, found))
        fixed = None if found is None else choice.fixed_bits
        if found is not None and fixed is not None:
            before.extend(_bits_constant(replace(found, mask=fixed[0]), fixed[1]))
            if choice.subject == Subject.ID:
                id_mask, id_value = id_mask | fixed[0], id_value | fixed[1]
            continue
        on_receive = found is not None or payload.payload != PayloadRule.REST
        exclusions += [
            Exclusion(choice.subject, places.get(choice.name, 0), found, low, high, on_receive)
            for low, high in complement(choice.allowed, choice.mask)
        ]
    before.sort(key=lambda constant: constant.at.offset)
    checks.sort(key=lambda entry: entry[:2])

    rules: list[CheckRule] = []
    for _, index, part in checks:
        assert part.algorithm is not None
        algorithm = algorithms.index(part.algorithm)
        start, stop = start_of(part.first), end_of(part.last)
        continues = -1
        for earlier_index, earlier in enumerate(rules):
            same = earlier.algorithm == algorithm and earlier.start == start and not part.on_wire
            # Both ends count from the start, or this one lies behind the payload: the earlier range is inside.
            inside = not earlier.stop.from_end and (stop.from_end or earlier.stop.offset <= stop.offset)
            if same and inside:
                continues = earlier_index
        size = part.size // 2 if part.as_hex else part.size
        at = start_of(index)
        rules.append(
            CheckRule(
                algorithm,
                start,
                stop,
                at,
                size,
                part.order,
                part.shift,
                part.seeded,
                part.as_hex,
                part.on_wire,
                continues,
            )
        )
    return Form(
        prefix=prefix,
        suffix=suffix,
        payload=payload.payload,
        fixed_payload=payload.fixed_payload,
        trims_zeros=payload.trims_zeros,
        length=length,
        length_unit=length_unit,
        length_bias=length_bias,
        id=message_id,
        constants=tuple(before + after),
        prefix_constants=len(before),
        checks=tuple(rules),
        header_checks=sum(1 for late, _, _ in checks if not late),
        header=tuple(header),
        choices=tuple(choices),
        exclusions=tuple(exclusions),
        id_mask=id_mask,
        id_value=id_value,
    )


def _number_of(choice: Choice, header: list[HeaderNumber], message_id: Number | None) -> Number | None:
    """Where the bits of a choice stand; None: it is about the payload's size."""
    if choice.subject == Subject.SIZE:
        return None
    if choice.subject == Subject.ID:
        assert message_id is not None, "a choice is about what is there"
        return replace(message_id, mask=choice.mask)
    return replace(next(f for f in header if f.name == choice.name).number, mask=choice.mask)


def _whole(at: Position, part: Part) -> Number:
    return Number(at, part.size, part.order, 0, (1 << 8 * part.size) - 1)


def _length_rule(parts: tuple[Part, ...], index: int, prefix: int, suffix: int) -> int:
    """The bias: payload bytes = length number * unit + bias."""
    part = parts[index]
    follows = sum(p.size for p in parts[index + 1 :])
    beside_payload = {
        LengthCounts.PAYLOAD: 0,
        LengthCounts.REST: follows,
        LengthCounts.SELF_AND_REST: part.size + follows,
        LengthCounts.FRAME: prefix + suffix,
    }[part.counts]
    return -beside_payload - part.length_offset


def _bits_constant(number: Number, value: int) -> list[Constant]:
    """The bytes of ``number`` that ``mask`` touches, as masked constants."""
    mask, bits = number.mask << number.shift, value << number.shift
    constants = []
    for i in range(number.bytes):
        place = 8 * (i if number.order == ByteOrder.LITTLE else number.bytes - 1 - i)
        byte_mask = mask >> place & 0xFF
        if byte_mask:
            at = Position(number.at.offset + i, number.at.from_end)
            constants.append(Constant(at, bits >> place & byte_mask, byte_mask))
    return constants
