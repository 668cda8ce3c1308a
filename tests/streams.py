"""Random streams that are hard on a decoder: frames, damaged frames, garbage, lures."""

from __future__ import annotations

import random
from typing import Any

from wirebond import Codec
from wirebond.protocol.model import Field, FieldKind, Message


def random_values(message: Message, source: random.Random) -> dict[str, Any]:
    """Valid values for every field."""
    return _struct_values(message.fields, source)


def _struct_values(fields: tuple[Field, ...], source: random.Random) -> dict[str, Any]:
    """Counts are drawn once for all that they count, and left out: they are counted."""
    counting = {f.counted_by for f in fields if f.counted_by}
    least = {c: min(f.max_count or f.max_size for f in fields if f.counted_by == c) for c in counting}
    sizes = {name: source.randint(0, most) for name, most in least.items()}
    return {
        f.name: _field_value(f, source, sizes.get(f.counted_by))
        for f in fields
        if f.kind != FieldKind.PADDING and f.name not in counting
    }


def _field_value(described: Field, source: random.Random, size: int | None) -> Any:
    if described.kind == FieldKind.TEXT and size is not None:
        return "".join(source.choices("abc 019", k=size))
    if described.kind == FieldKind.TEXT:
        return "".join(source.choices("abc äöü 上位机", k=source.randrange(0, described.max_wire_bytes // 3 + 1)))
    if described.kind == FieldKind.BYTES:
        return source.randbytes(source.randrange(0, described.max_wire_bytes + 1) if size is None else size)
    if described.is_list and size is None:
        size = source.randint(0, described.max_count)
    if described.is_list or described.count is not None:
        return [_element(described, source) for _ in range(described.count or size or 0)]
    return _element(described, source)


def _element(described: Field, source: random.Random) -> Any:
    if described.fields:
        return _struct_values(described.fields, source)
    if described.kind == FieldKind.BOOL:
        return source.random() < 0.5
    if described.enum:
        return source.choice(described.enum)[0]
    if described.flags:
        return [name for name, _ in described.flags if source.random() < 0.5]
    if described.kind == FieldKind.FLOAT:
        low, high = described.minimum, described.maximum
        return source.uniform(-1000 if low is None else low, 1000 if high is None else high)
    half = 2 ** (described.width - 1)
    least, most = (-half, half - 1) if described.kind == FieldKind.SIGNED else (0, 2 * half - 1)
    least += described.sign_magnitude
    wire = source.choice([least, most, 0, source.randint(least, most)])
    value = float(wire * described.scale + described.offset) if described.is_scaled else wire
    if described.minimum is not None and described.maximum is not None:
        value = min(max(value, described.minimum), described.maximum)
    return value if described.is_scaled else int(value)


def random_frame(codec: Codec, source: random.Random) -> bytes:
    message = source.choice(codec.model.messages)
    return codec.encode(message.name, random_values(message, source))


def hard_stream(codec: Codec, source: random.Random, pieces: int) -> bytes:
    """Intact frames between everything that has misled decoders."""
    out = bytearray()
    frame = codec.encode(codec.model.messages[0].name, random_values(codec.model.messages[0], source))
    start = frame[:1]
    for _ in range(pieces):
        frame = random_frame(codec, source)
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
        out += frame
    return bytes(out)


def chunks(stream: bytes, source: random.Random) -> list[bytes]:
    """Cut at random: single bytes, small reads, large ones."""
    out = []
    at = 0
    while at < len(stream):
        size = source.choice([1, 2, 7, 64, 300, 5000])
        out.append(stream[at : at + size])
        at += size
    return out
