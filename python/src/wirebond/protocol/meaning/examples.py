"""The `examples` section: values and bytes that belong together. Whether they do is not tested here (see ``lint``)."""

from __future__ import annotations

import re
from fractions import Fraction

from wirebond.protocol.meaning.draft import Draft
from wirebond.protocol.meaning.field_values import fit_element, settled
from wirebond.protocol.meaning.header import read_header_values
from wirebond.protocol.meaning.messages import Messages, spoken
from wirebond.protocol.model import End, Example, ExampleValue, Field, FieldKind, Message
from wirebond.protocol.problems import Place, Problems, suggestion
from wirebond.protocol.text.grammar import ExampleSyntax
from wirebond.protocol.text.syntax import readable
from wirebond.protocol.text.yaml_tree import Mapping, Node, Sequence


def read_examples(
    node: Node | None, messages: Messages, draft: Draft | None, problems: Problems
) -> tuple[Example, ...]:
    """Every example whose message and values can be read; what is wrong with others is reported.

    ``draft``: the frame, whose header fields may be given; None if it is wrong itself.
    """
    found: list[Example] = []
    for item in node.items if isinstance(node, Sequence) else ():
        syntax = readable(ExampleSyntax, item)
        if syntax is None or not isinstance(item, Mapping):
            continue
        entry = messages.get(syntax.message)
        if entry is None:
            if messages:
                place = item.value_place("message")
                problems.add(place, f"there is no message `{syntax.message}`; {suggestion(syntax.message, messages)}")
            continue
        message = entry.complete
        if message is None:
            continue
        sender = _sender(syntax.sender, message, item, problems)
        given = item.get("fields")
        values = _values(syntax.fields, message.name, message.fields, given, item.value_place("fields"), problems)
        header = {} if draft is None else read_header_values(syntax.header, draft.parts, item, problems)
        if sender is not None and values is not None and header is not None:
            found.append(Example(message.name, sender, tuple(values.items()), syntax.bytes, tuple(header.items())))
    return tuple(found)


def _sender(given: str | None, message: Message, node: Mapping, problems: Problems) -> End | None:
    if given is None:
        return End.HOST if message.sender == End.BOTH else message.sender
    sender = End(given)
    if message.sent_by(sender):
        return sender
    problems.add(
        node.value_place("sender"),
        f"`{message.name}` comes from the {spoken(message.sender)}; remove `sender`",
    )
    return None


def _values(
    given: object, owner: str, fields: tuple[Field, ...], node: Node | None, place: Place, problems: Problems
) -> dict[str, ExampleValue] | None:
    """Values of fields that stand beside each other; None after reporting what is wrong."""
    if not isinstance(given, dict) or (given and not isinstance(node, Mapping)):
        names = ", ".join(field.name for field in fields if field.kind != FieldKind.PADDING)
        problems.add(place, f"`{owner}` has fields; write a mapping of {names}")
        return None
    known = {field.name: field for field in fields if field.kind != FieldKind.PADDING}
    missing = [name for name in known if name not in given and name not in settled(fields)]
    if missing:
        problems.add(
            place,
            f"the example leaves `{missing[0]}` of `{owner}` open; add for example `{missing[0]}: 0`",
        )
    values: dict[str, ExampleValue] = {}
    wrong = bool(missing)
    for name, wanted in given.items():
        assert isinstance(node, Mapping), "fields were given"
        if name not in known:
            there = suggestion(name, known) if known else "it has no fields at all"
            problems.add(node.key_place(name), f"`{owner}` has no field `{name}`; {there}")
            wrong = True
            continue
        value = _value(known[name], wanted, node.get(name), node.value_place(name), problems)
        if value is None:
            wrong = True
        else:
            values[name] = value
    return None if wrong else values


def _value(field: Field, wanted: object, node: Node | None, place: Place, problems: Problems) -> ExampleValue | None:
    """The value as ``encode`` takes it; None after reporting what is wrong."""
    if field.count is None and not field.is_list:
        return _element(field, wanted, node, place, problems)
    most = field.count or field.max_count
    amount = f"at most {most}" if field.is_list else str(most)
    if not isinstance(wanted, list) or not isinstance(node, Sequence):
        problems.add(place, f"`{field.name}` has {amount} elements; write a list, such as [0, 0]")
        return None
    if len(wanted) > most or (len(wanted) < most and not field.is_list):
        problems.add(place, f"{len(wanted)} elements do not fit `{field.name}`; it has {amount}")
        return None
    elements = [_element(field, item, one, one.place, problems) for item, one in zip(wanted, node.items, strict=True)]
    good = tuple(element for element in elements if element is not None)
    return good if len(good) == len(elements) else None


def _element(field: Field, wanted: object, node: Node | None, place: Place, problems: Problems) -> ExampleValue | None:
    if field.fields:
        return _values(wanted, field.name, field.fields, node, place, problems)
    value, fault = _fitted(field, wanted)
    if value is None:
        problems.add(place, fault)
    return value


def _fitted(field: Field, wanted: object) -> tuple[ExampleValue | None, str]:
    if field.kind == FieldKind.BYTES:
        return _byte_string(field, wanted)
    if isinstance(wanted, dict):
        return None, f"`{field.name}` is one value; write it without {{ and }}"
    assert isinstance(wanted, Fraction | bool | str | list), "the grammar gives no others"
    return fit_element(field, wanted)


def _byte_string(field: Field, wanted: object) -> tuple[ExampleValue | None, str]:
    if not isinstance(wanted, str) or not re.fullmatch(r"( *[0-9a-fA-F]{2})* *", wanted):
        return None, f'`{field.name}` is a byte string; write two hex digits a byte in quotes: "01 FF"'
    value = bytes.fromhex(wanted)
    if len(value) > field.max_wire_bytes:
        return (
            None,
            f"{len(value)} bytes are given, and `{field.name}` has room for {field.max_wire_bytes}; give no more",
        )
    return value, ""
