"""A number in a payload: its value, how that came out, and the field rule that it breaks."""

from __future__ import annotations

import math
from typing import Any

from wirebond.protocol.decimals import decimal_text
from wirebond.protocol.meaning.field_values import number_text
from wirebond.protocol.model import F32, F64, BitOrder, ByteOrder, Field

ReadNumber = tuple[Any, str, str]  # value, text, fault


def raw_number(field: Field, data: bytes) -> int:
    """Return the bits of a number in these bytes."""
    return int.from_bytes(data, "big" if field.order == ByteOrder.BIG else "little")


def packed_number(data: bytes, bit: int, width: int, order: BitOrder) -> int:
    """Read ``width`` bits from bit ``bit`` on of a string of bits that begins at this end of each byte."""
    if order == BitOrder.LOW:
        return int.from_bytes(data, "little") >> bit & (1 << width) - 1
    return int.from_bytes(data, "big") >> 8 * len(data) - bit - width & (1 << width) - 1


def number_of(field: Field, raw: int) -> ReadNumber:
    """Read one number from its bits: its value, the value as text, and the rule that it breaks."""
    if field.value_type is bool:
        return raw != 0, "true" if raw else "false", "" if raw <= 1 else f" is {raw}; a bool is 0 or 1"
    if field.is_float:
        return _float(field, raw)
    wire = field.coding.number_of(raw, field.width)
    if wire is not None:
        return whole_number(field, wire)
    digits = f"0x{raw:0{(field.width + 3) // 4}X}"
    value, *_ = whole_number(field, field.coding.limits(field.width)[1] + 1)
    return value, digits, f" is {digits}, {field.coding.gaps}"


def whole_number(field: Field, wire: int) -> ReadNumber:
    """Do the same for a number on the wire with a known sign."""
    if field.flags:
        return _flags(field, wire)
    if field.enum:
        name = next((name for name, value in field.enum if value == wire), None)
        if name is not None:
            return name, f"{name} ({wire})", ""
        unnamed = f" is {wire}, which has no name"
        return (scaled(field, wire) if field.is_scaled else wire), str(wire), unnamed
    of_clock = " on the MCU's clock" if field.clock is not None else ""
    if not field.is_scaled:
        return wire, with_unit(str(wire), field) + of_clock, range_fault(field, wire)
    value = scaled(field, wire)
    shown = f"{with_unit(_decimal(value), field)}{of_clock} ({_working(field, str(wire))})"
    return value, shown, range_fault(field, value)


def _flags(field: Field, wire: int) -> ReadNumber:
    names: list[Any] = [name for name, bit in field.flags if wire >> bit & 1]
    unnamed = wire & ~sum(1 << bit for _, bit in field.flags)
    names += [1 << bit for bit in range(field.width) if unnamed >> bit & 1]
    shown = ", ".join(name if isinstance(name, str) else f"bit {name.bit_length() - 1}" for name in names)
    fault = f" has bits without a name: 0x{unnamed:X}" if unnamed else ""
    return names, f"{shown or 'none'} (0x{wire:0{(field.width + 3) // 4}X})", fault


def _float(field: Field, raw: int) -> ReadNumber:
    of = field.float_format
    wire = of.number_of(raw)
    if not math.isfinite(wire):
        return scaled(field, wire) if field.is_scaled else wire, str(wire), " is not a finite number"
    shown = _decimal(of.shortest(wire))
    if not field.is_scaled:
        return wire, with_unit(shown, field), range_fault(field, wire)
    value = scaled(field, wire)
    fault = range_fault(field, value)
    computed = F32 if of.cpp == "float" else F64
    if not math.isfinite(value) or computed.rounded(value) is None:
        fault = f" is {value:g}, beyond a {8 * computed.size}-bit float"
    return value, f"{with_unit(_decimal(value), field)} ({_working(field, shown)})", fault


def scaled(field: Field, wire: float) -> float:
    """Scale in doubles and in this order, to equal the engine's value to the last bit: `to_si` in engine/element.hpp.
    tests/test_scaled_values.py compares the two."""
    numerator, addend, denominator, offset = field.double_factors
    if field.is_float:  # adding a zero would take the sign of another
        scaled = float(wire) * numerator / denominator
        return scaled + float(offset) if offset else scaled
    return (float(wire) * numerator + addend) / denominator + float(offset)


def range_fault(field: Field, value: float) -> str:
    limits = field.accepted_limits
    if limits is None or limits[0] <= value <= limits[1]:
        return ""
    return f" is outside {with_unit(f'{_decimal(field.minimum or 0.0)} to {_decimal(field.maximum or 0.0)}', field)}"


def _working(field: Field, wire: str) -> str:
    offset = f" + {number_text(field.offset)}" if field.offset > 0 else f" - {number_text(-field.offset)}"
    return f"{wire} * {number_text(field.scale)}" + (offset if field.offset else "")


def with_unit(text: str, field: Field) -> str:
    return f"{text} {field.unit}" if field.unit else text


def _decimal(value: float) -> str:
    return decimal_text(value, 10)
