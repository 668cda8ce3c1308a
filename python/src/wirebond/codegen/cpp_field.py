"""One field of a message as C++: its member, and the lines that write, read, judge and clamp it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from fractions import Fraction

from wirebond.codegen.cpp_number import Scaling, integer, nearest_float, real, real_type, wire_integer
from wirebond.protocol.model import ByteOrder, Field, FieldKind, OnRange

NUMBERS = (FieldKind.UNSIGNED, FieldKind.SIGNED, FieldKind.FLOAT)


@dataclass
class FieldCode:
    """Lines carry no indentation of their own but that of the blocks they open."""

    member: str  # declaration, without the trailing semicolon
    comment: str
    types: list[str] = field(default_factory=list)
    known: list[str] = field(default_factory=list)  # body of is_known for an enum
    enum_type: str = ""
    write: list[str] = field(default_factory=list)
    read: list[str] = field(default_factory=list)
    judge: list[str] = field(default_factory=list)
    clamp: list[str] = field(default_factory=list)
    size: str = ""  # a variable field's size in bytes, as an expression


def comment_text(text: str) -> str:
    """Text that is safe behind ``//``: one line, no control characters, no backslash at the end."""
    line = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return line + "." if line.endswith("\\") else line


def field_code(
    spec: Field, name: str, enum_type: str, owner: str, at: int, before: int, trims_zeros: bool
) -> FieldCode:
    """``at``: the field's place in the payload; ``before``: wire bytes of all other fields of the message."""
    if spec.kind in (FieldKind.TEXT, FieldKind.BYTES):
        return _string(spec, name, at, before, trims_zeros)
    code = FieldCode(member="", comment=_comment(spec, enum_type))
    element, initial = _type_and_initial(spec, enum_type)
    if spec.enum:
        code.enum_type = f"{owner}::{enum_type}"
        code.types = _enum(spec, enum_type)
        code.known = [f"case {code.enum_type}::{n}:" for n, _ in spec.enum]
    elif spec.flags:
        code.types = _flags(spec, enum_type)
    if spec.count is None:
        code.member = f"{element} {name} = {initial}"
        value, place = f"message.{name}", f"payload + {at}"
        wrap: Callable[[list[str]], list[str]] = list
    else:
        zero = initial in ("0", "0.0F", "0.0", "false")
        values = "{}" if zero else "{" + ", ".join([initial] * spec.count) + "}"
        code.member = f"std::array<{element}, {spec.count}> {name} = {values}"
        value, place = f"message.{name}[i]", f"payload + {at} + {spec.size} * i"

        def wrap(lines: list[str]) -> list[str]:
            if not lines:
                return []
            head = f"for (std::size_t i = 0; i < {spec.count}; ++i) {{"
            return [head, *("  " + line for line in lines), "}"]

    code.write = wrap(_write(spec, value, place, element))
    code.read = wrap(_read(spec, value, place, element, enum_type, owner))
    if spec.count is not None and _is_plain(spec):
        order = ", wirebond::ByteOrder::big" if spec.order == ByteOrder.BIG else ""
        arguments = f"<{element}, {spec.count}{order}>"
        code.read = [f"wirebond::load_array{arguments}(payload + {at}, message.{name});"]
        if spec.kind != FieldKind.FLOAT and not _outside(spec, value, received=False):
            code.write = [f"wirebond::store_array{arguments}(payload + {at}, message.{name});"]
    code.judge = wrap(_judge(spec, value))
    code.clamp = wrap(_clamp(spec, value))
    return code


def _is_plain(spec: Field) -> bool:
    """Is the member the wire's number itself?"""
    return spec.kind in NUMBERS and not spec.enum and not spec.is_scaled and spec.size in (1, 2, 4, 8)


# ---- types ------------------------------------------------------------------------------------------------------


def _is_real(spec: Field) -> bool:
    return spec.kind == FieldKind.FLOAT or (spec.kind in NUMBERS and spec.is_scaled)


def _type_and_initial(spec: Field, enum_type: str) -> tuple[str, str]:
    default = spec.default
    if spec.kind == FieldKind.BOOL:
        return "bool", "true" if default else "false"
    if spec.enum:
        values = dict(spec.enum)
        number = values.get(default, 0) if isinstance(default, str) else int(default or 0)
        by_value = {value: name for name, value in reversed(spec.enum)}
        enumerator = by_value.get(number, spec.enum[0][0])
        return enum_type, f"{enum_type}::{enumerator}"
    low = -math.inf if spec.minimum is None else spec.minimum
    high = math.inf if spec.maximum is None else spec.maximum
    if _is_real(spec):
        chosen = default if isinstance(default, int | float) else min(max(0.0, low), high)
        return real_type(spec), real(chosen, real_type(spec))
    type_name = wire_integer(spec).type_name
    if isinstance(default, int | float):
        return type_name, integer(int(default))
    nearest_zero = 0 if low <= 0 <= high else math.ceil(low) if low > 0 else math.floor(high)
    return type_name, integer(nearest_zero)


def _enum(spec: Field, enum_type: str) -> list[str]:
    lines = [f"enum class {enum_type} : {wire_integer(spec).type_name} {{"]
    lines += [f"  {name} = {integer(value)}," for name, value in spec.enum]
    return [*lines, "};"]


def _flags(spec: Field, type_name: str) -> list[str]:
    lines = [f"struct {type_name} {{  // bits of `{spec.name}`"]
    underlying = wire_integer(spec).type_name
    lines += [
        f"  static constexpr {underlying} {name} = {hex_literal(1 << bit, spec.size)};" for name, bit in spec.flags
    ]
    return [*lines, "};"]


def hex_literal(value: int, size: int) -> str:
    """A hexadecimal literal with all digits of ``size`` bytes."""
    return f"0x{value:0{2 * size}X}" + ("" if value < 2**31 else "U" if value < 2**32 else "ULL")


def _comment(spec: Field, bits: str = "") -> str:
    facts = [spec.unit] if spec.unit else []
    if spec.minimum is not None or spec.maximum is not None:
        low = "" if spec.minimum is None else f"{spec.minimum:g}"
        high = "" if spec.maximum is None else f"{spec.maximum:g}"
        limits = f"{low} to {high}" if low and high else f"at least {low}" if low else f"at most {high}"
        facts.append(f"{limits} ({spec.on_range.value})")
    if spec.is_variable:
        facts.append(f"at most {spec.max_size} bytes")
    if spec.flags:
        facts.append(f"bits of {bits}")
    return comment_text(": ".join(part for part in (", ".join(facts), spec.description) if part))


# ---- numbers ----------------------------------------------------------------------------------------------------


def _template_arguments(spec: Field, type_name: str) -> str:
    """Type, byte order and wire bytes, as far as they are not what the core takes by itself."""
    arguments = [type_name]
    if spec.order == ByteOrder.BIG or spec.size not in (1, 2, 4, 8):
        arguments.append(f"wirebond::ByteOrder::{spec.order.value}")
    if spec.size not in (1, 2, 4, 8):
        arguments.append(str(spec.size))
    return f"<{', '.join(arguments)}>"


def _bounds(spec: Field, received: bool) -> tuple[str, str]:
    """Literals of the lower and upper bound, each empty where the type itself is as narrow."""

    def literal(bound: float | None, upper: bool) -> str:
        if bound is None:
            return ""
        if _is_real(spec):
            type_name = real_type(spec)
            value: Fraction | float = bound
            if received and spec.kind != FieldKind.FLOAT:
                value = Scaling(spec, type_name).received_limit(bound, upper)
            if type_name == "float" and math.isinf(nearest_float(float(value))):
                return ""
            return real(value, type_name)
        wire = wire_integer(spec)
        whole = math.floor(bound) if upper else math.ceil(bound)
        binding = whole < wire.high if upper else whole > wire.low
        return integer(whole) if binding else ""

    return literal(spec.minimum, False), literal(spec.maximum, True)


def _outside(spec: Field, value: str, received: bool) -> str:
    """A condition that holds where the value is outside its range; empty where there is none."""
    low, high = _bounds(spec, received)
    return " || ".join(part for part in (low and f"{value} < {low}", high and f"{value} > {high}") if part)


def _write(spec: Field, value: str, place: str, element: str) -> list[str]:
    if spec.kind == FieldKind.BOOL:
        return [f"{_byte(place)} = {value} ? 1 : 0;"]
    if spec.enum:
        wire = f"static_cast<{wire_integer(spec).type_name}>({value})"
        return [f"if (!is_known({value})) return false;", _store_integer(spec, place, wire)]
    outside = _outside(spec, value, received=False)
    lines = [f"if ({outside}) return false;"] if outside else []
    if spec.kind == FieldKind.FLOAT:
        wire = Scaling(spec, element).to_wire(value) if spec.is_scaled else value
        call = f"store_finite{_template_arguments(spec, element)}({place}, {wire})"
        return [*lines, f"if (!wirebond::{call}) return false;"]
    if spec.is_scaled:
        wire = Scaling(spec, element).to_wire(value)
        call = f"store_nearest{_template_arguments(spec, wire_integer(spec).type_name)}({place}, {wire})"
        return [*lines, f"if (!wirebond::{call}) return false;"]
    return [*lines, _store_integer(spec, place, value)]


def _byte(place: str) -> str:
    """``payload + 4`` as an element."""
    return f"payload[{place.removeprefix('payload + ')}]"


def _store_integer(spec: Field, place: str, value: str) -> str:
    """An integer that fills its type always fits."""
    wire = wire_integer(spec)
    arguments = _template_arguments(spec, wire.type_name)
    if wire.is_whole:
        return f"wirebond::store{arguments}({place}, {value});"
    return f"if (!wirebond::store_integer{arguments}({place}, {value})) return false;"


def _read(spec: Field, value: str, place: str, element: str, enum_type: str, owner: str) -> list[str]:
    if spec.kind == FieldKind.BOOL:
        return [f"{value} = {_byte(place)} != 0;"]
    if spec.kind == FieldKind.FLOAT:
        wire = f"wirebond::load{_template_arguments(spec, element)}({place})"
    else:
        integers = wire_integer(spec)
        load = "load" if integers.is_whole else "load_integer"
        wire = f"wirebond::{load}{_template_arguments(spec, integers.type_name)}({place})"
    if spec.enum:
        return [f"{value} = static_cast<{owner}::{enum_type}>({wire});"]
    return [f"{value} = {Scaling(spec, element).from_wire(wire) if spec.is_scaled else wire};"]


def _judge(spec: Field, value: str) -> list[str]:
    if spec.enum:
        return [f"if (!is_known({value})) found |= wirebond::Violation::unknown_enum;"]
    if spec.kind not in NUMBERS:
        return []
    lines = []
    if spec.kind == FieldKind.FLOAT:
        lines.append(f"if (!wirebond::is_finite({value})) found |= wirebond::Violation::not_finite;")
    outside = _outside(spec, value, received=True)
    if outside:
        kind = "clamped" if spec.on_range == OnRange.CLAMP else "out_of_range"
        lines.append(f"if ({outside}) found |= wirebond::Violation::{kind};")
    return lines


def _clamp(spec: Field, value: str) -> list[str]:
    if spec.on_range != OnRange.CLAMP or spec.enum or spec.kind not in NUMBERS:
        return []
    low, high = _bounds(spec, received=False)
    lines = [f"if ({value} < {low}) {value} = {low};"] if low else []
    return [*lines, f"if ({value} > {high}) {value} = {high};"] if high else lines


# ---- strings ----------------------------------------------------------------------------------------------------


def _string(spec: Field, name: str, at: int, before: int, trims_zeros: bool) -> FieldCode:
    element = "char" if spec.kind == FieldKind.TEXT else "std::uint8_t"
    default = spec.default.encode() if isinstance(spec.default, str) else b""
    letters = ", ".join(_letter(byte, element) for byte in default)
    place = f"payload + {at}"
    if not spec.is_variable:
        return FieldCode(
            member=f"std::array<{element}, {spec.size}> {name} = {{{letters}}}",
            comment=_comment(spec),
            write=[f"std::memcpy({place}, message.{name}.data(), {spec.size});"],
            read=[f"std::memcpy(message.{name}.data(), {place}, {spec.size});"],
        )
    initial = f"{{{len(default)}, {{{letters}}}}}" if default else "{}"
    room = f"std::size_t {name}_size = size - {before};" if before else f"std::size_t {name}_size = size;"
    read = [room, f"if ({name}_size > {spec.max_size}) {name}_size = {spec.max_size};"]
    if trims_zeros and spec.kind == FieldKind.TEXT:  # the zeros that pad a payload of fixed size are not text
        read.append(f"while ({name}_size != 0 && payload[{at} + {name}_size - 1] == 0) --{name}_size;")
    read += [
        f"message.{name}.size = static_cast<std::uint16_t>({name}_size);",
        f"std::memcpy(message.{name}.data.data(), {place}, {name}_size);",
    ]
    return FieldCode(
        member=f"wirebond::Bounded<{element}, {spec.max_size}> {name} = {initial}",
        comment=_comment(spec),
        write=[f"std::memcpy({place}, message.{name}.data.data(), message.{name}.size);"],
        read=read,
        size=f"message.{name}.size",
    )


def _letter(byte: int, element: str) -> str:
    if element == "char" and 0x20 <= byte < 0x7F and chr(byte) not in "'\\":
        return f"'{chr(byte)}'"
    return f"'\\x{byte:02X}'" if element == "char" else f"0x{byte:02X}"
