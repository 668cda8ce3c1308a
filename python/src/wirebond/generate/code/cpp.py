"""C++17 for one protocol: a folder that a firmware project adds as it is. Frames are laid out by the plan."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from wirebond.generate.code import names
from wirebond.generate.code.amalgamate import amalgamated
from wirebond.generate.code.cpp_counters import counter_lines
from wirebond.generate.code.cpp_field import comment_text, hex_literal
from wirebond.generate.code.cpp_format import format_lines, format_sizes, update_call
from wirebond.generate.code.cpp_given import assign_lines, equal_lines, given_value
from wirebond.generate.code.cpp_header import (
    AddressView,
    address_view,
    ends_differ,
    fields_of,
    generated_types,
    header_shape,
    header_view,
)
from wirebond.generate.code.cpp_match import match_lines, sent_tests
from wirebond.generate.code.cpp_number import real
from wirebond.generate.code.cpp_struct import (
    Reader,
    Shape,
    clamp_lines,
    known_enums,
    member_lines,
    named_shapes,
    shape_of,
    size_lines,
    struct_lines,
    type_blocks,
    validate_lines,
    write_lines,
)
from wirebond.generate.code.folder import core_headers, render, write_files
from wirebond.protocol.hash import protocol_hash
from wirebond.protocol.model import (
    BitRole,
    Deadline,
    End,
    HeaderDefault,
    Message,
    Mismatch,
    PartKind,
    PayloadRule,
    Protocol,
    Queue,
    Recover,
    Start,
)
from wirebond.protocol.plan import MessageRow, Plan
from wirebond.protocol.planning import plan_for
from wirebond.protocol.spoken import answering_magics


def generate_cpp(protocol: Protocol, out: Path, *, amalgamate: bool = False) -> list[Path]:
    """Write ``<protocol>.hpp``, ``<protocol>_link.hpp``, the core headers and a ``CMakeLists.txt`` into ``out``; return
    their paths, sorted.

    The folder needs nothing else. With ``amalgamate`` all of it is one ``<protocol>.hpp``. The same protocol always
    gives the same bytes, and a file that already holds them is not touched, so that a build after it has nothing to do.
    ``OSError`` when a file cannot be written.
    """
    return write_files(out, cpp_files(protocol, amalgamate=amalgamate))


def cpp_files(protocol: Protocol, *, amalgamate: bool = False) -> dict[str, str]:
    """The text of each file that ``generate_cpp`` writes, by its name in the folder."""
    name, core = f"{protocol.name}.hpp", core_headers()
    header, link = cpp_header(protocol), link_header(protocol)
    if amalgamate:
        return {name: amalgamated(link, {name: header, **core})}
    cmake = render("CMakeLists.txt.j2", protocol=protocol)
    return {name: header, f"{protocol.name}_link.hpp": link, "CMakeLists.txt": cmake, **core}


def cpp_header(protocol: Protocol) -> str:
    """The text of ``<protocol>.hpp``."""
    plans = {end: plan_for(protocol, end) for end in (End.HOST, End.MCU)}
    return render(
        "cpp.hpp.j2",
        file=comment_text(Path(protocol.path).name or protocol.name),
        description=comment_text(protocol.description),
        protocol=protocol,
        namespace=names.namespace(protocol.name),
        hash=f"0x{protocol_hash(protocol):016X}",
        stop_bits=real(protocol.link.stop_bits, "float"),
        idle_us=round(protocol.idle_seconds * 1e6),
        pause_us=round(protocol.pause_seconds * 1e6),
        max_age_ms=round((protocol.link.max_age or 0) * 1e3),
        header=header_view(protocol),
        header_by_end=ends_differ(protocol),
        types=_type_views(protocol),
        messages=_message_views(protocol),
        formats=[(end.value, format_lines(plan)) for end, plan in plans.items()],
        format_sizes=format_sizes(plans.values()),
        updates=[update_call(a, i) for i, a in enumerate(plans[End.HOST].algorithms)],
        sources=[_source_view(protocol, end, plans[end]) for end in (End.HOST, End.MCU)],
        actions=[names.identifier(action) for action in dict.fromkeys(d.then for d in protocol.deadlines)],
        ends=[_deadline_view(protocol, end) for end in (End.HOST, End.MCU)],
        stops=_emergency_stop(protocol),
        services=_services(protocol),
    )


def link_header(protocol: Protocol) -> str:
    """The text of ``<protocol>_link.hpp``."""
    return render(
        "cpp_link.hpp.j2",
        file=comment_text(Path(protocol.path).name or protocol.name),
        protocol=protocol,
        namespace=names.namespace(protocol.name),
        hash=f"0x{protocol_hash(protocol):016X}",
        bytes_per_second=int(protocol.link.baud / protocol.link.bits_per_byte),
        services=[service for service, _ in _services(protocol)],
        counter_lines=counter_lines(protocol.service("counters"), message_shapes(protocol)),
        ends=[_end_view(protocol, end) for end in (End.MCU, End.HOST)],
    )


# ---- messages ---------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class MessageView:
    struct: str
    name: str
    index: int
    id: str
    without_id: bool  # in a protocol where other messages of the same end have one
    sender: str
    source: str
    either: bool  # of both ends, whose frames differ: who encodes it says which
    comment: str
    min_payload: int
    max_payload: int
    max_frame: int
    every_us: int
    queue: str
    reply: int  # index of the message that answers it, or -1
    match: tuple[str, ...]  # tests of what it is sent with, as initialisers
    id_place: int | None  # place of the header field that has its id, where it has several
    types: list[list[str]]  # declared in it
    members: list[str]
    enums: list[tuple[str, list[str]]]
    size: list[str]
    write: list[str]
    read: list[str]
    validate: list[str]
    clamp: list[str]

    @property
    def writes_values(self) -> bool:
        """Is anything but padding written?"""
        return any("message" in line for line in self.write)

    @property
    def reads_payload(self) -> bool:
        """Is any byte of it looked at? Not where all is padding, whose size is all that it has."""
        return any(re.search(r"\bpayload\b", line) for line in self.read)


def shapes(protocol: Protocol) -> tuple[dict[str, Shape], dict[str, Shape]]:
    """The structs of the file's types and those of the messages, each by the file's name."""
    scope = names.Scope(generated_types(protocol))
    named = named_shapes(protocol, scope)
    structs = {m.name: scope.claim(names.type_name(m.name), "Message") for m in protocol.messages}
    return named, {m.name: shape_of(structs[m.name], m.fields, named) for m in protocol.messages}


def message_shapes(protocol: Protocol) -> dict[str, Shape]:
    """The struct of each message and what lies in it, by the message's name."""
    return shapes(protocol)[1]


def struct_names(protocol: Protocol) -> dict[str, str]:
    """The struct of each message, by the message's name."""
    return {name: shape.path for name, shape in message_shapes(protocol).items()}


def frames_differ(protocol: Protocol) -> bool:
    """Does a frame look different from each end, by a magic for each direction?"""
    return plan_for(protocol, End.HOST).forms != plan_for(protocol, End.MCU).forms


def _message_views(protocol: Protocol) -> list[MessageView]:
    payload = protocol.format.part(PartKind.PAYLOAD)
    trims_zeros = payload is not None and payload.payload == PayloadRule.FIXED
    structs = message_shapes(protocol)
    indices = {m.name: i for i, m in enumerate(protocol.messages)}
    return [
        MessageView(
            struct=structs[message.name].path,
            name=message.name,
            index=index,
            id=id_literal(protocol, message.id) if message.has_id else no_id_literal(protocol),
            without_id=not message.has_id and plan_for(protocol, End.HOST).no_id != 0,
            sender=message.sender.value,
            source="FromMcu" if message.sender == End.MCU else "FromHost",
            either=message.sender == End.BOTH and frames_differ(protocol),
            comment=message_comment(message),
            min_payload=message.min_payload,
            max_payload=message.max_payload,
            max_frame=protocol.max_wire_bytes(message.max_payload),
            every_us=round((message.every or 0) * 1e6),
            queue=message.queue.value,
            reply=indices.get(message.reply or "", -1),
            match=sent_tests(protocol, message),
            id_place=None if message.ids is None else plan_for(protocol, End.HOST).id_place,
            types=type_blocks(structs[message.name]),
            members=member_lines(structs[message.name]),
            enums=known_enums(structs[message.name]),
            size=size_lines(structs[message.name]),
            write=write_lines(structs[message.name]),
            read=Reader(trims_zeros).lines(structs[message.name]),
            validate=validate_lines(structs[message.name]),
            clamp=clamp_lines(structs[message.name]),
        )
        for index, message in enumerate(protocol.messages)
    ]


@dataclass(frozen=True)
class TypeView:
    """One of the file's types."""

    name: str
    lines: list[str]
    enums: list[tuple[str, list[str]]]


def _type_views(protocol: Protocol) -> list[TypeView]:
    named, _ = shapes(protocol)
    return [TypeView(name, struct_lines(shape), known_enums(shape)) for name, shape in named.items()]


def message_comment(message: Message) -> str:
    way = {End.HOST: "Host to MCU", End.MCU: "MCU to host", End.BOTH: "Either way"}[message.sender]
    facts = [way]
    if message.every:
        facts.append(f"every {message.every * 1000:g} ms")
    if message.queue != Queue.NORMAL:
        facts.append({Queue.URGENT: "urgent", Queue.LATEST: "only the newest waits"}[message.queue])
    if message.reply:
        facts.append(f"answered by {message.reply}")
    if message.log is not None:
        facts.append(f"a log line ({message.log_level}): {comment_text(message.log).rstrip('.')}")
    text = comment_text(message.description)
    return f"{text}{'' if text.endswith('.') or not text else '.'} {', '.join(facts)}.".strip()


def id_literal(protocol: Protocol, value: int) -> str:
    sizes = [
        part.size
        for part in protocol.format.parts
        if part.kind == PartKind.ID or any(run.role == BitRole.ID for run in part.bits)
    ]
    return hex_literal(value, max(sizes, default=1))


def no_id_literal(protocol: Protocol) -> str:
    """What stands for the id of a message without one."""
    no_id = plan_for(protocol, End.HOST).no_id
    return hex_literal(no_id, 4) if no_id else id_literal(protocol, 0)


@dataclass(frozen=True)
class RulesView:
    """The rules over one message's payload, each as an initialiser."""

    name: str  # of the message
    index: int
    constants: tuple[str, ...]
    counts: tuple[str, ...]
    most_beside: int


def rules_views(protocol: Protocol, plan: Plan) -> tuple[RulesView, ...]:
    """Of all messages of the plan that have any, by rising index."""
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
    expected: tuple[tuple[int, str, str], ...]  # index, id, shape of the messages that only their request tells
    rules: tuple[RulesView, ...]
    bounds_by_counts: bool  # is a payload refused that is longer than its counts tell?
    counts_bytes: bool  # do the rules need to know that counts tell bytes, of elements or beside their number?
    matches: tuple[tuple[list[str], str, str], ...]  # what a frame has, its shape, its message; those expected first
    matches_late: bool
    structs: tuple[str, ...]
    latest: tuple[str, ...]  # of these, those of `queue: latest`
    never: tuple[str, ...]  # messages that only the other end sends
    header_defaults: tuple[str, ...]  # on the wire, of all header fields, also those of the other end's frames alone
    address: AddressView | None
    counts_messages: bool  # each message has its own sequence numbers


def _source_view(protocol: Protocol, end: End, plan: Plan) -> SourceView:
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


# ---- deadlines, emergency stop, services ------------------------------------------------------------------------


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
    """In which version an MCU answers."""

    place: int  # of the header field that holds the magic
    of_form: tuple[int, ...]  # by the form of a frame of the host
    width: int  # magics of a version
    magics: tuple[str, ...]  # of the MCU, in each version


def _versions_view(protocol: Protocol) -> VersionsView | None:
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
    """What a link at one end needs to know."""

    end: str
    name: str
    other: str
    title: str
    mistakable: tuple[str, ...]  # structs of what it sends and would take for the other end's if it came back
    knows_own_ids: bool  # of other messages that it sends the id says that they are its own
    scheduled: tuple[str, ...]  # structs of what it sends by itself, with their namespace
    log_lines: tuple[str, ...]  # those of log lines, which leave half of the send queue to others
    holds_back_strangers: bool  # the commands of a host that has another protocol hash
    versions: VersionsView | None  # in which it answers; None: there is one
    max_sent: int
    urgent_bytes: int  # of the ring of urgent messages; 0: there are none
    rules: tuple[str, ...]


def _end_view(protocol: Protocol, end: End) -> EndView:
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
        knows_own_ids=_ids_say_the_sender(protocol),
        scheduled=tuple(f"{names.namespace(protocol.name)}::{structs[m.name]}" for m in sent if m.every is not None),
        holds_back_strangers=end == End.MCU
        and protocol.service("hello") is not None
        and protocol.link.on_mismatch == Mismatch.HOLD_BACK,
        versions=_versions_view(protocol) if end == End.MCU else None,
        max_sent=max((protocol.max_wire_bytes(m.max_payload) for m in sent), default=1),
        urgent_bytes=_urgent_bytes(protocol, end),
        rules=deadlines.rules,
    )


def _ids_say_the_sender(protocol: Protocol) -> bool:
    """Not where more than an id tells messages, and not on a bus, where other MCUs send the same."""
    on_bus = any(field.address is not None for field in fields_of(protocol))
    return not on_bus and not any(m.match for m in protocol.messages)


def _mistakable(protocol: Protocol, end: End) -> list[Message]:
    """Messages that ``end`` sends and that its own receiver would take for the other end's, if they came back.

    Requests and replies of one message are left out: such a reply may equal its request, and is no echo.
    """
    sent = [m for m in protocol.messages if m.sent_by(end)]
    if not _ids_say_the_sender(protocol):
        return [m for m in sent if m.sender != End.BOTH or not _is_asked(protocol, m)]
    used = Counter(m.id for m in protocol.messages)
    return [m for m in sent if (m.sender == End.BOTH and not _is_asked(protocol, m)) or used[m.id] > 1]


def _is_asked(protocol: Protocol, message: Message) -> bool:
    return message.reply is not None or any(m.reply == message.name for m in protocol.messages)


def _urgent_bytes(protocol: Protocol, end: End) -> int:
    """A power of two that holds two of the largest urgent frames, wherever they begin."""
    urgent = [m for m in protocol.messages if m.sent_by(end) and m.queue == Queue.URGENT]
    largest = max((protocol.max_wire_bytes(m.max_payload) for m in urgent), default=0)
    return 1 << (4 * largest - 1).bit_length() if largest else 0


@dataclass(frozen=True)
class StopView:
    """The function that gives one message of the stop."""

    function: str
    struct: str
    assignments: tuple[str, ...]
    comparisons: tuple[str, ...]  # of a received `message` with `stop`
    header_function: str | None  # gives the header to send it with; None: frames have no header fields
    header_assignments: tuple[str, ...]


def stop_functions(protocol: Protocol) -> list[str]:
    """The functions for the stop's messages, in their order: with the message's name where there are several."""
    stops = protocol.emergency_stop
    return [
        "emergency_stop" if len(stops) == 1 else f"emergency_stop_{names.code_name(stop.message)}" for stop in stops
    ]


def stop_header_function(protocol: Protocol, function: str) -> str | None:
    """The function beside ``function`` that gives the header of its message; None: frames have no header fields."""
    return f"header_of_{function}" if fields_of(protocol) else None


def _emergency_stop(protocol: Protocol) -> list[StopView]:
    views = []
    for stop, function in zip(protocol.emergency_stop, stop_functions(protocol), strict=True):
        shape = message_shapes(protocol)[stop.message]
        values = dict(stop.values)
        lines = assign_lines(shape, values, "message")
        # Without values of its own its defaults count: else any message of this name would be the stop.
        compared = tuple(shape.member(name) for name in values) or shape.members
        header = header_shape(protocol)
        headed = [] if header is None else [_header_line(header, name, value) for name, value in stop.header]
        header_function = stop_header_function(protocol, function)
        same = equal_lines(compared, "message", "stop")
        views.append(StopView(function, shape.path, tuple(lines), tuple(same), header_function, tuple(headed)))
    return views


def _header_line(header: Shape, name: str, value: HeaderDefault) -> str:
    member = header.member(name)
    return f"header.{member.name} = {given_value(member, value)};"


def _services(protocol: Protocol) -> list[tuple[str, list[tuple[str, str]]]]:
    structs = struct_names(protocol)
    return [
        (names.type_name(service.name), [(names.type_name(role), structs[m]) for role, m in service.messages])
        for service in protocol.services
    ]
