"""Worked examples: values for a message, the frame that the engine makes of them, and every byte of it explained.

The file's own examples come first; a message without one gets values whose bytes differ, so that their order shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from wirebond.analysis.explain import Kind, Stretch, explain
from wirebond.analysis.explain.layout import hex_of
from wirebond.codec import Codec
from wirebond.generate.doc.table import table
from wirebond.protocol.decimals import decimal_text
from wirebond.protocol.matching import fitted_values
from wirebond.protocol.meaning.field_values import value_limits, wire_limits
from wirebond.protocol.model import End, Field, Message, Stuffing
from wirebond.protocol.planning import expecting
from wirebond.protocol.sample_values import values_by

_TRIES = 16  # values that are tried, where some hold a delimiter


def examples_of(codec: Codec, message: Message) -> list[str]:
    lines: list[str] = []
    own = [example for example in codec.model.examples if example.message == message.name]
    for example in own:
        header = dict(example.header)
        lines += _example(codec, message, example.fields, header, example.sender)
        frame = codec.encode(message.name, example.fields, header=header, sender=example.sender)
        if frame != example.frame:  # the lint says why
            lines += [f"The protocol file gives other bytes for it, which are wrong: `{hex_of(example.frame)}`.", ""]
    return lines if own else _example(codec, message, _carried_values(codec, message))


def example_values(message: Message, first: int = 0) -> dict[str, Any]:
    """Make values for every field, inside their ranges; the same for the same message and ``first``, which shifts
    them."""
    return fitted_values(message, values_by(_Telling(), message.fields, first))


def _carried_values(codec: Codec, message: Message) -> dict[str, Any]:
    """Return the first values whose frame has no delimiter within, if there are any."""
    sender = _first_sender(message)
    for first in range(_TRIES):
        values = example_values(message, first)
        frame = codec.encode(message.name, values, sender=sender)
        if _is_found(explain(expecting(codec.model, message.name), frame, sender).stretches, message):
            return values
    return example_values(message)


def _first_sender(message: Message) -> End:
    return End.HOST if message.sender == End.BOTH else message.sender


def _is_found(stretches: tuple[Stretch, ...], message: Message) -> bool:
    """Check whether it is one frame for a receiver. An unstuffed byte that is a delimiter cuts it."""
    return [(stretch.kind, stretch.message) for stretch in stretches] == [(Kind.FRAME, message.name)]


def values_line(values: dict[str, Any]) -> str:
    """Write the values: ``linear = 0.5, angular = 0``."""
    return ", ".join(f"{name} = {_shown(value)}" for name, value in values.items())


def _example(
    codec: Codec,
    message: Message,
    values: dict[str, Any],
    header: dict[str, Any] | None = None,
    sender: End | None = None,
) -> list[str]:
    sender = sender or _first_sender(message)
    frame = codec.encode(message.name, values, header=header, sender=sender)
    shown = values_line(values)
    if header:
        shown += f"{', ' if shown else ''}header {values_line(header)}"
    title = f"Example, {shown}:" if shown else "Example:"
    stretches = explain(expecting(codec.model, message.name), frame, sender).stretches
    stretch = stretches[0]
    if not _is_found(stretches, message):
        cut = "A receiver does not find this frame: one of its bytes is a delimiter, which cuts it."
        return [title, "", "```text", hex_of(frame), "```", "", cut, ""]
    stuffed = codec.model.format.stuffing != Stuffing.NONE
    heads = (">at", "bytes" if not stuffed else "on the wire", "unstuffed", "part", "meaning")
    rows = [
        (
            str(row.offset),
            f"`{hex_of(row.wire)}`" if row.wire else "",
            f"`{hex_of(row.data)}`" if stuffed and row.data else "",
            "- " * row.level + row.name,
            row.meaning,
        )
        for row in stretch.rows
    ]
    return [title, "", "```text", hex_of(frame), "```", "", *table(heads, rows), ""]


def _shown(value: Any) -> str:
    if isinstance(value, bytes):
        return hex_of(value)
    if isinstance(value, dict):
        return "{" + values_line(value) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_shown, value)) + "]"
    if isinstance(value, float):
        return decimal_text(value, 10)
    return str(value).lower() if isinstance(value, bool) else str(value)


class _Telling:
    """Values whose bytes differ, so that their order shows."""

    def size(self, fields: Sequence[Field], most: int) -> int:
        return min(most, *(4 if field.is_string else 2 for field in fields))

    def string(self, field: Field, size: int | None) -> str | bytes:
        size = self.size((field,), field.room) if size is None else size
        if field.value_type is bytes:
            return bytes(octet for octet in range(1, 6) if octet != field.ends_with)[:size]
        return field.without_ends("wirebond" if field.ends_with or field.excludes else "wire")[:size]

    def element(self, field: Field, place: int) -> Any:
        if field.value_type is bool:
            return place % 2 == 0
        return _float(field, place) if field.is_float else _whole(field, place)


def _whole(field: Field, index: int) -> Any:
    if field.enum:
        return field.enum[index % len(field.enum)][0]
    if field.flags:
        return [name for name, _ in field.flags[:2]]
    # 0x01 0x02 0x03 ... reads differently from either end, and fits signed types too.
    places = range(min(field.width // 8, 3))
    wire = int.from_bytes(bytes((index + place) % 15 + 1 for place in places), "big") or index % 2
    wire = _within(field, wire)
    return float(wire * field.scale + field.offset) if field.is_scaled else wire


def _within(field: Field, wire: int) -> int:
    """Return the number on the wire, or the one in the middle of the range."""
    least, most = wire_limits(field)
    if field.minimum is not None and field.maximum is not None:
        ends = sorted((Fraction(bound) - field.offset) / field.scale for bound in (field.minimum, field.maximum))
        least, most = max(least, ends[0]), min(most, ends[1])
    return wire if least <= wire <= most else round((least + most) / 2)


def _float(field: Field, index: int) -> float:
    value = index + 1.5
    least, most = value_limits(field)
    if field.minimum is not None and field.maximum is not None:
        least, most = Fraction(field.minimum), Fraction(field.maximum)
    return value if least <= value <= most else float((least + most) / 2)
