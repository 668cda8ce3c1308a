"""The header fields of frames as one C++ struct: its declaration, and the lines between it and the wire's numbers."""

from __future__ import annotations

from dataclasses import dataclass, replace

from wirebond.generate.code import names
from wirebond.generate.code.cpp_field import (
    Slot,
    hex_literal,
    initial_value,
    is_plain,
    outside,
    read_value,
    write_value,
)
from wirebond.generate.code.cpp_rules import validate_lines
from wirebond.generate.code.cpp_shape import Member, Shape, known_enums, member_lines, shape_of, type_blocks
from wirebond.protocol.model import Address, End, Field, HeaderField, Protocol
from wirebond.protocol.model.forms import header_fields
from wirebond.protocol.model.layout import layout_of

STRUCT = "Header"


@dataclass(frozen=True)
class HeaderView:
    """The struct. Lines name its object ``header`` and the wire's numbers ``numbers``, by their places."""

    types: list[list[str]]  # declared in it
    members: list[str]
    enums: list[tuple[str, list[str]]]
    construct: list[str]  # `member = host default or MCU default` where the ends differ; empty: they do not
    write: list[str]
    read: list[str]
    validate: list[str]


def fields_of(protocol: Protocol) -> tuple[HeaderField, ...]:
    """Return all header fields, by their places."""
    return header_fields(protocol.format.parts)


def header_shape(protocol: Protocol) -> Shape | None:
    """Return the struct and its members; None where frames have no header field."""
    fields = fields_of(protocol)
    if not fields:
        return None
    return shape_of(STRUCT, layout_of(tuple(replace(f.value, default=f.host_default) for f in fields)), {})


def ends_differ(protocol: Protocol) -> bool:
    """Return whether the ends have different defaults for a header field."""
    return any(field.host_default != field.mcu_default for field in fields_of(protocol))


def header_view(protocol: Protocol) -> HeaderView | None:
    """Return the view of the header; None if frames have no header field."""
    shape = header_shape(protocol)
    if shape is None:
        return None
    members = shape.members
    differ = ends_differ(protocol)
    return HeaderView(
        types=type_blocks(shape),
        members=[_without_value(line) for line in member_lines(shape)] if differ else member_lines(shape),
        enums=known_enums(shape),
        construct=_construct_lines(protocol, members) if differ else [],
        write=[line for place, member in enumerate(members) for line in _write_lines(member, place)],
        read=[line for place, member in enumerate(members) for line in _read_lines(member, place)],
        validate=validate_lines(shape, "header"),
    )


def _without_value(line: str) -> str:
    """Remove the initial value, which the constructor sets: ``float a = 1.0F; ///< m`` becomes ``float a; ///< m``."""
    declared, _, rest = line.partition(" = ")
    return f"{declared};{rest.partition(';')[2]}"


def _construct_lines(protocol: Protocol, members: tuple[Member, ...]) -> list[str]:
    lines = []
    for field, member in zip(fields_of(protocol), members, strict=True):
        host, mcu = (initial_value(member.spec, member.local_type, v) for v in (field.host_default, field.mcu_default))
        lines.append(f"{member.name}({host if host == mcu else f'sender == wirebond::End::mcu ? {mcu} : {host}'})")
    return lines


def _in_number(spec: Field) -> Field:
    """Return the field as the lowest bits of a number of 64 bits."""
    return replace(spec, bits=spec.width, size=0)


def _write_lines(member: Member, place: int) -> list[str]:
    number, value = f"numbers[{place}]", f"header.{member.name}"
    if is_plain(member.spec) and member.spec.is_unsigned:
        beyond = outside(member.spec, value, received=False)
        return [*([f"if ({beyond}) return false;"] if beyond else []), f"{number} = {value};"]
    return [f"{number} = 0;", *write_value(_in_number(member.spec), value, Slot(number))]


def _read_lines(member: Member, place: int) -> list[str]:
    slot = Slot(f"numbers[{place}]")
    return read_value(_in_number(member.spec), f"header.{member.name}", slot, member.type_name)


# ---- addresses --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class AddressView:
    """The addresses in one sender's frames: constants of its source."""

    type_name: str
    most: str
    receiver: tuple[int, str] | None  # place; the value that the sender sends by default
    broadcasts: tuple[str, ...]
    sender: tuple[int, str] | None
    asked: tuple[str, ...] | None  # of the MCU's frames that say whose they are: addresses that ask all MCUs


def address_type(protocol: Protocol) -> str:
    """Return the integer that holds each address; empty where the header has none."""
    widths = [field.value.width for field in fields_of(protocol) if field.address is not None]
    return f"std::uint{next(bits for bits in (8, 16, 32, 64) if bits >= max(widths))}_t" if widths else ""


def address_view(protocol: Protocol, sender: End) -> AddressView | None:
    """Return the addresses in the frames of ``sender``, or None if the header has none."""
    type_name = address_type(protocol)
    if not type_name:
        return None
    receiver, owner = None, None
    broadcasts: tuple[str, ...] = ()
    asked: tuple[str, ...] = ()
    fields = fields_of(protocol)
    for place, field in enumerate(fields):
        entry = (place, _address(field.default_bits(sender), field))
        names_mcu = field.address == Address.MCU
        if names_mcu or field.address == Address.RECEIVER:
            asked = tuple(_address(bits, field) for bits in field.broadcast_bits)
        if field.address == Address.RECEIVER or (names_mcu and sender == End.HOST):
            receiver = entry
            broadcasts = asked
        elif field.address == Address.SENDER or names_mcu:
            owner = entry
    most = min((1 << field.value.width) - 1 for field in fields if field.address is not None)
    can_ask = sender == End.MCU and owner is not None
    most_literal = hex_literal(most, (most.bit_length() + 7) // 8)
    return AddressView(type_name, most_literal, receiver, broadcasts, owner, asked if can_ask else None)


def _address(bits: int, field: HeaderField) -> str:
    return hex_literal(bits, (field.value.width + 7) // 8)


def generated_types(protocol: Protocol) -> frozenset[str]:
    """Return the names of types that the generated header declares beside the messages or uses."""
    header = {STRUCT} if fields_of(protocol) else set()
    return names.GENERATED_TYPES | header | ({"Address"} if address_type(protocol) else set())
