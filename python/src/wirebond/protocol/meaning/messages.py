"""The `messages` section: every message by itself, then ids, names and replies among them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from wirebond.protocol import names
from wirebond.protocol.matching import id_key
from wirebond.protocol.meaning.log_text import log_fault
from wirebond.protocol.meaning.structs import Types, read_fields
from wirebond.protocol.model import End, Field, LogLevel, Message, Queue
from wirebond.protocol.plan import NO_ID
from wirebond.protocol.problems import Place, Problems, suggestion
from wirebond.protocol.text.grammar import MessageHead
from wirebond.protocol.text.matching import MatchText
from wirebond.protocol.text.syntax import readable
from wirebond.protocol.text.yaml_tree import Mapping, Node


@dataclass(frozen=True)
class Entry:
    """A message of the file. ``message`` is None where its own keys are wrong, which has been reported."""

    name: str
    place: Place  # of its name
    node: Mapping
    message: Message | None
    has_all_fields: bool
    ids: MatchText | None = None  # several, which `matching.py` reads
    match: tuple[tuple[str, MatchText], ...] = ()

    @property
    def complete(self) -> Message | None:
        """The message, if all of it is right: sizes and fields may be relied on."""
        return self.message if self.has_all_fields else None


Messages = dict[str, Entry]  # every name of the file, so that a reference to a wrong message is no second error


def read_messages(node: Node | None, types: Types, problems: Problems) -> Messages:
    found: Messages = {}
    if not isinstance(node, Mapping):
        return found
    for name, entry in node.entries.items():
        if isinstance(entry.value, Mapping):
            found[name] = _read_message(name, entry.key_place, entry.value, types, problems)
        else:
            found[name] = Entry(name, entry.key_place, Mapping(entry.value.place), None, False)
    _validate_type_names(found, types, problems)
    _validate_replies(found, problems)
    return found


def receiver_of(end: End) -> End:
    return End.MCU if end == End.HOST else End.HOST


def spoken(end: End) -> str:
    """Return the end in a sentence, after "the"."""
    return "MCU" if end == End.MCU else end.value


def _read_message(name: str, place: Place, node: Mapping, types: Types, problems: Problems) -> Entry:
    fields, complete = read_fields(node.get("fields"), types)
    without_fields = Mapping(node.place, {key: entry for key, entry in node.entries.items() if key != "fields"})
    head = readable(MessageHead, without_fields)
    if head is None or names.fault(name):
        return Entry(name, place, node, None, complete)
    if head.log is not None:
        fault = log_fault(head.log, fields if complete else None)
        if fault:
            problems.add(node.value_place("log"), fault)
        if head.sender == End.HOST:
            problems.add(node.value_place("sender"), "a log line is the MCU's; write `sender: mcu`, or remove `log`")
    elif head.level is not None:
        problems.add(node.key_place("level"), "`level` belongs to a log line; add `log: ...`, or remove it")
    message = Message(
        name=name,
        id=head.id if isinstance(head.id, int) else 0,
        has_id=head.id is not None,
        sender=End(head.sender),
        fields=fields,
        every=head.every,
        reply=head.reply,
        seed=head.seed,
        queue=Queue(head.queue),
        log=head.log,
        log_level=LogLevel(head.level or LogLevel.INFO),
        description=head.description,
    )
    ids = head.id if isinstance(head.id, MatchText) else None
    return Entry(name, place, node, message, complete, ids, tuple(head.match.items()))


def _validate_type_names(messages: Messages, types: Types, problems: Problems) -> None:
    """Check names: messages and the file's types become structs side by side."""
    taken: dict[str, str] = {}
    for name, place in (*types.names().items(), *((entry.name, entry.place) for entry in messages.values())):
        if names.fault(name):
            continue
        type_name = names.type_name(name)
        if type_name in taken:
            problems.add(place, f"`{name}` and `{taken[type_name]}` both become `{type_name}` in C++; rename one")
        taken.setdefault(type_name, name)


def _validate_replies(messages: Messages, problems: Problems) -> None:
    for entry in messages.values():
        message = entry.message
        if message is None or message.reply is None:
            continue
        place = entry.node.value_place("reply")
        if message.reply not in messages:
            problems.add(place, f"there is no message `{message.reply}`; {suggestion(message.reply, messages)}")
            continue
        reply = messages[message.reply].message
        if reply is None:
            continue
        for asking in (End.HOST, End.MCU):
            answering = receiver_of(asking)
            if message.sent_by(asking) and not reply.sent_by(answering):
                problems.add(
                    place,
                    f"the {spoken(asking)} sends `{message.name}`, so its reply must come from the "
                    f"{spoken(answering)}, "
                    f"and `{reply.name}` does not; change its `sender`",
                )
    for entry in messages.values():
        if entry.message is not None:
            _validate_asked(entry, entry.message, messages, problems)
            _validate_stamps(entry, entry.message, problems)


def _validate_asked(entry: Entry, message: Message, messages: Messages, problems: Problems) -> None:
    """Validate that the requests of a reply have the fields with the number of elements that they ask for."""
    fields = entry.node.get("fields")
    for one in message.fields:
        if not isinstance(fields, Mapping):
            return
        place = fields.key_place(one.name)
        if any(inner.asked_by for inner in _within(one)):
            problems.add(place, "`asked_by` is for a list in the message itself; remove it here")
        if not one.asked_by:
            continue
        requests = [e.message for e in messages.values() if e.message is not None and e.message.reply == message.name]
        if not requests:
            problems.add(
                place,
                f"no message has the reply `{message.name}`, so no request asks; write `reply: {message.name}` in the "
                "request, or remove `asked_by`",
            )
        for request in requests:
            asking = next((field for field in request.fields if field.name == one.asked_by), None)
            if asking is None or not asking.is_unsigned or asking.count or asking.is_list or asking.is_scaled:
                problems.add(
                    place,
                    f"`{request.name}`, which asks for this reply, has no whole number `{one.asked_by}`; add it there: "
                    f"`{one.asked_by}: {{type: u16}}`",
                )


def _validate_stamps(entry: Entry, message: Message, problems: Problems) -> None:
    """Validate that a message has one stamp at most, and that the MCU sends it."""
    fields = entry.node.get("fields")
    if not isinstance(fields, Mapping):
        return
    found = ""
    for one in message.fields:
        place = fields.key_place(one.name)
        if any(inner.clock for inner in _within(one)):
            problems.add(place, "`clock` is for a field of the message itself; remove it here")
        if one.clock is None:
            continue
        if message.sender != End.MCU:
            problems.add(
                place, f"the MCU alone stamps its messages; remove `clock`, or write `sender: mcu` in `{message.name}`"
            )
        if one.is_count:
            problems.add(place, f"`{one.name}` counts elements, so it is not a time; remove `clock`")
        if found:
            problems.add(place, f"`{found}` says already when `{message.name}` was measured; keep one `clock`")
        found = found or one.name


def _within(field: Field) -> Iterator[Field]:
    for inner in field.fields:
        yield inner
        yield from _within(inner)


def validate_ids(messages: Messages, id_bits: int, with_id: set[End], without_id: set[End], problems: Problems) -> None:
    """Check the ids. ``id_bits``: width of the frame's id; 0 if it has none. ``with_id``: the ends that have frames
    with it; ``without_id``: those that have frames without it."""
    taken: dict[tuple[End, int | None], Entry] = {}
    replies = {entry.message.reply for entry in messages.values() if entry.message is not None}
    for entry in messages.values():
        message = entry.message
        if message is None:
            continue
        sentence = _id_fault(message, with_id, without_id, bool(id_bits))
        if sentence:
            problems.add(entry.node.key_place("id") if message.has_id else entry.place, sentence)
            continue
        limit = min(2**id_bits, NO_ID if with_id & without_id else 2**32) - 1
        if message.has_id and message.id > limit:
            problems.add(
                entry.node.value_place("id"),
                f"id {message.id} does not fit the frame's id part, whose maximum is {limit}; choose a smaller one",
            )
        for end in (End.HOST, End.MCU):
            if not message.sent_by(end) or entry.match or entry.ids is not None:  # their matches are compared
                continue
            other = taken.setdefault((end, id_key(message)), entry)
            if other is entry:
                continue
            if message.name in replies and message.seed != (other.message.seed if other.message else None):
                problems.add(
                    entry.place,
                    f"`{entry.name}` and `{other.name}` (line {other.place.line}) share their id; give both the "
                    "same `seed`",
                )
                break
            if message.name in replies:  # its request identifies it
                continue
            if other.name in replies:  # and this one is meant if there was no request
                taken[end, id_key(message)] = entry
                continue
            where = f"line {other.place.line}"
            if message.has_id:
                problems.add(
                    entry.node.value_place("id"),
                    f"the {spoken(end)} sends `{other.name}` ({where}) under id 0x{message.id:02X} already; "
                    f"take another id, or name `{entry.name}` as the `reply` of its request",
                )
            else:
                advice = "give it an id" if end in with_id else "add `- id: u8` to the frame"
                problems.add(
                    entry.place,
                    f"without an `id` part the frame can carry one message from the {spoken(end)}, which is "
                    f"`{other.name}` ({where}); {advice}, or name `{entry.name}` as the `reply` of its request",
                )
            break


def _id_fault(message: Message, with_id: set[End], without_id: set[End], has_part: bool) -> str:
    """Return why no frame of a sender of this message can carry it; empty if one can."""
    ends = [end for end in (End.HOST, End.MCU) if message.sent_by(end)]
    with_none = [end for end in ends if end not in with_id]
    with_one = [end for end in ends if end not in without_id]
    if with_none and with_one:
        return (
            f"frames of the {spoken(with_one[0])} have an id and those of the {spoken(with_none[0])} have none, so "
            f"that both cannot carry `{message.name}`; make it two messages, one for each sender"
        )
    if message.has_id and with_none:
        of = f" of the {spoken(message.sender)}" if has_part else ""
        return f"the frame{of} has no `id` part; remove this id, or add `- id: u8` there"
    if not message.has_id and with_one:
        return f"`{message.name}` needs an id, for the frame has one; add `id: 0x01`"
    return ""
