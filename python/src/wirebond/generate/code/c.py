"""C99 for one protocol: headers for C firmware, and a .cpp for each that passes every call on to a C++ header."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from wirebond.generate.code.amalgamate import amalgamated
from wirebond.generate.code.c_header import (
    c_address_type,
    handlers_with_header,
    header_view,
    names_asked,
    names_receiver,
)
from wirebond.generate.code.c_link import LinkView, link_view
from wirebond.generate.code.c_names import Names, header_name, link_name
from wirebond.generate.code.c_struct import Declarations, Declarer, MessageView
from wirebond.generate.code.cpp import (
    cpp_header,
    frames_differ,
    link_header,
    message_comment,
    stop_functions,
    stop_header_function,
)
from wirebond.generate.code.cpp_field import comment_text
from wirebond.generate.code.cpp_header import fields_of
from wirebond.generate.code.cpp_names import id_literal, no_id_literal, shapes
from wirebond.generate.code.cpp_number import real
from wirebond.generate.code.folder import core_headers, render, write_files
from wirebond.generate.code.names import namespace
from wirebond.protocol.hash import protocol_hash
from wirebond.protocol.model import End, Message, Parity, Protocol, Stuffing
from wirebond.protocol.plan import Plan
from wirebond.protocol.planning import plan_for


def generate_c(protocol: Protocol, out: Path, *, amalgamate: bool = False) -> list[Path]:
    """Write ``<protocol>.h`` and ``.cpp``, ``<protocol>_link.h`` and ``.cpp``, their C++ headers, the core
    headers and a ``CMakeLists.txt`` into ``out``; return their paths, sorted.

    With ``amalgamate`` it is the first four files alone. As ``generate_cpp`` otherwise.
    """
    return write_files(out, c_files(protocol, amalgamate=amalgamate))


def c_files(protocol: Protocol, *, amalgamate: bool = False) -> dict[str, str]:
    """Return the text of each file that ``generate_c`` writes, by its name in the folder."""
    core, texts = core_headers(), c_texts(protocol)
    cpp = {f"{protocol.name}.hpp": cpp_header(protocol), f"{protocol.name}_link.hpp": link_header(protocol)}
    if amalgamate:
        return {name: amalgamated(text, cpp | core) for name, text in texts.items()}
    sources = [name for name in texts if name.endswith(".cpp")]
    cmake = render("c_CMakeLists.txt.j2", protocol=protocol, sources=sources)
    return {**texts, "CMakeLists.txt": cmake, **cpp, **core}


def c_texts(protocol: Protocol) -> dict[str, str]:
    """Return the texts of ``<protocol>.h`` and ``.cpp``, and of ``<protocol>_link.h`` and ``.cpp``, by the files'
    names."""
    values = _view(protocol)
    return {
        f"{header_name(protocol.name)}.h": render("c.h.j2", **values),
        f"{header_name(protocol.name)}.cpp": render("c.cpp.j2", **values),
        f"{link_name(protocol.name)}.h": render("c_link.h.j2", **values),
        f"{link_name(protocol.name)}.cpp": render("c_link.cpp.j2", **values),
    }


def link_in_c(protocol: Protocol) -> LinkView:
    """Return the C names of the link at the MCU: its types, functions and handlers."""
    link = _view(protocol)["link"]
    assert isinstance(link, LinkView)
    return link


def _view(protocol: Protocol) -> dict[str, object]:
    """Return the values for the C templates."""
    names = Names(protocol.name)
    constants = {
        word: names.constant(word)
        for word in (
            "protocol_name", "protocol_hash", "message_count", "baud", "data_bits", "parity", "stop_bits", "idle_us",
            "pause_us",
        )
    }  # fmt: skip
    facts = {message.name: _facts(protocol, names, index) for index, message in enumerate(protocol.messages)}
    functions = {
        message.name: {verb: names.claim(verb, message.name) for verb in ("init", "decode", "violations")}
        for message in protocol.messages
    }
    encoders = {message.name: _encoders(protocol, names, message) for message in protocol.messages}
    has_header = bool(fields_of(protocol))
    header_encoders = {
        message.name: _encoders(protocol, names, message, "with_header") if has_header else []
        for message in protocol.messages
    }
    has_numbers = plan_for(protocol, End.HOST).sequence is not None
    receivers = [_receiver_names(protocol, names, end, has_numbers=has_numbers) for end in (End.HOST, End.MCU)]
    watches = [_deadlines(protocol, names, end) for end in (End.HOST, End.MCU)]
    actions = list(dict.fromkeys(deadline.then for deadline in protocol.deadlines))
    action_type = names.claim("action", suffix="_t")
    action_constants = [names.constant("action", action) for action in actions]
    stop_names = [names.claim(function) for function in stop_functions(protocol)]
    header_functions = [stop_header_function(protocol, function) for function in stop_functions(protocol)]
    stop_headers = [(f and names.claim(f), f) for f in header_functions]  # in C, and in C++
    declarer = Declarer(names, namespace(protocol.name))
    views, shared = _messages(protocol, declarer, facts, functions, encoders, header_encoders)
    header = header_view(protocol, names, declarer)
    values: dict[str, object] = {
        "file": comment_text(Path(protocol.path).name or protocol.name),
        "description": comment_text(protocol.description),
        "protocol": protocol,
        "name": header_name(protocol.name),
        "namespace": namespace(protocol.name),
        "prefix": protocol.name,
        "guard": f"WIREBOND_GENERATED_{protocol.name.upper()}_H",
        "hash": f"0x{protocol_hash(protocol):016X}",
        "link_name": link_name(protocol.name),
        "constants": constants,
        "parity": {Parity.NONE: "N", Parity.EVEN: "E", Parity.ODD: "O"}[protocol.link.parity],
        "stop_bits": real(protocol.link.stop_bits, "float"),
        "idle_us": round(protocol.idle_seconds * 1e6),
        "pause_us": round(protocol.pause_seconds * 1e6),
        "types": shared,
        "header": header,
        "address_type": c_address_type(protocol),
        "with_header": {
            prefix: handlers_with_header(prefix, [message.name for message in protocol.messages]) if header else {}
            for prefix in ("on", "fill")
        },
        "messages": views,
        "receivers": [
            _receiver_view(protocol, names_of, end, views, watches)
            for end, names_of in zip((End.HOST, End.MCU), receivers, strict=True)
        ],
        "watches": [watch for watch in watches if watch is not None],
        "action_type": action_type,
        "actions": list(zip(actions, action_constants, strict=True)),
        "stops": [
            (name, function, next(view for view in views if view.name == stop.message), *headed)
            for name, function, stop, headed in zip(
                stop_names, stop_functions(protocol), protocol.emergency_stop, stop_headers, strict=True
            )
        ],
    }
    values["link"] = link_view(protocol, names, views)
    return values


# ---- messages ---------------------------------------------------------------------------------------------------


def _facts(protocol: Protocol, names: Names, index: int) -> list[tuple[str, str, str]]:
    message = protocol.messages[index]
    found = [
        ("id", *_id(protocol, message)),
        ("index", str(index), ""),
        ("every_us", str(round((message.every or 0) * 1e6)), "" if message.every else "0: no schedule"),
        ("min_payload_bytes", str(message.min_payload), ""),
        ("max_payload_bytes", str(message.max_payload), ""),
        ("max_frame_bytes", str(protocol.max_wire_bytes(message.max_payload)), "on the wire"),
    ]
    return [(names.constant(message.name, word), literal, comment) for word, literal, comment in found]


def _id(protocol: Protocol, message: Message) -> tuple[str, str]:
    if message.has_id or not plan_for(protocol, End.HOST).no_id:
        return id_literal(protocol, message.id), ""
    return no_id_literal(protocol), "none: its frames carry no id"


def _encoders(protocol: Protocol, names: Names, message: Message, *more: str) -> list[tuple[str, str]]:
    """Return one function; two for a message of both ends whose frames differ, since only the caller knows the sender.
    ``more``: words after its name."""
    if message.sender != End.BOTH or not frames_differ(protocol):
        return [(names.claim("encode", message.name, *more), "")]
    return [
        (names.claim("encode", message.name, f"from_{end}", *more), f"<{namespace(protocol.name)}::{source}>")
        for end, source in ((End.HOST, "FromHost"), (End.MCU, "FromMcu"))
    ]


def _messages(
    protocol: Protocol,
    declarer: Declarer,
    facts: dict[str, list[tuple[str, str, str]]],
    functions: dict[str, dict[str, str]],
    encoders: dict[str, list[tuple[str, str]]],
    header_encoders: dict[str, list[tuple[str, str]]],
) -> tuple[list[MessageView], Declarations]:
    """Return the messages, and what the file's types declare."""
    types, structs = shapes(protocol)
    declarer.named(types)
    shared = declarer.take()
    views = []
    for index, message in enumerate(protocol.messages):
        shape = structs[message.name]
        has_members = any(member.name for member in shape.members)
        views.append(
            MessageView(
                name=message.name,
                comment=message_comment(message),
                facts=facts[message.name],
                type_name=declarer.struct(shape, message.name) if has_members else "",
                declared=declarer.take(),
                cpp=f"{namespace(protocol.name)}::{shape.path}",
                functions=functions[message.name],
                encoders=encoders[message.name],
                header_encoders=header_encoders[message.name],
                index=index,
                sender=message.sender,
                reply=message.reply,
            )
        )
    return views, shared


# ---- receivers and deadlines ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class DeadlinesView:
    """The deadlines that one end watches."""

    end: End
    title: str
    type_name: str
    actions_type: str
    prefix: str  # of its functions
    rules: int
    actions: tuple[str, ...]

    @property
    def cpp_class(self) -> str:
        return f"{'Host' if self.end == End.HOST else 'Mcu'}Deadlines"


def _deadlines(protocol: Protocol, names: Names, end: End) -> DeadlinesView | None:
    here = [deadline for deadline in protocol.deadlines if deadline.at in (end, End.BOTH)]
    if not here:
        return None
    prefix = names.claim(end.value, "deadlines")
    for verb in ("init", "poll", "recover", "struck", "not_acted"):
        names.claim(end.value, "deadlines", verb)
    return DeadlinesView(
        end,
        "MCU" if end == End.MCU else "host",
        names.claim(end.value, "deadlines", suffix="_t"),
        names.claim(end.value, "actions", suffix="_t"),
        prefix,
        len(here),
        tuple(dict.fromkeys(deadline.then for deadline in here)),
    )


@dataclass(frozen=True)
class ReceiverView:
    """The messages that one end receives from the other."""

    source: str  # in C++
    sender: str
    receiver: str
    type_name: str
    handlers_type: str
    prefix: str  # of its functions
    workspace: int
    messages: tuple[MessageView, ...]
    requests: tuple[MessageView, ...]  # requests whose replies are identified only by them
    watch: DeadlinesView | None
    asked: tuple[MessageView, ...]  # requests, where the replies say whose they are
    listens: bool  # do frames say for whom they are?
    has_numbers: bool  # have they a sequence number?


_RECEIVER_FUNCTIONS = ("init", "feed", "idle", "expect", "watch", "account", "violations")
_ADDRESS_FUNCTIONS = ("set_address", "address", "listen_to_all", "addressee", "foreign")
_ADDRESS_BYTES = 24  # that a receiver takes more where frames say for whom they are
_ASKED_FUNCTIONS = ("expect_from", "foreign")
_ASKED_BYTES = 24  # that a receiver takes more where the MCU's frames say whose they are


def _sequence_bytes(protocol: Protocol, plan: Plan) -> int:
    """Return the additional bytes of a receiver for frames with a sequence number: `SequenceWatch` of
    wirebond/sequence.hpp."""
    if plan.sequence is None:
        return 0
    number = next(size for size in (1, 2, 4, 8) if plan.header[plan.sequence].value.width <= 8 * size)
    counters = len(protocol.messages) if plan.sequence_per_message else 1
    return (1 if plan.peer is None else 4) * (16 + 2 * number * counters) + 24


def _receiver_names(protocol: Protocol, names: Names, end: End, *, has_numbers: bool) -> tuple[str, str, str]:
    prefix = names.claim("from", end.value)
    verbs = [*_RECEIVER_FUNCTIONS]
    verbs += _ADDRESS_FUNCTIONS if names_receiver(protocol, end) else ()
    verbs += _ASKED_FUNCTIONS if names_asked(protocol, end) else ()
    verbs += ("sequence",) if has_numbers else ()
    for verb in dict.fromkeys(verbs):
        names.claim("from", end.value, verb)
    return (
        names.claim("from", end.value, suffix="_t"),
        names.claim("from", end.value, "handlers", suffix="_t"),
        prefix,
    )


def _receiver_view(
    protocol: Protocol,
    names_of: tuple[str, str, str],
    end: End,
    views: list[MessageView],
    watches: list[DeadlinesView | None],
) -> ReceiverView:
    """Return the view of the messages that ``end`` sends; the other end watches its deadlines."""
    type_name, handlers_type, prefix = names_of
    largest = protocol.max_wire_bytes(sender=end)
    listens = names_receiver(protocol, end)
    asks = names_asked(protocol, end)
    plan = plan_for(protocol, end)
    told_by_request = {protocol.messages[row.index].name for row in plan.messages if row.only_expected}
    return ReceiverView(
        source="FromHost" if end == End.HOST else "FromMcu",
        sender="host" if end == End.HOST else "MCU",
        receiver="MCU" if end == End.HOST else "host",
        type_name=type_name,
        handlers_type=handlers_type,
        prefix=prefix,
        workspace=2 * largest
        + (0 if protocol.format.stuffing == Stuffing.NONE else largest)
        + (_ADDRESS_BYTES if listens else 0)
        + (_ASKED_BYTES if asks else 0)
        + _sequence_bytes(protocol, plan),
        messages=tuple(view for view in views if view.sender in (end, End.BOTH)),
        requests=tuple(view for view in views if view.reply in told_by_request),
        watch=next((w for w in watches if w is not None and w.end != end), None),
        asked=tuple(view for view in views if asks and view.reply is not None),
        listens=listens,
        has_numbers=plan.sequence is not None,
    )
