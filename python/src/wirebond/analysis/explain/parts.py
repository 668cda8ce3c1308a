"""What the bytes of each kind of part mean, in a few words."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from wirebond.analysis.explain.layout import (
    check_value,
    counted_beside_payload,
    covered_bytes,
    found_check,
    hex_of,
    id_text,
    payload_index,
    read_number,
    same_check,
    shown_check,
    spans,
)
from wirebond.analysis.explain.numbers import number_of
from wirebond.analysis.explain.verdict import Verdict
from wirebond.protocol.matching import one_id
from wirebond.protocol.meaning.messages import spoken
from wirebond.protocol.model import (
    Address,
    BitRole,
    End,
    HeaderField,
    LengthCounts,
    Message,
    Part,
    PartKind,
    Protocol,
)
from wirebond.protocol.model.forms import header_of
from wirebond.protocol.spelling import ranges_text, sequence_text

_COUNTED = {
    LengthCounts.PAYLOAD: "payload bytes",
    LengthCounts.REST: "bytes that follow it",
    LengthCounts.SELF_AND_REST: "bytes from itself on",
    LengthCounts.FRAME: "bytes of the whole frame",
}


@dataclass(frozen=True)
class Context:
    """A frame, or the beginning of one, and one of its parts. ``data`` is unstuffed."""

    protocol: Protocol
    sender: End | None
    verdict: Verdict
    data: bytes
    index: int

    @property
    def parts(self) -> tuple[Part, ...]:
        return self.verdict.parts

    @property
    def part(self) -> Part:
        return self.parts[self.index]

    @property
    def number(self) -> int:
        return read_number(self.part, self.bytes_of(self.index))

    def bytes_of(self, index: int) -> bytes:
        start, stop = self.places[index]
        return self.data[start:stop]

    @property
    def places(self) -> list[tuple[int, int]]:
        return spans(self.parts, self.verdict.payload_size or 0)


def meaning(context: Context) -> str:
    """Of a part whose bytes are all there."""
    kind = context.part.kind
    if kind not in _MEANINGS:
        raise NotImplementedError(f"parts.py has no entry for the part '{kind}'")
    return _MEANINGS[kind](context)


def sent_by(message: Message) -> str:
    """``from the host``, ``from either end``."""
    return "from either end" if message.sender == End.BOTH else f"from the {spoken(message.sender)}"


def check_text(parts: tuple[Part, ...], part: Part) -> str:
    """``sum16 high byte over id..payload``."""
    assert part.algorithm is not None
    name = part.algorithm.name
    if part.in_bits is None and part.check_bits < part.algorithm.width:
        name += " high byte" if part.shift else " low byte"
    elif part.in_bits is not None and part.in_bits.width < part.algorithm.width:
        name += f" bits {part.shift} to {part.shift + part.in_bits.width - 1}"
    text = f"{name} over {ranges_text(parts, part.ranges)}"
    text += " and the message's seed" if part.seeded else ""
    return f"{text}, in hex digits" if part.as_hex else f"{text}, in decimal digits" if part.as_decimal else text


def _constant(what: str) -> Callable[[Context], str]:
    def text(context: Context) -> str:
        part = context.part
        return what if context.bytes_of(context.index) == part.value else f"{what}; it must be {hex_of(part.value)}"

    return text


def _length(context: Context) -> str:
    return length_text(context, context.number)


def length_text(context: Context, number: int) -> str:
    part = context.part
    beside = counted_beside_payload(context.parts, context.index)
    counted = _COUNTED[part.counts] + (f" {part.length_offset:+d}" if part.length_offset else "")
    if part.length_unit != 1:
        return f"{number} times {part.length_unit} {counted}"
    return f"{number} {counted}" + (f": {number - beside} in the payload" if beside else "")


def _id(context: Context) -> str:
    return id_meaning(context, context.number)


def id_meaning(context: Context, number: int) -> str:
    messages = [m for m in context.protocol.messages if (m.ids or one_id(m.id)).holds(number)]
    own = next((m for m in messages if m.sent_by(context.sender)), None)
    if sum(m.sent_by(context.sender) for m in messages) > 1 and any(m.match for m in messages):
        return f"of {', '.join(m.name for m in messages if m.sent_by(context.sender))}"
    if own is not None:
        return f"{own.name}, {sent_by(own)}"
    if messages:
        return f"{messages[0].name} comes {sent_by(messages[0])}, not from this sender"
    return f"no message has the id {id_text(context.parts, number)}"


def _field(context: Context) -> str:
    header = context.part.header
    assert header is not None
    return header_text(header, context.number)


def header_text(header: HeaderField, number: int) -> str:
    """A header field's value; of an address whose it is."""
    text = number_of(header.value, number)[1]
    if header.address is None:
        return text
    if number in header.broadcast_bits:
        return f"{text}: every receiver"
    whose = {Address.MCU: "the MCU's address", Address.RECEIVER: "the receiver's address"}
    return f"{text}: {whose.get(header.address, 'the address of the sender')}"


def header_values(parts: tuple[Part, ...], data: bytes, payload_size: int) -> tuple[dict[str, Any], list[str]]:
    """The header fields of a whole frame by name, as the Python API gives them, and the rules that they break."""
    found: dict[str, Any] = {}
    faults = []

    def note(header: HeaderField, bits: int) -> None:
        found[header.name], _, fault = number_of(header.value, bits)
        faults.extend([f"header.{header.name}{fault}"] if fault else [])

    for part, (start, stop) in zip(parts, spans(parts, payload_size), strict=True):
        number = read_number(part, data[start:stop]) if header_of(part) else 0
        if part.kind == PartKind.MAGIC:  # as a file writes it: the first byte is the highest
            number = int.from_bytes(data[start:stop], "big")
        if part.header is not None:
            note(part.header, number)
        for run in part.bits:
            if run.header is not None:
                note(run.header, number >> run.shift & run.mask)
    return found, faults


def _sequence(context: Context) -> str:
    assert context.part.header is not None, "a sequence number is a header field"
    return f"{context.number}: {sequence_text(context.part.header)}"


def _bits(context: Context) -> str:
    """Each run, from the lowest bit up."""
    number = context.number
    texts = []
    for run in context.part.bits:
        value = number >> run.shift & run.mask
        text = f"{run.name} {value}"
        if run.header is not None and run.role == BitRole.FIELD:
            text = f"{run.name} {header_text(run.header, value)}"
        if run.role == BitRole.ID:
            text += f" ({id_meaning(context, value)})"
        elif run.role == BitRole.LENGTH:
            text += f" ({length_text(context, value)})"
        elif run.role == BitRole.SEQUENCE and run.header is not None:
            text += f" ({sequence_text(run.header)})"
        elif run.role == BitRole.CONSTANT and value != run.value:
            text += f" (it must be {run.value})"
        texts.append(text)
    return ", ".join(texts)


def _reserved(context: Context) -> str:
    found = context.bytes_of(context.index)
    return "reserved: ignored" + (", though a sender puts 0 here" if any(found) else "")


def _payload(context: Context) -> str:
    size = len(context.bytes_of(context.index))
    message = context.verdict.message
    return f"{size} byte{'s' * (size != 1)}" + (f" of {message.name}" if message is not None and size else "")


def _check(context: Context) -> str:
    part, parts = context.part, context.parts
    assert part.algorithm is not None
    text = check_text(parts, part)
    at = payload_index(parts)
    known = context.verdict.payload is not None or max(part.last_covered, context.index) < at
    places = context.places
    if not known or places[part.last_covered][1] > len(context.data):
        return text
    covered = covered_bytes(parts, context.index, context.data, places)
    expected = check_value(part, covered, context.verdict.seed)
    holds = same_check(part, expected, found_check(parts, context.index, context.data, places))
    return f"{text}: holds" if holds else f"{text}: is {shown_check(part, expected)}"


# One entry for each kind of part in the model.
_MEANINGS: dict[PartKind, Callable[[Context], str]] = {
    PartKind.MAGIC: _constant("begins every frame"),
    PartKind.CONSTANT: _constant("always the same"),
    PartKind.TAIL: _constant("ends every frame"),
    PartKind.LENGTH: _length,
    PartKind.ID: _id,
    PartKind.RESERVED: _reserved,
    PartKind.PAYLOAD: _payload,
    PartKind.CHECK: _check,
    PartKind.FIELD: _field,
    PartKind.SEQUENCE: _sequence,
    PartKind.BITS: _bits,
}
