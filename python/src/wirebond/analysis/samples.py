"""Random valid messages of a protocol, and their frames: what the measuring rules feed to the decoder."""

from __future__ import annotations

import math
import random
import string
from dataclasses import dataclass
from typing import Any

from wirebond.codec import Codec
from wirebond.errors import MessageError
from wirebond.protocol.matching import fitted_values
from wirebond.protocol.meaning.field_values import wire_limits
from wirebond.protocol.model import End, Field, Message
from wirebond.protocol.planning import expecting, told_by_request

_ATTEMPTS = 1000
_LETTERS = string.ascii_letters + string.digits + " "


@dataclass(frozen=True)
class Pool:
    """Intact frames that one sender may send; every message has as many of them."""

    codec: Codec
    sender: End
    frames: tuple[bytes, ...]


def pool(codec: Codec, sender: End, seed: int, frames_a_message: int = 256) -> Pool | None:
    """Frames with random values, the same for the same seed; None if this end sends nothing."""
    generator = random.Random(seed)  # noqa: S311  (to measure, not to keep secrets)
    frames = tuple(
        _frame(codec, message, sender, generator)
        for message in codec.model.messages
        if message.sent_by(sender)
        for _ in range(frames_a_message)
    )
    return Pool(codec, sender, frames) if frames else None


def asked(codec: Codec) -> Codec:
    """Where only a request tells what a reply is, as its receiver is that expects the longest reply of each end."""
    model = codec.model
    for end in (End.HOST, End.MCU):
        while dependent := told_by_request(model.messages, end):
            longest = max((m for m in model.messages if m.name in dependent), key=lambda m: m.max_payload)
            model = expecting(model, longest.name)
    return codec if model is codec.model else Codec(model)


def _frame(codec: Codec, message: Message, sender: End, generator: random.Random) -> bytes:
    """A frame with values that it can carry: where delimiters stand around bytes that are not stuffed, not all can."""
    for _ in range(_ATTEMPTS):
        try:
            return codec.encode(message.name, random_values(message, generator), sender=sender)
        except MessageError as error:
            refused = error
    raise refused


def random_values(message: Message, generator: random.Random) -> dict[str, Any]:
    """Valid values for every field, over the whole range that each can carry."""
    return fitted_values(message, _struct(message.fields, generator), generator.randint)


def _struct(fields: tuple[Field, ...], generator: random.Random) -> dict[str, Any]:
    """A count is drawn once for all that it counts, and left out: it is counted."""
    counting = dict.fromkeys(field.counted_by for field in fields if field.counted_by)
    most = {name: min(f.max_count or f.max_size for f in fields if f.counted_by == name) for name in counting}
    counts = {name: generator.randint(0, limit) for name, limit in most.items()}
    return {
        field.name: _value(field, counts.get(field.counted_by), generator)
        for field in fields
        if field.has_value and not field.is_count
    }


def _value(field: Field, counted: int | None, generator: random.Random) -> Any:
    if field.value_type is str:
        size = generator.randint(0, field.room) if counted is None else counted
        return "".join(generator.choices(field.without_ends(_LETTERS), k=size))
    if field.value_type is bytes:
        size = generator.randint(0, field.max_size) if field.is_variable else field.size
        drawn = generator.randbytes(size if counted is None else counted)
        return drawn if field.ends_with is None else drawn.replace(bytes([field.ends_with]), b"")
    if field.is_list and counted is None:
        counted = generator.randint(0, field.max_count)
    if field.is_list or field.count is not None:
        return [_element(field, generator) for _ in range(field.count or counted or 0)]
    return _element(field, generator)


def _element(field: Field, generator: random.Random) -> Any:
    if field.fields:
        return _struct(field.fields, generator)
    if field.flags:
        return [name for name, _ in field.flags if generator.random() < 0.5]
    if field.value_type is bool:
        return generator.random() < 0.5
    if field.enum:
        return generator.choice(field.enum)[0]
    if field.is_float:
        if field.minimum is not None and field.maximum is not None:
            return generator.uniform(field.minimum, field.maximum)
        wire = generator.gauss(0, 1) * 10 ** generator.uniform(-3, 3)  # magnitudes that sensors have
        return wire * float(field.scale) + float(field.offset)
    lowest, highest = (int(bound) for bound in wire_limits(field))
    if field.minimum is not None and field.maximum is not None:
        ends = sorted((bound - float(field.offset)) / float(field.scale) for bound in (field.minimum, field.maximum))
        lowest, highest = max(lowest, math.ceil(ends[0])), min(highest, math.floor(ends[1]))
    wire_number = generator.randint(lowest, max(lowest, highest))
    if not field.is_scaled:
        return wire_number
    value = float(wire_number * field.scale + field.offset)
    if field.minimum is not None and field.maximum is not None:
        value = min(max(value, field.minimum), field.maximum)
    return value
