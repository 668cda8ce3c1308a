"""Each kind of part in words: what it has in every frame, a receiver's rule for it, and what its bytes mean in one.

One file: a kind of part is described in one place, for the document and for `explain`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from wirebond.analysis.check.wording import plural
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
    PayloadRule,
    Protocol,
)
from wirebond.protocol.model.forms import header_of
from wirebond.protocol.spelling import ranges_text, sequence_text

_COUNTED = {  # in a document, and of one frame
    LengthCounts.PAYLOAD: ("the payload's bytes", "payload bytes"),
    LengthCounts.REST: ("all bytes of the frame that follow it", "bytes that follow it"),
    LengthCounts.SELF_AND_REST: ("its own bytes and all that follow", "bytes from itself on"),
    LengthCounts.FRAME: ("all bytes of the frame", "bytes of the whole frame"),
}
_PAYLOADS = {
    PayloadRule.BY_LENGTH: "as many bytes as the length says",
    PayloadRule.BY_ID: "as many bytes as the message has",
    PayloadRule.REST: "everything between the other parts; no length is sent",
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


@dataclass(frozen=True)
class PartWords:
    """A kind of part.

    :ivar content: what it has in every frame; of the part with this index.
    :ivar meaning: what its bytes mean, which are all there.
    :ivar rule: what a receiver demands of it, where that is not in its constants.
    """

    content: Callable[[Protocol, int], str]
    meaning: Callable[[Context], str]
    rule: Callable[[Protocol, int], str] | None = None


def words_of(part: Part) -> PartWords:
    if part.kind not in _WORDS:
        raise NotImplementedError(f"parts.py has no entry for the part '{part.kind}'")
    return _WORDS[part.kind]


def meaning(context: Context) -> str:
    """Return the meaning of a part whose bytes are all present."""
    return words_of(context.part).meaning(context)


def rules_of(protocol: Protocol, index: int) -> list[str]:
    """Return the receiver's rules for this part."""
    part = protocol.format.parts[index]
    rules = []
    if part.value:
        wanted = _constant_content(protocol, index).removeprefix("always ")
        rules.append(f"the {part.name} is {wanted}{_there(part)}")
    if any(run.role == BitRole.CONSTANT for run in part.bits):
        rules.append(f"the bits of {part.name} that are always the same are so")
    rule = words_of(part).rule
    if any(run.role == BitRole.LENGTH for run in part.bits):
        rules.append(_length_rule(protocol, f"length in {part.name}"))
    return rules if rule is None else [*rules, rule(protocol, index)]


def _there(part: Part) -> str:
    return "" if part.condition is None else ", where it is there"


def sent_by(message: Message) -> str:
    """Name the sender: ``from the host``, ``from either end``."""
    return "from either end" if message.sender == End.BOTH else f"from the {spoken(message.sender)}"


def check_text(parts: tuple[Part, ...], part: Part) -> str:
    """Name a check and its range: ``sum16 high byte over id..payload``."""
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
    counted = _COUNTED[part.counts][1] + (f" {part.length_offset:+d}" if part.length_offset else "")
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
    """Return a header field's value; of an address whose it is."""
    text = number_of(header.value, number)[1]
    if header.address is None:
        return text
    if number in header.broadcast_bits:
        return f"{text}: every receiver"
    whose = {Address.MCU: "the MCU's address", Address.RECEIVER: "the receiver's address"}
    return f"{text}: {whose.get(header.address, 'the address of the sender')}"


def header_values(parts: tuple[Part, ...], data: bytes, payload_size: int) -> tuple[dict[str, Any], list[str]]:
    """Return the header fields of a whole frame by name, as the Python API gives them, and the rules that they
    break."""
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
    """List the runs of bits, from the lowest up."""
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


# ---- a part's bytes in every frame


def _constant_content(protocol: Protocol, index: int) -> str:
    part = protocol.format.parts[index]
    if part.by_sender:
        return "always " + ", ".join(f"`{hex_of(value)}` from the {spoken(end)}" for end, value in part.by_sender)
    return "always " + " or ".join(f"`{hex_of(value)}`" for value in part.alternatives or (part.value,))


def _length_content(protocol: Protocol, index: int) -> str:
    part = protocol.format.parts[index]
    offset = f", {part.length_offset:+d}" if part.length_offset else ""
    unit = f", in units of {part.length_unit} bytes" if part.length_unit != 1 else ""
    return f"counts {_COUNTED[part.counts][0]}{offset}{unit}"


def _payload_content(protocol: Protocol, index: int) -> str:
    part = protocol.format.parts[index]
    if part.payload == PayloadRule.FIXED:
        return "the message's fields; shorter messages are padded with zeros"
    trimmed = "; zeros at its end are not sent, and put back by the receiver" if part.trims_zeros else ""
    optional = part.payload == PayloadRule.BY_LENGTH and all(
        p.condition is not None
        for p in protocol.format.parts
        if p.kind == PartKind.LENGTH or any(run.role == BitRole.LENGTH for run in p.bits)
    )
    none = ", and none where the length is not there" if optional else ""
    return f"the message's fields; {_PAYLOADS[part.payload]}{none}{trimmed}"


def _bits_content(protocol: Protocol, index: int) -> str:
    part = protocol.format.parts[index]
    length = any(run.role == BitRole.LENGTH for run in part.bits)
    return "shared by its bits, see below" + (f"; the length {_length_content(protocol, index)}" if length else "")


def _sequence_content(protocol: Protocol, index: int) -> str:
    header = protocol.format.parts[index].header
    assert header is not None, "a sequence number is a header field"
    return sequence_text(header)


def _check_content(protocol: Protocol, index: int) -> str:
    return check_text(protocol.format.parts, protocol.format.parts[index])


def _always(text: str) -> Callable[[Protocol, int], str]:
    return lambda protocol, index: text  # noqa: ARG005  (as the others have it)


# ---- a receiver's demands


def _length_rule(protocol: Protocol, number: str) -> str:
    return f"the {number} means a payload of at most {plural(protocol.format.max_payload, 'byte')}"


def _check_rule(protocol: Protocol, index: int) -> str:
    part = protocol.format.parts[index]
    return f"the {part.name} holds{_there(part)} ({check_text(protocol.format.parts, part)})"


# One entry for each kind of part in the model.
_WORDS: dict[PartKind, PartWords] = {
    PartKind.MAGIC: PartWords(_constant_content, _constant("begins every frame")),
    PartKind.CONSTANT: PartWords(_constant_content, _constant("always the same")),
    PartKind.TAIL: PartWords(_constant_content, _constant("ends every frame")),
    PartKind.LENGTH: PartWords(
        _length_content, _length, lambda protocol, index: _length_rule(protocol, protocol.format.parts[index].name)
    ),
    PartKind.ID: PartWords(_always("the message's id"), _id),
    PartKind.RESERVED: PartWords(_always("sent as 0, ignored by the receiver"), _reserved),
    PartKind.PAYLOAD: PartWords(_payload_content, _payload),
    PartKind.CHECK: PartWords(_check_content, _check, _check_rule),
    PartKind.FIELD: PartWords(_always("a header field, see below"), _field),
    PartKind.SEQUENCE: PartWords(_sequence_content, _sequence),
    PartKind.BITS: PartWords(_bits_content, _bits),
}
