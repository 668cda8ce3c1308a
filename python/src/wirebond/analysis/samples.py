"""Random valid messages of a protocol, and their frames: what the measuring rules feed to the decoder."""

from __future__ import annotations

import math
import random
import string
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from wirebond.codec import Codec
from wirebond.errors import MessageError
from wirebond.protocol.matching import fitted_values
from wirebond.protocol.meaning.field_values import wire_limits
from wirebond.protocol.model import End, Field, Message
from wirebond.protocol.planning import expecting, told_by_request
from wirebond.protocol.sample_values import values_by

_ATTEMPTS = 1000
_LETTERS = string.ascii_letters + string.digits + " "


@dataclass(frozen=True)
class Pool:
    """Intact frames that one sender may send; every message has as many of them."""

    codec: Codec
    sender: End
    frames: tuple[bytes, ...]


def pool(codec: Codec, sender: End, seed: int, frames_a_message: int = 256) -> Pool | None:
    """Make frames with random values, the same for the same seed; None if this end sends nothing."""
    generator = random.Random(seed)  # noqa: S311  (to measure, not to keep secrets)
    frames = tuple(
        _frame(codec, message, sender, generator)
        for message in codec.model.messages
        if message.sent_by(sender)
        for _ in range(frames_a_message)
    )
    return Pool(codec, sender, frames) if frames else None


def asked(codec: Codec) -> Codec:
    """Return the codec as a receiver that expects the longest reply of each end, if only a request identifies a
    reply."""
    model = codec.model
    for end in (End.HOST, End.MCU):
        while dependent := told_by_request(model.messages, end):
            longest = max((m for m in model.messages if m.name in dependent), key=lambda m: m.max_payload)
            model = expecting(model, longest.name)
    return codec if model is codec.model else Codec(model)


def _frame(codec: Codec, message: Message, sender: End, generator: random.Random) -> bytes:
    """Return a frame with values that it can carry: where delimiters enclose bytes that are not stuffed, not all
    can."""
    for _ in range(_ATTEMPTS):
        try:
            return codec.encode(message.name, random_values(message, generator), sender=sender)
        except MessageError as error:
            refused = error
    raise refused


def random_values(message: Message, generator: random.Random) -> dict[str, Any]:
    """Draw valid values for every field, over the whole range that each can carry."""
    return fitted_values(message, values_by(_Random(generator), message.fields), generator.randint)


@dataclass(frozen=True)
class _Random:
    generator: random.Random

    def size(self, _fields: Sequence[Field], most: int) -> int:
        return self.generator.randint(0, most)

    def string(self, field: Field, size: int | None) -> str | bytes:
        if field.value_type is str:
            size = self.generator.randint(0, field.room) if size is None else size
            return "".join(self.generator.choices(field.without_ends(_LETTERS), k=size))
        drawn_size = self.generator.randint(0, field.max_size) if field.is_variable else field.size
        drawn = self.generator.randbytes(drawn_size if size is None else size)
        return drawn if field.ends_with is None else drawn.replace(bytes([field.ends_with]), b"")

    def element(self, field: Field, _place: int) -> Any:
        if field.flags:
            return [name for name, _ in field.flags if self.generator.random() < 0.5]
        if field.value_type is bool:
            return self.generator.random() < 0.5
        if field.enum:
            return self.generator.choice(field.enum)[0]
        return _number(field, self.generator)


def _number(field: Field, generator: random.Random) -> float | int:
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
