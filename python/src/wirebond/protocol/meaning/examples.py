"""The `examples` section: values and bytes that belong together. Whether they do is not tested here (see ``lint``)."""

from __future__ import annotations

from wirebond.protocol.meaning.draft import Draft
from wirebond.protocol.meaning.given_values import ValueReader
from wirebond.protocol.meaning.header import read_header_values
from wirebond.protocol.meaning.messages import Messages, spoken
from wirebond.protocol.model import End, Example, Message
from wirebond.protocol.problems import Problems, suggestion
from wirebond.protocol.text.grammar import ExampleSyntax
from wirebond.protocol.text.syntax import readable
from wirebond.protocol.text.yaml_tree import Mapping, Node, Sequence


def read_examples(
    node: Node | None, messages: Messages, draft: Draft | None, problems: Problems
) -> tuple[Example, ...]:
    """Read every correct example; faults of others are reported.

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
        places = dict.fromkeys(syntax.fields, item.get("fields") or item)
        reader = ValueReader("the example", problems)
        values = reader.message(message.name, message.fields, syntax.fields, places, item.value_place("fields"))
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
