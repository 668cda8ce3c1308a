"""Time stamps in messages: fields with `clock: mcu`. Which field it is, and how many microseconds one count has."""

from __future__ import annotations

from fractions import Fraction

from wirebond.protocol.model import Field, Message
from wirebond.protocol.problems import either

UNITS = {"us": 1, "ms": 1000, "s": 1_000_000}  # microseconds
CLOCK_BITS = 32  # of the MCU's microseconds: its link counts no more
LEAST_BITS = 24  # a clock that wraps sooner is ambiguous after seconds


def stamp_of(message: Message) -> Field | None:
    """Return the field with the time at which the MCU measured the message's values; None: there is none."""
    return next((field for field in message.fields if field.clock is not None), None)


def count_us(stamp: Field) -> int:
    """Return the microseconds of one count of the number on the wire."""
    return int(stamp.scale * UNITS[stamp.unit])


def stamp_fault(field: Field) -> str:
    """Return why this field with `clock` cannot be a time stamp, as a sentence; empty if it can."""
    if not field.is_unsigned or field.count is not None or field.is_list or field.enum or field.flags:
        return "`clock` is for one unsigned number, which counts time; take u32"
    if field.unit not in UNITS:
        found = f"`{field.unit}`" if field.unit else "none"
        return f"a time of a clock has the unit {either(UNITS)}, and here it is {found}; add `unit: us`"
    count = field.scale * UNITS[field.unit]
    if field.offset != 0:
        return "a time of a clock has no `offset`; remove it"
    if count.denominator != 1 or count < 1:
        return "one count of a clock is a whole number of microseconds; change `scale`, or `unit`"
    return _wrap_fault(field, count)


def _wrap_fault(field: Field, count: Fraction) -> str:
    """Return why the wraps of a stamp and of the MCU's own clock do not agree: the same number would mean several
    times."""
    wrap_us, clock_us = (1 << field.width) * int(count), 1 << CLOCK_BITS
    if wrap_us < 1 << LEAST_BITS:
        return f"it wraps after {wrap_us / 1e6:.3g} s, too soon to know which turn is meant; take u32"
    if wrap_us % clock_us and clock_us % wrap_us:
        return (
            f"it wraps after {wrap_us / 1e6:.6g} s, and the MCU's clock after {clock_us / 1e6:.6g} s, so the same "
            "number means several times; take u32"
        )
    return ""
