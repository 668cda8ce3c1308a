"""The C++ view of each end of a link: its received and sent messages, its deadlines and its versions."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from wirebond.generate.code import names
from wirebond.generate.code.cpp_header import AddressView, address_view, fields_of
from wirebond.generate.code.cpp_match import match_lines
from wirebond.generate.code.cpp_names import id_literal, no_id_literal, struct_names
from wirebond.protocol.model import Deadline, End, Message, Mismatch, Protocol, Queue, Recover, Start
from wirebond.protocol.plan import MessageRow, Plan
from wirebond.protocol.planning import plan_for
from wirebond.protocol.spoken import answering_magics


@dataclass(frozen=True)
class RulesView:
    """The rules over one message's payload, each as an initialiser."""

    name: str  # of the message
    index: int
    constants: tuple[str, ...]
    counts: tuple[str, ...]
    most_beside: int


def rules_views(protocol: Protocol, plan: Plan) -> tuple[RulesView, ...]:
    """Return the rules of all messages of the plan that have any, by increasing index."""
    found = []
    for row in sorted(plan.messages, key=lambda row: row.index):
        constants = tuple(f"{{{c.at}, {c.behind}, 0x{c.mask:02X}, 0x{c.value:02X}}}" for c in row.rules.constants)
        counts = tuple(
            f"{{{c.at}, {c.behind}, {c.bytes}, wirebond::ByteOrder::{c.order}, {c.shift}, 0x{c.mask:X}U, {c.unit}, "
            f"{c.most}, {c.step}, {-1 if c.agrees_with is None else c.agrees_with}}}"
            for c in row.rules.counts
        )
        if constants or counts:
            found.append(
                RulesView(protocol.messages[row.index].name, row.index, constants, counts, row.rules.most_beside)
            )
    return tuple(found)


@dataclass(frozen=True)
class SourceView:
    struct: str
    sender: str
    receiver: str
    shapes: tuple[tuple[str, str], ...]  # id, shape
    expected: tuple[tuple[int, str, str], ...]  # index, id, shape of the messages that only their request identifies
    rules: tuple[RulesView, ...]
    bounds_by_counts: bool  # a payload longer than its counts allow is refused
    counts_bytes: bool  # some counts count bytes, of elements or beside their number
    matches: tuple[tuple[list[str], str, str], ...]  # conditions of a frame, its shape, its message; replies first
    matches_late: bool
    structs: tuple[str, ...]
    latest: tuple[str, ...]  # of these, those of `queue: latest`
    never: tuple[str, ...]  # messages that only the other end sends
    header_defaults: tuple[str, ...]  # on the wire, of all header fields, also those of the other end's frames alone
    address: AddressView | None
    counts_messages: bool  # each message has its own sequence numbers


def source_view(protocol: Protocol, end: End, plan: Plan) -> SourceView:
    structs = struct_names(protocol)

    def key(row: MessageRow) -> str:
        return no_id_literal(protocol) if row.id == plan.no_id else id_literal(protocol, row.id)

    def shape(row: MessageRow) -> str:
        return f"{{{row.index}, {row.min_payload}, {row.max_payload}{f', {row.seed}' if row.seed else ''}}}"

    return SourceView(
        struct="FromHost" if end == End.HOST else "FromMcu",
        sender="host" if end == End.HOST else "MCU",
        receiver="MCU" if end == End.HOST else "host",
        shapes=tuple((key(row), shape(row)) for row in plan.messages if not row.only_expected),
        expected=tuple((row.index, key(row), shape(row)) for row in plan.messages if row.only_expected),
        rules=rules_views(protocol, plan),
        bounds_by_counts=any(row.rules.most_beside for row in plan.messages),
        counts_bytes=any(c.step > 1 or c.agrees_with is not None for row in plan.messages for c in row.rules.counts),
        matches=tuple(
            (match_lines(row), shape(row), protocol.messages[row.index].name)
            for row in sorted(plan.messages, key=lambda row: not row.only_expected)
            if plan.matches
        ),
        matches_late=plan.matches_late,
        structs=tuple(structs[m.name] for m in protocol.messages if m.sent_by(end)),
        latest=tuple(structs[m.name] for m in protocol.messages if m.sent_by(end) and m.queue == Queue.LATEST),
        never=tuple(structs[m.name] for m in protocol.messages if not m.sent_by(end)),
        header_defaults=tuple(f"{field.default_bits(end)}U" for field in plan.header),
        address=address_view(protocol, end),
        counts_messages=plan.sequence_per_message,
    )


def _recovery(deadline: Deadline) -> str:
    if deadline.recover == Recover.NEXT_MESSAGE:
        return "next_message"
    return "held_at_start" if deadline.start == Start.HELD else "explicit_call"


@dataclass(frozen=True)
class DeadlineView:
    end: str
    title: str
    rules: tuple[str, ...]
    actions: tuple[str, ...]


def _deadline_view(protocol: Protocol, end: End) -> DeadlineView:
    structs = struct_names(protocol)
    here = [d for d in protocol.deadlines if d.at in (end, End.BOTH)]
    rules = [
        f"{{{structs[d.message]}::Info::index, {round(d.after * 1e6)}, "
        f"static_cast<std::uint8_t>(Action::{names.identifier(d.then)}), "
        f"wirebond::Recover::{_recovery(d)}}}"
        for d in here
    ]
    actions = dict.fromkeys(names.identifier(d.then) for d in here)
    return DeadlineView(end.value, "MCU" if end == End.MCU else "host", tuple(rules), tuple(actions))


@dataclass(frozen=True)
class VersionsView:
    """The version in which an MCU answers."""

    place: int  # of the header field that holds the magic
    of_form: tuple[int, ...]  # by the form of a frame of the host
    width: int  # magics of a version
    magics: tuple[str, ...]  # of the MCU, in each version


def versions_view(protocol: Protocol) -> VersionsView | None:
    answering = answering_magics(protocol.format.parts)
    if not answering:
        return None
    versions = [(), *dict.fromkeys(answering.values())]
    heard = [next(entry for entry in form.header if entry.is_magic) for form in plan_for(protocol, End.HOST).forms]
    width = max(map(len, versions))
    return VersionsView(
        place=heard[0].place,
        of_form=tuple(versions.index(answering.get(entry.default, ())) for entry in heard),
        width=width,
        magics=tuple("{" + ", ".join(f"0x{m:X}U" for m in (*v, *(0,) * (width - len(v)))) + "}" for v in versions),
    )


@dataclass(frozen=True)
class EndView:
    """The facts that a link at one end needs."""

    end: str
    name: str
    other: str
    title: str
    mistakable: tuple[str, ...]  # structs of its own messages that, echoed, would be mistaken for the other end's
    knows_own_ids: bool  # of other messages that it sends the id says that they are its own
    scheduled: tuple[str, ...]  # structs of the messages that it sends by itself, with their namespace
    log_lines: tuple[str, ...]  # those of log lines, which leave half of the send queue to others
    holds_back_strangers: bool  # the commands of a host that has another protocol hash
    versions: VersionsView | None  # in which it answers; None: there is one
    max_sent: int
    urgent_bytes: int  # of the ring of urgent messages; 0: there are none
    rules: tuple[str, ...]


def end_view(protocol: Protocol, end: End) -> EndView:
    structs = struct_names(protocol)
    sent = [m for m in protocol.messages if m.sent_by(end)]
    log = protocol.service("log")
    deadlines = _deadline_view(protocol, end)
    return EndView(
        end=end.value,
        name=end.value.title(),
        other=(End.HOST if end == End.MCU else End.MCU).value.title(),
        title=deadlines.title,
        log_lines=tuple(
            f"{names.namespace(protocol.name)}::{structs[m.name]}"
            for m in sent
            if m.log is not None or (log is not None and m.name == log.message("message"))
        ),
        mistakable=tuple(f"{names.namespace(protocol.name)}::{structs[m.name]}" for m in _mistakable(protocol, end)),
        knows_own_ids=ids_say_the_sender(protocol),
        scheduled=tuple(f"{names.namespace(protocol.name)}::{structs[m.name]}" for m in sent if m.every is not None),
        holds_back_strangers=end == End.MCU
        and protocol.service("hello") is not None
        and protocol.link.on_mismatch == Mismatch.HOLD_BACK,
        versions=versions_view(protocol) if end == End.MCU else None,
        max_sent=max((protocol.max_wire_bytes(m.max_payload) for m in sent), default=1),
        urgent_bytes=_urgent_bytes(protocol, end),
        rules=deadlines.rules,
    )


def ids_say_the_sender(protocol: Protocol) -> bool:
    """Check whether ids identify the sender. Not if messages have other conditions, and not on a bus, where other MCUs
    send the same."""
    on_bus = any(field.address is not None for field in fields_of(protocol))
    return not on_bus and not any(m.match for m in protocol.messages)


def _mistakable(protocol: Protocol, end: End) -> list[Message]:
    """Return messages of ``end`` that its own receiver would mistake for the other end's, if they came back.

    Requests and replies of one message are left out: such a reply may equal its request, and is not an echo.
    """
    sent = [m for m in protocol.messages if m.sent_by(end)]
    if not ids_say_the_sender(protocol):
        return [m for m in sent if m.sender != End.BOTH or not _is_asked(protocol, m)]
    used = Counter(m.id for m in protocol.messages)
    return [m for m in sent if (m.sender == End.BOTH and not _is_asked(protocol, m)) or used[m.id] > 1]


def _is_asked(protocol: Protocol, message: Message) -> bool:
    return message.reply is not None or any(m.reply == message.name for m in protocol.messages)


def _urgent_bytes(protocol: Protocol, end: End) -> int:
    """Return a power of two that holds two of the largest urgent frames, wherever they begin."""
    urgent = [m for m in protocol.messages if m.sent_by(end) and m.queue == Queue.URGENT]
    largest = max((protocol.max_wire_bytes(m.max_payload) for m in urgent), default=0)
    return 1 << (4 * largest - 1).bit_length() if largest else 0
