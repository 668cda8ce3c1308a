"""A value of a message as C++: its type, its first value, and the lines that write, read, validate and clamp it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum, auto
from fractions import Fraction

from wirebond.generate.code.cpp_number import Scaling, integer, nearest_float, real, real_type, wire_integer
from wirebond.generate.code.names import identifier
from wirebond.protocol.model import UNSIGNED, BitOrder, ByteOrder, Default, Digits, Field, FieldKind, OnRange

_WHOLE_SIZES = (1, 2, 4, 8)


@dataclass(frozen=True)
class Slot:
    """The place of a value on the wire."""

    place: str  # `payload + 4`; of a bit field, the variable that holds the bits
    index: str = "0"  # of a packed element
    shift: int = 0  # of a bit field


def comment_text(text: str) -> str:
    """Make a text safe in a comment of either kind: one line, no control characters, no backslash at the end.

    C joins a line that ends in ``??/`` with the next one, for that trigraph is a backslash; so no two question marks
    stay side by side. A space also separates ``*/`` and ``/*``.
    """
    line = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    for mark in ("??", "*/", "/*"):
        while mark in line:
            line = line.replace(mark, f"{mark[0]} {mark[1]}")
    return line + "." if line.endswith("\\") else line


def is_plain(spec: Field) -> bool:
    """Check whether the member is the wire's number itself, and fills its bytes."""
    whole = spec.size in _WHOLE_SIZES and not _coding(spec) and spec.digits is None
    return spec.is_number and not spec.enum and not spec.is_scaled and whole


# ---- types ------------------------------------------------------------------------------------------------------


def _is_real(spec: Field) -> bool:
    return spec.is_float or (spec.is_number and spec.is_scaled)


def element_type(spec: Field, enum_type: str) -> str:
    """Return the C++ type of one element."""
    if spec.value_type is bool:
        return "bool"
    if spec.enum:
        return enum_type
    return real_type(spec) if _is_real(spec) else wire_integer(spec).type_name


def initial_value(spec: Field, enum_type: str, default: Default | None) -> str:
    """Return the initialiser of one element; ``default`` is the element's own."""
    if spec.value_type is bool:
        return "true" if default else "false"
    number = default if isinstance(default, int | float) else None
    if spec.enum:
        wanted = dict(spec.enum).get(default, 0) if isinstance(default, str) else int(number or 0)
        by_value = {value: name for name, value in reversed(spec.enum)}
        return f"{enum_type}::{identifier(by_value.get(wanted, spec.enum[0][0]))}"
    low = -math.inf if spec.minimum is None else spec.minimum
    high = math.inf if spec.maximum is None else spec.maximum
    if _is_real(spec):
        return real(min(max(0.0, low), high) if number is None else number, real_type(spec))
    if number is not None:
        return integer(int(number))
    return integer(0 if low <= 0 <= high else math.ceil(low) if low > 0 else math.floor(high))


def enum_lines(spec: Field, enum_type: str) -> list[str]:
    lines = [f"enum class {enum_type} : {wire_integer(spec).type_name} {{"]
    lines += [f"  {identifier(name)} = {integer(value)}," for name, value in spec.enum]
    return [*lines, "};"]


def flags_lines(spec: Field, type_name: str) -> list[str]:
    lines = [f"struct {type_name} {{  // bits of `{spec.name}`"]
    underlying = wire_integer(spec).type_name
    lines += [
        f"  static constexpr {underlying} {identifier(name)} = {hex_literal(1 << bit, (spec.width + 7) // 8)};"
        for name, bit in spec.flags
    ]
    return [*lines, "};"]


def bool_literal(value: bool) -> str:
    return "true" if value else "false"


def hex_literal(value: int, size: int) -> str:
    """Return a hexadecimal literal with all digits of ``size`` bytes."""
    return f"0x{value:0{2 * size}X}" + ("" if value < 2**31 else "U" if value < 2**32 else "ULL")


def member_comment(spec: Field, bits: str = "") -> str:
    """Return the comment after a member; ``bits``: the struct of its flags."""
    facts = [spec.unit] if spec.unit else []
    if spec.clock is not None:
        facts.append("when its values were measured, on the MCU's clock")
    if spec.minimum is not None or spec.maximum is not None:
        low = "" if spec.minimum is None else f"{spec.minimum:.15g}"
        high = "" if spec.maximum is None else f"{spec.maximum:.15g}"
        limits = f"{low} to {high}" if low and high else f"at least {low}" if low else f"at most {high}"
        facts.append(f"{limits} ({spec.on_range.value})")
    if spec.is_string and spec.is_variable:
        facts.append(
            f"at most {spec.max_size} bytes"
            + "".join(f", none of them {end:#04x}" for end in (spec.ends_with,) if end is not None)
            + "".join(f", without {' '.join(f'{byte:#04x}' for byte in mark)}" for mark in spec.excludes)
        )
    if spec.is_list:
        facts.append(f"at most {spec.max_count}")
    if spec.flags:
        facts.append(f"bits of {bits}")
    return comment_text(": ".join(part for part in (", ".join(facts), spec.description) if part))


# ---- numbers ----------------------------------------------------------------------------------------------------


def _coding(spec: Field) -> str:
    """Return the coding of an integer's bits; empty for plain binary."""
    name = spec.coding.cpp
    return "" if name == UNSIGNED.cpp else f"wirebond::Coding::{name}"


def _template_arguments(spec: Field, type_name: str) -> str:
    """Return type, byte order and wire bytes, as far as they differ from the core's defaults."""
    arguments = [type_name]
    if spec.order == ByteOrder.BIG or spec.size not in _WHOLE_SIZES:
        arguments.append(f"wirebond::ByteOrder::{spec.order.value}")
    if spec.size not in _WHOLE_SIZES:
        arguments.append(str(spec.size))
    return f"<{', '.join(arguments)}>"


def _coded_arguments(spec: Field, type_name: str) -> str:
    return f"<{_coding(spec)}, {_template_arguments(spec, type_name)[1:]}"


class _Limit(Enum):
    """The value that a bound is compared with."""

    SENT = auto()  # a value to send
    RECEIVED = auto()  # a received value
    CLAMPED = auto()  # nothing: a value becomes the bound


def _bounds(spec: Field, limit: _Limit) -> tuple[str, str]:
    """Return literals of the lower and upper bound, each empty if the type itself is as narrow."""

    def literal(bound: float | None, upper: bool) -> str:
        if bound is None:
            return ""
        if _is_real(spec):
            type_name = real_type(spec)
            value: Fraction | float = bound
            if limit != _Limit.CLAMPED and spec.is_float and spec.accepted_limits is not None:
                value = spec.accepted_limits[upper]
            elif limit == _Limit.RECEIVED:
                value = Scaling(spec, type_name).received_limit(bound, upper)
            elif limit == _Limit.SENT:
                value = Scaling(spec, type_name).given_limit(bound, upper)
            if type_name == "float" and math.isinf(nearest_float(float(value))):
                return ""
            return real(value, type_name)
        wire = wire_integer(spec)
        whole = math.floor(bound) if upper else math.ceil(bound)
        binding = whole < wire.high if upper else whole > wire.low
        return integer(whole) if binding else ""

    return literal(spec.minimum, False), literal(spec.maximum, True)


def outside(spec: Field, value: str, received: bool) -> str:
    """Return a condition that holds where the value is outside its range; empty where there is none."""
    low, high = _bounds(spec, _Limit.RECEIVED if received else _Limit.SENT)
    return " || ".join(part for part in (low and f"{value} < {low}", high and f"{value} > {high}") if part)


def write_value(spec: Field, value: str, slot: Slot) -> list[str]:
    """Return lines that store ``value``, or return false if it breaks a rule."""
    if spec.value_type is bool:
        return [_store_bool(spec, value, slot)]
    if spec.is_float:
        element = real_type(spec)
        wire = Scaling(spec, element).to_wire(value) if spec.is_scaled else value
        call = f"store_finite{_template_arguments(spec, element)}({slot.place}, {wire})"
        return [*_refuse_outside(spec, value), f"if (!wirebond::{call}) return false;"]
    if spec.is_scaled and not spec.bits and not _coding(spec):
        wire = Scaling(spec, real_type(spec)).to_wire(value)
        call = f"store_nearest{_template_arguments(spec, wire_integer(spec).type_name)}({slot.place}, {wire})"
        return [*_refuse_outside(spec, value), f"if (!wirebond::{call}) return false;"]
    lines, wire = _wire_number(spec, value)
    lines.append(_store_integer(spec, wire, slot))
    return ["{", *("  " + line for line in lines), "}"] if spec.is_scaled else lines


def _refuse_outside(spec: Field, value: str) -> list[str]:
    beyond = outside(spec, value, received=False)
    return [f"if ({beyond}) return false;"] if beyond else []


def _byte(place: str) -> str:
    """Write the address of an element's bytes, as ``payload + 4``."""
    return f"payload[{place.removeprefix('payload + ')}]"


def _packing(spec: Field) -> str:
    order = "low_first" if spec.packed == BitOrder.LOW else "high_first"
    return f"wirebond::BitOrder::{order}"


def _bit_arguments(spec: Field, slot: Slot) -> str:
    """Return width, place and coding of a number that does not begin and end with a byte."""
    place = str(slot.shift) if spec.packed is None else _packing(spec)
    return ", ".join(part for part in (str(spec.bits), place, _coding(spec)) if part)


def _split_arguments(spec: Field) -> str:
    """Return the coding of a number in several pieces, and the lowest bit and the width of each."""
    places = ", ".join(f"{low}, {width}" for low, width in spec.split)
    return f"{_coding(spec) or 'wirebond::Coding::binary'}, {places}"


def _store_bool(spec: Field, value: str, slot: Slot) -> str:
    if spec.packed is not None:
        return f"wirebond::store_bits({slot.place}, {slot.index}, 1, {_packing(spec)}, {value} ? 1 : 0);"
    if spec.bits:
        return _store_integer(spec, f"static_cast<std::uint8_t>({value} ? 1 : 0)", slot)
    return f"{_byte(slot.place)} = {value} ? 1 : 0;"


def _store_integer(spec: Field, value: str, slot: Slot) -> str:
    """Return an integer that fills its type always fits."""
    wire = wire_integer(spec)
    if spec.packed is not None:
        call = f"store_packed<{_bit_arguments(spec, slot)}>({slot.place}, {slot.index}, {value})"
    elif spec.split:
        call = f"insert_split<{_split_arguments(spec)}>({slot.place}, {value})"
    elif spec.bits:
        call = f"insert_bits<{_bit_arguments(spec, slot)}>({slot.place}, {value})"
    elif _coding(spec):
        call = f"store_coded{_coded_arguments(spec, wire.type_name)}({slot.place}, {value})"
    elif wire.is_whole:
        return f"wirebond::store{_template_arguments(spec, wire.type_name)}({slot.place}, {value});"
    else:
        call = f"store_integer{_template_arguments(spec, wire.type_name)}({slot.place}, {value})"
    return f"if (!wirebond::{call}) return false;"


def load_integer(spec: Field, slot: Slot) -> str:
    """Return an expression of the wire's number, in the integer type that holds it."""
    wire = wire_integer(spec)
    if spec.packed is not None:
        return f"wirebond::load_packed<{wire.type_name}, {_bit_arguments(spec, slot)}>({slot.place}, {slot.index})"
    if spec.split:
        return f"wirebond::extract_split<{wire.type_name}, {_split_arguments(spec)}>({slot.place})"
    if spec.bits:
        return f"wirebond::extract_bits<{wire.type_name}, {_bit_arguments(spec, slot)}>({slot.place})"
    if _coding(spec):
        return f"wirebond::load_coded{_coded_arguments(spec, wire.type_name)}({slot.place})"
    load = "load" if wire.is_whole else "load_integer"
    return f"wirebond::{load}{_template_arguments(spec, wire.type_name)}({slot.place})"


def _digits_arguments(digits: Digits) -> str:
    return f"{digits.base}, {digits.decimals}"


def write_digits(spec: Field, digits: Digits, value: str, place: str, more: bool) -> list[str]:
    """Return lines that store a number in characters, or return false if it breaks a rule. After one of varying size
    ``payload`` is moved on, if ``more`` follows."""
    lines, wire = _wire_number(spec, value)
    arguments = _digits_arguments(digits)
    if spec.size:
        lines.append(f"if (!wirebond::write_digits<{arguments}>({place}, {spec.size}, {wire})) return false;")
        return ["{", *("  " + line for line in lines), "}"]
    lines += [
        f"const std::size_t digits = wirebond::digits_size<{arguments}>({wire});",
        f"if (digits > {spec.max_size} || !wirebond::write_digits<{arguments}>({place}, digits, {wire})) return false;",
    ]
    if spec.ends_with is not None:
        lines.append(f"*({place} + digits) = {spec.ends_with:#04x};")
    lines += ["payload += digits;"] if more else []
    return ["{", *("  " + line for line in lines), "}"]


def digits_size(spec: Field, digits: Digits, value: str) -> str:
    """Return an expression of the characters that a number of varying size takes."""
    type_name = wire_integer(spec).type_name
    if spec.enum:
        value = f"static_cast<{type_name}>({value})"
    elif spec.is_scaled:
        value = f"wirebond::nearest_or_zero<{type_name}>({Scaling(spec, real_type(spec)).to_wire(value)})"
    return f"wirebond::digits_size<{_digits_arguments(digits)}>({value})"


def read_digits(spec: Field, digits: Digits, value: str, place: str, size: str, enum_type: str) -> list[str]:
    """Return lines that load a number from ``size`` characters, or return false if they spell none."""
    type_name = wire_integer(spec).type_name
    call = f"wirebond::read_digits<{type_name}, {spec.width}, {_digits_arguments(digits)}>"
    if not spec.enum and not spec.is_scaled:
        return [f"if (!{call}({place}, {size}, {value})) return false;"]
    meant = f"static_cast<{enum_type}>(wire)" if spec.enum else Scaling(spec, real_type(spec)).from_wire("wire")
    return [
        "{",
        f"  {type_name} wire = 0;",
        f"  if (!{call}({place}, {size}, wire)) return false;",
        f"  {value} = {meant};",
        "}",
    ]


def _wire_number(spec: Field, value: str) -> tuple[list[str], str]:
    """Return lines that return false if an integer's value breaks a rule, and an expression of its wire number."""
    type_name = wire_integer(spec).type_name
    if spec.enum:
        return [f"if (!is_known({value})) return false;"], f"static_cast<{type_name}>({value})"
    lines = _refuse_outside(spec, value)
    if not spec.is_scaled:
        return lines, value
    wire = Scaling(spec, real_type(spec)).to_wire(value)
    lines += [f"{type_name} wire = 0;", f"if (!wirebond::nearest<sizeof wire>({wire}, wire)) return false;"]
    return lines, "wire"


def store_container(spec: Field, value: str, place: str) -> str:
    """Return the line that stores a number which always fits."""
    number = Field(spec.name, FieldKind.INTEGER, spec.size, spec.order)
    return _store_integer(number, value, Slot(place))


def read_value(spec: Field, value: str, slot: Slot, enum_type: str) -> list[str]:
    """Return the line that loads ``value``; ``enum_type`` by its full name."""
    if spec.value_type is bool:
        return [f"{value} = {load_integer(spec, slot) if spec.bits else _byte(slot.place)} != 0;"]
    if spec.is_float:
        wire = f"wirebond::load{_template_arguments(spec, real_type(spec))}({slot.place})"
    else:
        wire = load_integer(spec, slot)
    if spec.enum:
        return [f"{value} = static_cast<{enum_type}>({wire});"]
    return [f"{value} = {Scaling(spec, real_type(spec)).from_wire(wire) if spec.is_scaled else wire};"]


def validate_value(spec: Field, value: str) -> list[str]:
    """Return lines that add the violations of a received value to ``found``."""
    if spec.enum:
        return [f"if (!is_known({value})) found |= wirebond::Violation::unknown_enum;"]
    if not spec.is_number:
        return []
    lines = []
    if spec.is_float:
        lines.append(f"if (!wirebond::is_finite({value})) found |= wirebond::Violation::not_finite;")
    beyond = outside(spec, value, received=True)
    if beyond:
        kind = "clamped" if spec.on_range == OnRange.CLAMP else "out_of_range"
        lines.append(f"if ({beyond}) found |= wirebond::Violation::{kind};")
    return lines


def clamp_value(spec: Field, value: str) -> list[str]:
    """Return lines that move a received value to its nearest bound."""
    if spec.on_range != OnRange.CLAMP or spec.enum or not spec.is_number:
        return []
    low, high = _bounds(spec, _Limit.CLAMPED)
    lines = [f"if ({value} < {low}) {value} = {low};"] if low else []
    return [*lines, f"if ({value} > {high}) {value} = {high};"] if high else lines
