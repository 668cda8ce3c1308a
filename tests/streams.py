"""Random streams that are hard on a decoder: frames, damaged frames, garbage, lures."""

from __future__ import annotations

import contextlib
import random
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from wirebond import Codec, MessageError, _engine
from wirebond.protocol.model import (
    End,
    Field,
    FieldKind,
    FrameFormat,
    HeaderField,
    Match,
    MatchOf,
    Message,
    Part,
    PartKind,
    PayloadRule,
    Protocol,
    Subject,
)
from wirebond.protocol.model.forms import header_fields, some_value
from wirebond.protocol.plan import Form
from wirebond.protocol.planning import is_id, plan_for


def random_values(message: Message, source: random.Random) -> dict[str, Any]:
    """Valid values for every field, such as the message's frames have."""
    for _ in range(1000):
        values = _struct_values(message.fields, source)
        for match in message.match:
            if match.of == MatchOf.PAYLOAD:
                _set_number(message.fields, values, match, match.name, source)
        if all(match.of != MatchOf.SIZE or match.holds(_size(message.fields, values)) for match in message.match):
            return values
    raise AssertionError(f"no payload of {message.name} has a size that its frames have")


def _set_number(
    fields: tuple[Field, ...], values: dict[str, Any], match: Match, path: str, source: random.Random
) -> None:
    """Set a number, unless it is a constant already."""
    name, _, rest = path.partition(".")
    for described in fields:
        if described.name != name or name not in values:
            continue
        if rest:
            _set_number(described.fields, values[name], match, rest, source)
        else:
            low, high = source.choice(match.ranges)
            number = source.randint(low, high) | source.getrandbits(match.width) & ~match.mask
            values[described.name] = {value: name for name, value in described.enum}.get(number, number)


def _size(fields: tuple[Field, ...], values: dict[str, Any]) -> int:
    """Payload bytes, where nothing but strings and lists of numbers varies in size."""
    total = 0
    for described in fields:
        value = values.get(described.name)
        if described.digits is not None:
            length = len(described.digits.text(described.wire_number(values[described.name])))
            total += described.size or length + (described.ends_with is not None)
        elif described.is_string and described.size == 0:
            data = value.encode() if isinstance(value, str) else value
            total += len(data or b"") + (described.ends_with is not None)
        else:
            size = len(value or ()) * described.element_min_bytes if described.is_list else described.min_wire_bytes
            total += size
    return total


def _struct_values(fields: tuple[Field, ...], source: random.Random) -> dict[str, Any]:
    """Counts are drawn once for all that they count, and left out: they are counted."""
    counting = dict.fromkeys(f.counted_by for f in fields if f.counted_by)  # in the order of the fields
    least = {c: min(f.max_count or f.max_size for f in fields if f.counted_by == c) for c in counting}
    sizes = {name: source.randint(0, most) for name, most in least.items()}
    return {f.name: _field_value(f, source, sizes.get(f.counted_by)) for f in fields if f.has_value and not f.is_count}


def _field_value(described: Field, source: random.Random, size: int | None) -> Any:
    if described.value_type is str and size is not None:
        return "".join(source.choices("abc 019", k=size))
    if described.value_type is str:
        return "".join(source.choices("abc äöü 上位机", k=source.randrange(0, described.room // 3 + 1)))
    if described.value_type is bytes:
        drawn = source.randbytes(source.randrange(0, described.room + 1) if size is None else size)
        return drawn if described.ends_with is None else drawn.replace(bytes([described.ends_with]), b"")
    if described.is_list and size is None:
        size = source.randint(0, described.max_count)
    if described.is_list or described.count is not None:
        return [_element(described, source) for _ in range(described.count or size or 0)]
    return _element(described, source)


def _limits(described: Field) -> tuple[int, int]:
    """Least and greatest number on the wire, worked out here: a wrong limit of the product is not repeated."""
    if described.coding.name == "bcd":
        return 0, 10 ** (described.width // 4) - 1
    if described.is_unsigned:
        return 0, 2**described.width - 1
    half = 2 ** (described.width - 1)
    return -half + (described.coding.name == "sign_magnitude"), half - 1


def _element(described: Field, source: random.Random) -> Any:
    if described.fields:
        return _struct_values(described.fields, source)
    if described.value_type is bool:
        return source.random() < 0.5
    if described.enum:
        return source.choice(described.enum)[0]
    if described.flags:
        return [name for name, _ in described.flags if source.random() < 0.5]
    if described.is_float:
        low, high = described.minimum, described.maximum
        drawn = source.uniform(-1000 if low is None else low, 1000 if high is None else high)
        return source.choice((-0.0, 0.0)) if source.random() < 0.1 else drawn
    least, most = _limits(described)
    wire = source.choice([least, most, 0, source.randint(least, most)])
    value = float(wire * described.scale + described.offset) if described.is_scaled else wire
    if described.minimum is not None and described.maximum is not None:
        value = min(max(value, described.minimum), described.maximum)
    return value if described.is_scaled else int(value)


_MOST_REFUSED = 10_000  # in a row
_NONE_SENT = "the file is taken, and no frame of it can be sent"


class _RefusedError(Exception):
    """A check over words refuses a payload of this size, or its frame would be empty; another one is drawn."""


class Speaker:
    """Frames of one protocol whose checks hold: of any form and header, with any payload, of any id."""

    def __init__(self, codec: Codec) -> None:
        self._codec = codec
        unnamed = tuple(
            replace(message, id=0, has_id=False, match=()) for message in codec.model.messages
        )  # that format carries no id
        self._plain = Codec(replace(codec.model, format=_PAYLOAD_ALONE, messages=unnamed))
        self._raw = Codec(_with_raw_payloads(codec.model))
        self._forms: dict[End, tuple[Form, ...]] = {}

    def valid(self, source: random.Random) -> bytes:
        """Return a payload as a sender sends it."""
        for _ in range(_MOST_REFUSED):
            message = source.choice(self._codec.model.messages)
            with contextlib.suppress(_RefusedError):
                return self._sealed(self._codec, message, random_values(message, source), source)
        raise AssertionError(_NONE_SENT)

    def any(self, source: random.Random) -> bytes:
        """Return a valid payload or, as often, one that its sender would not send, or an unknown id."""
        if source.random() < 0.5:
            return self.valid(source)
        for _ in range(_MOST_REFUSED):
            with contextlib.suppress(_RefusedError):
                return self._damaged(source)
        raise AssertionError(_NONE_SENT)

    def _damaged(self, source: random.Random) -> bytes:
        message = source.choice(self._codec.model.messages)
        payload = damaged(self._plain.encode(message.name, random_values(message, source))[1:], source)
        frame_format = self._codec.model.format
        unit = max(part.length_unit for part in frame_format.parts)  # sizes between cannot be told
        payload = payload[: min(len(payload), frame_format.max_payload) // unit * unit]
        stranger = self._raw.model.messages[-1]
        return self._sealed(self._raw, stranger if source.random() < 0.2 else message, {"raw": payload}, source)

    def _sealed(self, codec: Codec, message: Message, values: dict[str, Any], source: random.Random) -> bytes:
        """In a form that is drawn; where that one cannot carry the message, in the first that can."""
        forms = self._forms_of(message.sender)
        drawn = source.randrange(len(forms)) if source.random() < 0.5 else 0
        table = codec.tables.format_for(message.sender)
        for index in (drawn, *(other for other in range(len(forms)) if other != drawn)):
            header = random_header(codec.model, forms[index], source, message)
            try:
                return _engine.encode(
                    codec.tables.protocol, table, codec.tables.indices[message.name], values, header, index
                )
            except MessageError:
                continue  # this form cannot carry it, or such bits are not a value of a field
        try:
            return _engine.encode(codec.tables.protocol, table, codec.tables.indices[message.name], values, {})
        except MessageError as error:
            if "which it refuses" in str(error) or "so is its frame" in str(error):
                raise _RefusedError from error
            raise

    def _forms_of(self, sender: End) -> tuple[Form, ...]:
        if sender not in self._forms:
            self._forms[sender] = plan_for(self._codec.model, sender).forms
        return self._forms[sender]


def random_header(model: Protocol, form: Form, source: random.Random, message: Message | None = None) -> dict[str, Any]:
    """Values for some header fields of this form, and for all that tell it from others; such as the message has."""
    fields = header_fields(model.format.parts)
    matches = {} if message is None else {match.name or "id": match for match in message.match}
    found = {}
    for entry in form.header:
        field = fields[entry.place].value
        if entry.name in matches and not entry.is_magic:
            low, high = source.choice(matches[entry.name].ranges)
            found |= {entry.name: source.randint(low, high)} if source.random() < 0.5 and not field.enum else {}
            continue
        if any(is_id(one, model.format.parts) for one in fields if one.name == entry.name):
            continue  # the message's own
        if entry.is_magic:
            found |= {entry.name: entry.default} if source.random() < 0.5 else {}
            continue
        choices = tuple(held.choice for held in form.choices if held.choice.number == (Subject.FIELD, entry.name))
        for _ in range(50 if choices else source.randrange(2)):
            value = _header_value(fields[entry.place], source)
            bits = header_bits(field, value)
            if field.is_unsigned and not all(choice.holds(bits) for choice in choices):
                fitting = some_value(choices, field.width, bits)
                assert fitting is not None, "every form can be"
                value = bits = fitting
            found[entry.name] = value
            if all(choice.holds(bits) for choice in choices):
                break
    return found


def _header_value(described: HeaderField, source: random.Random) -> Any:
    """Any value; often an address that an end listens to, or a number near others of the same peer."""
    if described.address is not None and source.random() < 0.7:
        return source.choice((described.host_default, described.mcu_default, *described.broadcast))
    if described.is_sequence and source.random() < 0.7:
        return source.choice((0, 1, 2, 3, 4, -1, -2)) % 2**described.value.width
    return _element(described.value, source)


def header_bits(field: Field, value: Any) -> int:
    """The bits of a value as the API takes it; flags are a list of names."""
    if isinstance(value, list):
        return sum(1 << dict(field.flags)[name] for name in value)
    return field.wire_bits(value)


_PAYLOAD_ALONE = FrameFormat(
    (
        Part(PartKind.MAGIC, "magic", 1, value=b"$"),  # a frame has one byte at least
        Part(PartKind.PAYLOAD, "payload", 0, payload=PayloadRule.REST),
    ),
    max_payload=0xFFFF,
    deliver_unknown=False,
    ends_by_silence=True,
)


def _with_raw_payloads(model: Protocol) -> Protocol:
    """Return the same frames with bytes for fields; after the messages comes one with an id that no other has, if
    frames have ids."""
    raw = (Field("raw", FieldKind.BYTES, 0, max_size=0xFFFF),)
    taken = {message.id for message in model.messages}
    forms = plan_for(model, End.HOST).forms + plan_for(model, End.MCU).forms
    has_id = any(form.id is not None for form in forms)
    number = next(i for i in range(256) if i not in taken) if has_id else 0
    stranger = Message("stranger", number, End.BOTH, raw, has_id=has_id)

    def with_any_payload(message: Message) -> Message:
        match = tuple(one for one in message.match if one.of in (MatchOf.ID, MatchOf.HEADER))
        return replace(message, fields=raw, match=match)

    any_size = replace(model.format, longest_sent=())
    return replace(model, format=any_size, messages=(*map(with_any_payload, model.messages), stranger))


def damaged(payload: bytes, source: random.Random) -> bytes:
    """One byte changed, some cut off or some put on; or nothing that a sender would send."""
    kind = source.randrange(4)
    if kind == 0 and payload:
        at = source.randrange(len(payload))
        return payload[:at] + bytes([source.choice([0, 1, 2, 3, 5, 255, source.randrange(256)])]) + payload[at + 1 :]
    if kind == 1:
        return payload[: source.randrange(len(payload) + 1)]
    if kind == 2:
        return payload + source.randbytes(source.randrange(5))
    return source.randbytes(len(payload))


def random_frame(codec: Codec, source: random.Random) -> bytes:
    while True:
        message = source.choice(codec.model.messages)
        try:
            return codec.encode(message.name, random_values(message, source))
        except MessageError as error:
            if "and so is its frame" not in str(error):
                raise  # an empty frame, which nobody could tell from none, is drawn again


def hard_stream(codec: Codec, source: random.Random, pieces: int) -> bytes:
    """Intact frames between everything that has misled decoders."""
    return b"".join(hard_pieces(lambda: random_frame(codec, source), source, pieces))


def hard_pieces(draw: Callable[[], bytes], source: random.Random, pieces: int) -> list[bytes]:
    """One frame each, of those that ``draw`` gives, intact or not, with what stands before it."""
    out = []
    start = draw()[:1]
    for _ in range(pieces):
        frame = draw()
        kind = source.randrange(8)
        if kind == 0:  # one byte damaged
            at = source.randrange(len(frame))
            frame = frame[:at] + bytes([frame[at] ^ (1 << source.randrange(8))]) + frame[at + 1 :]
        elif kind == 1:  # a byte lost
            at = source.randrange(len(frame))
            frame = frame[:at] + frame[at + 1 :]
        elif kind == 2:  # cut off, the next one follows at once
            frame = frame[: source.randrange(len(frame))]
        elif kind == 3:  # noise before it
            frame = source.randbytes(source.randrange(1, 40)) + frame
        elif kind == 4:  # start bytes before it
            frame = start * source.randrange(1, 12) + frame
        elif kind == 5:  # a header that promises much
            frame = start + bytes([source.randrange(30, 60)]) + source.randbytes(3) + frame
        out.append(frame)
    return out


def chunks(stream: bytes, source: random.Random) -> list[bytes]:
    """Cut at random: single bytes, small reads, large ones."""
    out = []
    at = 0
    while at < len(stream):
        size = source.choice([1, 2, 7, 64, 300, 5000])
        out.append(stream[at : at + size])
        at += size
    return out
