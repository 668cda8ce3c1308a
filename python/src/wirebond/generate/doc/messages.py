"""The chapters on messages: a list of all, then each with its fields, names of numbers and worked examples."""

from __future__ import annotations

from collections.abc import Iterator

from wirebond.analysis.check.wording import seconds
from wirebond.analysis.explain.constants import constant_text
from wirebond.analysis.explain.layout import id_index
from wirebond.analysis.explain.layout import id_text as id_number
from wirebond.codec import Codec
from wirebond.generate.doc.examples import examples_of
from wirebond.generate.doc.table import table
from wirebond.protocol.decimals import decimal_text
from wirebond.protocol.meaning.field_values import number_text
from wirebond.protocol.meaning.messages import spoken
from wirebond.protocol.model import (
    End,
    Field,
    Message,
    OnRange,
    PartKind,
    PayloadRule,
    Protocol,
    Queue,
)
from wirebond.protocol.model.layout import Bits, Group, List, Step
from wirebond.protocol.spelling import match_text, match_texts, repeated_type


def id_text(protocol: Protocol, message: Message) -> str:
    parts = protocol.format.parts
    if id_index(parts) is None or not message.has_id:
        return ""
    digits = len(id_number(parts, message.id)) - 2
    return id_number(parts, message.id) if message.ids is None else match_text(message.ids, digits)


def sender_text(end: End) -> str:
    return "both ends" if end == End.BOTH else spoken(end)


def list_chapter(protocol: Protocol) -> list[str]:
    rows = []
    for message in protocol.messages:
        size = _span(message.min_payload, message.max_payload)
        every = seconds(message.every) if message.every is not None else ""
        link = f"[{message.name}](#message-{message.name})"
        reply = message.reply or ""
        seed = "" if message.seed is None else f"{message.seed:02X}"
        rows.append((id_text(protocol, message), link, sender_text(message.sender), size, every, reply, seed))
    heads = ("id", "message", "sender", ">payload bytes", ">every", "reply", ">seed of the check")
    return ["## Messages", "", *table(heads, rows), ""]


def message_chapters(codec: Codec) -> list[str]:
    lines: list[str] = []
    for message in codec.model.messages:
        lines += _message(codec, message)
    return lines


def _message(codec: Codec, message: Message) -> list[str]:
    lines = [f"### Message {message.name}", ""]
    if message.description:
        lines += [_stopped(message.description), ""]
    number = id_text(codec.model, message)
    facts = [f"Id {number}"] if number else []
    facts += [f"with {' and '.join(match_texts(message))}"] if match_texts(message) else []
    facts.append(f"sent by {'both ends' if message.sender == End.BOTH else 'the ' + spoken(message.sender)}")
    if message.every is not None:
        facts.append(f"every {seconds(message.every)}")
    if message.queue == Queue.URGENT:
        facts.append("urgent: before all messages that are not")
    elif message.queue == Queue.LATEST:
        facts.append("of which only the newest waits for the line")
    if message.log is not None:
        facts.append(f"a log line ({message.log_level})")
    if message.reply is not None:
        facts.append(f"answered by {message.reply}")
    text = ", ".join(facts)
    lines += [text[:1].upper() + text[1:] + ".", ""]
    if message.log is not None:
        lines += [f"The host shows it as: {_literal(message.log)}", ""]
    lines += _fields(codec.model, message)
    if any(field.digits is not None for field in _all(message.fields)):
        lines += [_DIGITS, ""]
    named: list[list[str]] = []
    for field in _all(message.fields):
        names = names_of(field)
        if names not in named:  # a type of the file may occur several times
            named.append(names)
            lines += names
    return lines + examples_of(codec, message)


_DIGITS = (
    "A negative number in digits begins with `-`; a number of fixed size has leading zeros. Receivers also accept "
    "leading blanks, zeros or `+`, hex digits of either case, and fewer decimals, or more, which they round."
)


def _fields(protocol: Protocol, message: Message) -> list[str]:
    rule = next(part for part in protocol.format.parts if part.kind == PartKind.PAYLOAD)
    padding = rule.fixed_payload - message.max_payload if rule.payload == PayloadRule.FIXED else 0
    if not message.fields:
        what = f"It has no fields: its {padding} payload bytes are zeros." if padding else "It has no fields."
        return [what, ""]
    rows = _rows(message.layout, 0, 0)
    if padding:
        rows.append((str(message.max_payload), str(padding), "", "", "zeros", "", "", "up to the fixed size"))
    heads = (">offset", ">bytes", "field", "type", "value", "unit", "range", "meaning")
    return [*table(heads, rows), ""]


def _rows(steps: tuple[Step, ...], base: int | None, level: int) -> list[tuple[str, ...]]:
    """Return a row for each step and for those within it. Offsets are given as long as nothing before varies in size;
    within what repeats they count from its first element.

    :param base: the offset of the first step; None: it is not known.
    """
    rows: list[tuple[str, ...]] = []
    for step in steps:
        at = None if base is None else base + step.at
        rows.append(_row(step.field, at, level, step.field.description))
        if isinstance(step, Bits):
            for run in step.members:
                described = f"{run.text}; {run.field.description}" if run.field.description else run.text
                rows.append(_row(run.field, None, level + 1, described))
        elif isinstance(step, Group | List):
            rows += _rows(step.steps, at, level + 1)
        base = None if step.field.is_variable else base
    return rows


def _row(field: Field, at: int | None, level: int, description: str) -> tuple[str, ...]:
    least, most = field.min_wire_bytes, field.max_wire_bytes
    size = "" if least == most == 0 else str(least) if least == most else f"{least} to {most}"
    meaning = description or ("" if field.has_value else "sent as 0, ignored")
    if field.clock is not None:
        stamp = "when these values were measured, on the MCU's clock"
        meaning = f"{stamp}; {description}" if description else stamp
    value = value_of(field)
    if field.constant is not None:
        meaning = description or "a frame with another value is not a frame"
        value = f"always {constant_text(field, field.constant)}"
    name = "- " * level + field.name
    offset = "" if at is None else str(at)
    return offset, size, name, repeated_type(field), value, field.unit, _range(field), meaning


def value_of(field: Field) -> str:
    if not field.is_scaled:
        return "named" if field.enum or field.flags else ""
    text = f"wire * {number_text(field.scale)}"
    if field.offset:
        text += f" {'+' if field.offset > 0 else '-'} {number_text(abs(field.offset))}"
    return text


def _range(field: Field) -> str:
    if field.minimum is None or field.maximum is None:
        return ""
    what = "clamped" if field.on_range == OnRange.CLAMP else "refused"
    return f"{decimal_text(field.minimum, 10)} to {decimal_text(field.maximum, 10)}, else {what}"


def _all(fields: tuple[Field, ...]) -> Iterator[Field]:
    for field in fields:
        yield field
        yield from _all(field.fields)


def names_of(field: Field) -> list[str]:
    if field.enum:
        rows = [(str(value), name) for name, value in field.enum]
        return [f"Values of {field.name}:", "", *table((">value", "name"), rows), ""]
    if field.flags:
        bits = [(str(bit), f"0x{1 << bit:0{(field.width + 3) // 4}X}", name) for name, bit in field.flags]
        return [f"Bits of {field.name}:", "", *table((">bit", "mask", "name"), bits), ""]
    return []


def _span(least: int, most: int) -> str:
    return str(least) if least == most else f"{least} to {most}"


def _literal(text: str) -> str:
    return f"`` {text} ``" if "`" in text else f"`{text}`"


def _stopped(text: str) -> str:
    return text if text.endswith((".", "!", "?")) else text + "."
