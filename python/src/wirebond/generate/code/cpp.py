"""C++17 for one protocol: a folder that a firmware project adds as it is. Frames are laid out by the plan."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from wirebond.generate.code import names
from wirebond.generate.code.amalgamate import amalgamated
from wirebond.generate.code.cpp_counters import counter_lines
from wirebond.generate.code.cpp_ends import _deadline_view, end_view, source_view
from wirebond.generate.code.cpp_field import comment_text
from wirebond.generate.code.cpp_format import format_lines, format_sizes, update_call
from wirebond.generate.code.cpp_given import assign_lines, equal_lines, given_value
from wirebond.generate.code.cpp_header import (
    ends_differ,
    fields_of,
    header_shape,
    header_view,
)
from wirebond.generate.code.cpp_match import sent_tests
from wirebond.generate.code.cpp_names import id_literal, message_shapes, no_id_literal, shapes, struct_names
from wirebond.generate.code.cpp_number import real
from wirebond.generate.code.cpp_read import Reader
from wirebond.generate.code.cpp_rules import clamp_lines, validate_lines
from wirebond.generate.code.cpp_shape import (
    Shape,
    known_enums,
    member_lines,
    struct_lines,
    type_blocks,
)
from wirebond.generate.code.cpp_write import size_lines, write_lines
from wirebond.generate.code.folder import core_headers, render, write_files
from wirebond.protocol.hash import protocol_hash
from wirebond.protocol.model import (
    End,
    HeaderDefault,
    Message,
    PartKind,
    PayloadRule,
    Protocol,
    Queue,
)
from wirebond.protocol.planning import plan_for


def generate_cpp(protocol: Protocol, out: Path, *, amalgamate: bool = False) -> list[Path]:
    """Write ``<protocol>.hpp``, ``<protocol>_link.hpp``, the core headers and a ``CMakeLists.txt`` into ``out``; return
    their paths, sorted.

    The folder needs nothing else. With ``amalgamate`` all of it is one ``<protocol>.hpp``. The same protocol always
    gives the same bytes, and a file that already holds them is not touched, so that a build after it has nothing to do.
    ``OSError`` when a file cannot be written.
    """
    return write_files(out, cpp_files(protocol, amalgamate=amalgamate))


def cpp_files(protocol: Protocol, *, amalgamate: bool = False) -> dict[str, str]:
    """Return the text of each file that ``generate_cpp`` writes, by its name in the folder."""
    name, core = f"{protocol.name}.hpp", core_headers()
    header, link = cpp_header(protocol), link_header(protocol)
    if amalgamate:
        return {name: amalgamated(link, {name: header, **core})}
    cmake = render("CMakeLists.txt.j2", protocol=protocol)
    return {name: header, f"{protocol.name}_link.hpp": link, "CMakeLists.txt": cmake, **core}


def cpp_header(protocol: Protocol) -> str:
    """Return the text of ``<protocol>.hpp``."""
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
        sources=[source_view(protocol, end, plans[end]) for end in (End.HOST, End.MCU)],
        actions=[names.identifier(action) for action in dict.fromkeys(d.then for d in protocol.deadlines)],
        ends=[_deadline_view(protocol, end) for end in (End.HOST, End.MCU)],
        stops=_emergency_stop(protocol),
        services=_services(protocol),
    )


def link_header(protocol: Protocol) -> str:
    """Return the text of ``<protocol>_link.hpp``."""
    return render(
        "cpp_link.hpp.j2",
        file=comment_text(Path(protocol.path).name or protocol.name),
        protocol=protocol,
        namespace=names.namespace(protocol.name),
        hash=f"0x{protocol_hash(protocol):016X}",
        bytes_per_second=int(protocol.link.baud / protocol.link.bits_per_byte),
        services=[service for service, _ in _services(protocol)],
        counter_lines=counter_lines(protocol.service("counters"), message_shapes(protocol)),
        ends=[end_view(protocol, end) for end in (End.MCU, End.HOST)],
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
    match: tuple[str, ...]  # tests of its sent values, as initialisers
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


def frames_differ(protocol: Protocol) -> bool:
    """Return whether frames look different from each end, by a magic for each direction."""
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


# ---- deadlines, emergency stop, services ------------------------------------------------------------------------


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
    """Return the functions for the stop's messages, in their order: with the message's name where there are several."""
    stops = protocol.emergency_stop
    return [
        "emergency_stop" if len(stops) == 1 else f"emergency_stop_{names.code_name(stop.message)}" for stop in stops
    ]


def stop_header_function(protocol: Protocol, function: str) -> str | None:
    """Return the function beside ``function`` that gives the header of its message; None: frames have no header
    fields."""
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
