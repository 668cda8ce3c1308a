"""The sections that refer to messages: deadlines, the emergency stop, services."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from wirebond.protocol.counters import COUNTERS
from wirebond.protocol.meaning.draft import Draft
from wirebond.protocol.meaning.given_values import ValueReader
from wirebond.protocol.meaning.header import read_header_values
from wirebond.protocol.meaning.messages import Entry, Messages, receiver_of, spoken
from wirebond.protocol.model import (
    Deadline,
    End,
    Field,
    GivenMessage,
    Message,
    Recover,
    Service,
    Start,
)
from wirebond.protocol.names import action_fault, meeting, meeting_fault
from wirebond.protocol.problems import Place, Problems, suggestion
from wirebond.protocol.text.grammar import DeadlineSyntax, GivenMessageSyntax, Services
from wirebond.protocol.text.syntax import readable
from wirebond.protocol.text.yaml_tree import Mapping, Node, Sequence


def _find(name: str, place: Place, messages: Messages, problems: Problems) -> Entry | None:
    if name in messages:
        return messages[name]
    if messages:  # else all of them are missing, and that is said already
        problems.add(place, f"there is no message `{name}`; {suggestion(name, messages)}")
    return None


# ---- a message with its values ---------------------------------------------------------------------


def _read_given(
    node: Node | None, what: str, messages: Messages, draft: Draft | None, problems: Problems
) -> GivenMessage | None:
    syntax = readable(GivenMessageSyntax, node) if isinstance(node, Mapping) else None
    if syntax is None or not isinstance(node, Mapping):
        return None
    entry = _find(syntax.message, node.value_place("message"), messages, problems)
    if entry is None or entry.message is None:
        return None
    place = node.value_place("message")
    if not entry.message.sent_by(End.HOST):
        problems.add(
            place,
            f"`{syntax.message}` comes from the MCU, and the host sends {what}; name a message of the host",
        )
        return None
    if entry.complete is None:
        return None
    given = {**(syntax.__pydantic_extra__ or {}), **syntax.fields}
    header_values = syntax.header
    if not isinstance(header_values, dict):  # it can only be the value of a field of the message
        if all(field.name != "header" for field in entry.complete.fields):
            problems.add(
                node.value_place("header"),
                f"`header` has values of the frame's header, by their names; `{syntax.message}` has no field `header`. "
                "Write for example `header: {servo: 1}`",
            )
            return None
        given.setdefault("header", header_values)
        header_values = {}
    inner = node.get("fields")
    places = {name: inner if name in syntax.fields and isinstance(inner, Mapping) else node for name in given}
    reader = ValueReader(what, problems, beside=True)
    values = reader.message(syntax.message, entry.complete.fields, given, places, place)
    header = None if draft is None else read_header_values(header_values, draft.parts, node, problems)
    return GivenMessage(syntax.message, tuple((values or {}).items()), tuple((header or {}).items()))


# ---- deadlines -----------------------------------------------------------------------------------


def read_deadlines(
    node: Node | None, messages: Messages, draft: Draft | None, problems: Problems
) -> tuple[Deadline, ...]:
    deadlines: list[Deadline] = []
    for item in node.items if isinstance(node, Sequence) else ():
        syntax = readable(DeadlineSyntax, item)
        if syntax is None or not isinstance(item, Mapping):
            continue
        recover_by = _read_given(item.get("recover_by"), "`recover_by`", messages, draft, problems)
        deadline = Deadline(
            syntax.message,
            End(syntax.at),
            syntax.after,
            syntax.then,
            Recover(syntax.recover),
            recover_by,
            Start(syntax.start),
        )
        _validate_deadline(deadline, item, messages, problems)
        for name, other in meeting([*dict.fromkeys(d.then for d in deadlines), deadline.then]):
            problems.add(item.value_place("then"), meeting_fault(name, other))
        if fault := action_fault(deadline.then):
            problems.add(item.value_place("then"), f"`{deadline.then}` {fault}")
        same = [d for d in deadlines if (d.message, d.at, d.then) == (deadline.message, deadline.at, deadline.then)]
        if same:
            problems.add(
                item.key_place("then"),
                f"`{deadline.then}` is done after {same[0].after:g} s without `{deadline.message}` already; remove one",
            )
        deadlines.append(deadline)
    return tuple(deadlines)


def _validate_deadline(deadline: Deadline, node: Mapping, messages: Messages, problems: Problems) -> None:
    entry = _find(deadline.message, node.value_place("message"), messages, problems)
    if entry is None or entry.message is None:
        return
    message = entry.message
    sender = receiver_of(deadline.at)
    if not message.sent_by(sender):
        problems.add(
            node.value_place("at"),
            f"`{message.name}` comes from the {spoken(message.sender)}, so the "
            f"{spoken(deadline.at)} cannot miss "
            f"it; write `at: {sender}`",
        )
    if message.every is not None and deadline.after < message.every:
        problems.add(
            node.value_place("after"),
            f"`{message.name}` is due every {message.every:g} s only, so this deadline would strike "
            "between two messages; write more than that",
        )
    if deadline.start == Start.HELD and (deadline.at != End.MCU or deadline.recover != Recover.EXPLICIT):
        problems.add(
            node.value_place("start"),
            "only a deadline with `at: mcu` and `recover: explicit` can hold back its message from the start, "
            "because only `recover` ends it; write both, or remove `start`",
        )
    if deadline.recover_by is not None:
        _validate_recover_by(deadline, deadline.recover_by.message, node, problems)


def _validate_recover_by(deadline: Deadline, by: str, node: Mapping, problems: Problems) -> None:
    if deadline.at != End.MCU or deadline.recover != Recover.EXPLICIT:
        problems.add(
            node.key_place("recover_by"),
            "only a deadline with `at: mcu` and `recover: explicit` is ended by a message of its own; remove "
            "`recover_by`, or write both",
        )
    elif by == deadline.message:
        problems.add(
            node.value_place("recover_by"),
            f"`{by}` is held back itself while `{deadline.then}` lasts; name another message of the host",
        )


# ---- emergency stop ------------------------------------------------------------------------------


def read_emergency_stop(
    node: Node | None, messages: Messages, draft: Draft | None, problems: Problems
) -> tuple[GivenMessage, ...]:
    stops: list[GivenMessage] = []
    for item in node.items if isinstance(node, Sequence) else (node,):
        stop = _read_given(item, "the stop", messages, draft, problems)
        if stop is None or not isinstance(item, Mapping):
            continue
        if any(stop.message == other.message for other in stops):
            problems.add(
                item.value_place("message"),
                f"`{stop.message}` is in the stop already; give it the values that stop once",
            )
        stops.append(stop)
    return tuple(stops)


# ---- services ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Role:
    """The requirements of a service for the message in one of its roles."""

    service: str
    role: str
    sender: End
    fields: tuple[tuple[str, tuple[str, ...]], ...]  # each with its kinds, as `_kind` says them


_WHOLE = ("unsigned",)
_ANY = ("unsigned", "signed", "float")
_ROLES = (
    _Role("hello", "message", End.BOTH, (("protocol_hash", _WHOLE), ("version", _WHOLE))),
    _Role("ping", "request", End.HOST, (("number", _WHOLE),)),
    _Role("ping", "reply", End.MCU, (("number", _WHOLE),)),
    _Role("clock", "request", End.HOST, (("host_us", _WHOLE),)),
    _Role("clock", "reply", End.MCU, (("host_us", _WHOLE), ("received_us", _WHOLE), ("sent_us", _WHOLE))),
    _Role("log", "message", End.MCU, (("level", _WHOLE), ("text", ("text",)))),
    _Role("parameter", "read", End.HOST, (("index", _WHOLE),)),
    _Role("parameter", "set", End.HOST, (("index", _WHOLE), ("value", _ANY))),
    _Role("parameter", "value", End.MCU, (("index", _WHOLE), ("value", _ANY), ("result", _WHOLE))),
    _Role("counters", "message", End.MCU, ()),
)


def read_services(node: Node | None, messages: Messages, problems: Problems) -> tuple[Service, ...]:
    services: list[Service] = []
    for name, entry in node.entries.items() if isinstance(node, Mapping) else ():
        info = Services.model_fields.get(name)
        if info is None or not isinstance(entry.value, Mapping):
            continue
        syntax: Any = readable(Services, Mapping(entry.value.place, {name: entry}))
        if syntax is None:
            continue
        roles = dict(getattr(syntax, name))
        for expected in _ROLES:
            if expected.service == name:
                _validate_role(expected, roles[expected.role], entry.value, messages, problems)
        services.append(Service(name, tuple(roles.items())))
    return tuple(services)


def _kind(field: Field) -> str:
    """Return the kind of a field, as services name it."""
    if not field.is_integer:
        return field.kind.value
    return "signed" if field.coding.is_signed else field.coding.name


def _validate_role(expected: _Role, name: str, node: Mapping, messages: Messages, problems: Problems) -> None:
    place = node.value_place(expected.role)
    entry = _find(name, place, messages, problems)
    if entry is None or entry.message is None:
        return
    if entry.message.sender != expected.sender:
        wanted = "both ends send" if expected.sender == End.BOTH else f"the {spoken(expected.sender)} sends"
        problems.add(
            place,
            f"for `{expected.service}` {wanted} the `{expected.role}`, and `{name}` has `sender: "
            f"{entry.message.sender}`; "
            f"write `sender: {expected.sender}` there",
        )
    if entry.complete is None:
        return
    fields = {field.name: field for field in entry.complete.fields}
    for field_name, kinds in expected.fields:
        field = fields.get(field_name)
        if field is None:
            problems.add(place, f"`{expected.service}` needs a field `{field_name}` in `{name}`; add it there")
        elif _kind(field) not in kinds or field.count is not None or field.is_list or field.is_scaled:
            problems.add(
                place,
                f"`{expected.service}` needs `{field_name}` in `{name}` to be one unscaled value of kind "
                f"{' or '.join(kinds)}; change its type",
            )
    if expected.service == "hello" and "protocol_hash" in fields and fields["protocol_hash"].width < 64:
        problems.add(place, f"`protocol_hash` in `{name}` carries 64 bits; give it the type u64")
    if expected.service == "counters":
        _validate_counters(entry.message, tuple(fields.values()), place, problems)


def _validate_counters(message: Message, fields: tuple[Field, ...], place: Place, problems: Problems) -> None:
    """Check that its fields are named after the link's counters, and that there is at least one."""
    if message.every is None:
        problems.add(place, f"the MCU sends its counters by itself; give `{message.name}` an `every`, such as `1 s`")
    counters = [field for field in fields if field.name in COUNTERS]
    if not counters:
        problems.add(
            place,
            f"no field of `{message.name}` is called like a counter of the MCU's link; add one or several of: "
            f"{', '.join(COUNTERS)}",
        )
    for field in counters:
        is_single = field.count is None and not field.is_list
        if not field.is_unsigned or not is_single or field.is_scaled or field.enum or field.flags:
            problems.add(
                place,
                f"the counter `{field.name}` in `{message.name}` is not a plain unsigned integer; give it the type u32",
            )
        elif field.minimum is not None:
            problems.add(place, f"the counter `{field.name}` in `{message.name}` takes every value; remove its `range`")
