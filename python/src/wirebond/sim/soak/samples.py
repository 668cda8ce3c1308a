"""Frames that a soak offers again and again, distinguished by a running number if their payload can hold it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from wirebond.codec import Codec
from wirebond.errors import MessageError
from wirebond.protocol.model import End, Field, Message
from wirebond.protocol.planning import plan_for
from wirebond.sim.virtual_mcu import VirtualMcu

SAMPLES = 64  # of each message: the running number starts again after this many
_STEP = 0.37  # seconds of the made-up values between two samples


def samples(codec: Codec, name: str, end: End) -> list[bytes]:
    """Make frames of a message with different plausible values, and the running number in free fields."""
    message = codec.model.message(name)
    made_up = VirtualMcu(codec, 0.0)._made_up
    tested = {test.name for row in plan_for(codec.model, end).messages for test in row.tests}
    frames = []
    for number in range(SAMPLES):
        values = made_up(message, number * _STEP)
        try:
            frames.append(codec.encode(name, _numbered(message, values, number, tested), sender=end))
        except MessageError:  # a rule that its fields have together
            frames.append(codec.encode(name, values, sender=end))
    return frames


def are_numbered(codec: Codec, name: str, end: End) -> bool:
    """Check whether all samples of the message differ."""
    return len(set(samples(codec, name, end))) == SAMPLES


def _numbered(message: Message, values: Mapping[str, Any], number: int, tested: set[str]) -> dict[str, Any]:
    """Return the number in the low bits of the first free field, what does not fit in the next one, and so on."""
    return _in_fields(message.fields, values, number, (SAMPLES - 1).bit_length(), tested, "")[0]


def _in_fields(
    fields: tuple[Field, ...], values: Mapping[str, Any], number: int, bits: int, tested: set[str], path: str
) -> tuple[dict[str, Any], int, int]:
    """Put the number into fields. Also returns the remaining bits of the number, and how many these are."""
    numbered = dict(values)
    for field in fields:
        if bits == 0:
            break
        value = numbered.get(field.name)
        if f"{path}{field.name}" in tested:
            continue
        if isinstance(value, dict):
            within = f"{path}{field.name}."
            numbered[field.name], number, bits = _in_fields(field.fields, value, number, bits, tested, within)
        elif isinstance(value, str | bytes) and (room := _room_of_string(field, value)):
            taken = min(room, bits)
            low = number & ((1 << taken) - 1)
            number, bits = number >> taken, bits - taken
            numbered[field.name] = _in_string(value, low)
        elif (room := _room(field)) and value is not None:
            taken = min(room, bits)
            low = number & ((1 << taken) - 1)
            number, bits = number >> taken, bits - taken
            numbered[field.name] = _value(field, low)
    return numbered, number, bits


def _room(field: Field) -> int:
    """Return how many bits of any number the field can carry."""
    is_free = field.minimum is None and field.maximum is None and not (field.enum or field.is_count or field.is_list)
    if not is_free or field.count is not None:
        return 0
    if field.flags or field.digits is not None:
        return 0
    if field.value_type is bool:
        return 1
    is_binary = field.is_integer and field.coding.is_binary
    return field.width - field.coding.is_signed if is_binary else 0


def _room_of_string(field: Field, value: str | bytes) -> int:
    """Return the same for its first character, which becomes one of 64 to 127; none if a string ends with one of
    these."""
    has_room = len(value) > 0 or (field.room > 0 and not field.counted_by)
    return 6 if has_room and (field.ends_with is None or field.ends_with < 0x40) else 0


def _in_string(value: str | bytes, number: int) -> str | bytes:
    if isinstance(value, str):
        return chr(0x40 + number) + value[1:]
    return bytes([0x40 + number]) + value[1:]


def _value(field: Field, number: int) -> object:
    if field.value_type is bool:
        return bool(number)
    return float(number * field.scale + field.offset) if field.is_scaled else number
