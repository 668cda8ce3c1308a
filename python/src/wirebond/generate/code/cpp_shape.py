"""Lists of fields as C++ structs: members, their types and their names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from wirebond.generate.code import names
from wirebond.generate.code.cpp_field import element_type, enum_lines, flags_lines, initial_value, member_comment
from wirebond.protocol.model import Field, Protocol
from wirebond.protocol.model.layout import BitMember, Step, layout_of


@dataclass(frozen=True)
class Member:
    """A part of a layout and what it is called. ``name`` is empty for padding and for fields that count, which are
    not members."""

    part: Step | BitMember
    name: str
    type_name: str  # of its enum, flags or struct, by its full name; empty where it has none
    shape: Shape | None  # of its struct

    @property
    def spec(self) -> Field:
        return self.part.field

    @property
    def is_own_type(self) -> bool:
        """Is its type declared with it, and not by the file's name for it?"""
        return bool(self.type_name) and not self.spec.type_name

    @property
    def local_type(self) -> str:
        return self.type_name.rpartition("::")[2]


@dataclass(frozen=True)
class Shape:
    """A struct."""

    path: str  # its full name
    members: tuple[Member, ...]

    def member(self, field: str) -> Member:
        return next(m for m in self.members if m.spec.name == field)


def shape_of(path: str, parts: Sequence[Step | BitMember], named: Mapping[str, Shape]) -> Shape:
    """Return the struct for these parts of a layout. ``named``: those of the file's types, by their names in the
    file."""
    fields = [part.field for part in parts]
    scope = names.Scope(frozenset({path.rpartition("::")[2], "Info", *(shape.path for shape in named.values())}))
    hidden = {f.name for f in fields if not f.has_value or f.is_count or f.only_counts}
    members = {f.name: "" if f.name in hidden else scope.claim(names.identifier(f.name), "_") for f in fields}
    found = []
    for part in parts:
        spec = part.field
        type_name, shape = "", None
        if spec.type_name:
            shape = named[spec.type_name]
            type_name = shape.path
        elif spec.enum or spec.flags or spec.fields:
            type_name = f"{path}::{scope.claim(names.type_name(spec.name), 'Value')}"
            shape = shape_of(type_name, part.parts, named) if part.parts else None
        found.append(Member(part, members[spec.name], type_name, shape))
    return Shape(path, tuple(found))


def named_shapes(protocol: Protocol, scope: names.Scope) -> dict[str, Shape]:
    """Return the structs of the file's types that messages use, each after those that it needs."""
    found: dict[str, Shape] = {}

    def visit(fields: tuple[Field, ...]) -> None:
        for field in fields:
            visit(field.fields)
            if field.type_name and field.type_name not in found:
                path = scope.claim(names.type_name(field.type_name), "Type")
                found[field.type_name] = shape_of(path, layout_of(field.fields), found)

    for message in protocol.messages:
        visit(message.fields)
    return found


def type_blocks(shape: Shape) -> list[list[str]]:
    """Return the types that a struct declares within itself, each as lines."""
    blocks = []
    for member in shape.members:
        spec = member.spec
        if not member.is_own_type or not member.name:
            continue
        if member.shape is not None:
            blocks.append(struct_lines(member.shape))
        elif spec.enum:
            blocks.append(enum_lines(spec, member.local_type))
        else:
            blocks.append(flags_lines(spec, member.local_type))
    return blocks


def struct_lines(shape: Shape) -> list[str]:
    """Return a whole struct, without a comment before it."""
    lines = [f"struct {shape.path.rpartition('::')[2]} {{"]
    for block in type_blocks(shape):
        lines += [*("  " + line for line in block), ""]
    return [*lines, *("  " + line for line in member_lines(shape)), "};"]


def member_lines(shape: Shape) -> list[str]:
    """Return the struct's members with their first values, a line each."""
    lines = []
    for member in shape.members:
        if member.name:
            comment = member_comment(member.spec, member.local_type)
            lines.append(f"{_declared(member)};{f'  ///< {comment}' if comment else ''}")
    return lines


def _declared(member: Member) -> str:
    spec, name = member.spec, member.name
    if spec.is_string:
        return declared_string(spec, name)
    element = member.local_type if member.shape is not None else element_type(spec, member.local_type)
    if spec.is_list:
        given = spec.default if isinstance(spec.default, tuple) else ()
        values = ", ".join(initial_value(spec, member.local_type, one) for one in given)
        return f"wirebond::List<{element}, {spec.max_count}> {name} = " + (
            f"{{{len(given)}, {{{values}}}}}" if given else "{}"
        )
    if member.shape is not None:
        return f"{f'std::array<{element}, {spec.count}>' if spec.count is not None else element} {name} = {{}}"
    if spec.count is None:
        return f"{element} {name} = {initial_value(spec, member.local_type, spec.default)}"
    defaults = spec.default if isinstance(spec.default, tuple) else (None,) * spec.count
    first = [initial_value(spec, member.local_type, one) for one in defaults]
    zero = all(value in ("0", "0.0F", "0.0", "false") for value in first)
    return f"std::array<{element}, {spec.count}> {name} = {'{}' if zero else '{' + ', '.join(first) + '}'}"


def declared_string(spec: Field, name: str) -> str:
    """Return a text or byte string with its first value."""
    element = "char" if spec.value_type is str else "std::uint8_t"
    default = spec.default.encode() if isinstance(spec.default, str) else spec.default
    given = default if isinstance(default, bytes) else b""
    letters = ", ".join(_letter(byte, element) for byte in given)
    if not spec.is_variable:
        return f"std::array<{element}, {spec.size}> {name} = {{{letters}}}"
    initial = f"{{{len(given)}, {{{letters}}}}}" if given else "{}"
    return f"wirebond::Bounded<{element}, {spec.max_size}> {name} = {initial}"


def _letter(byte: int, element: str) -> str:
    if element == "char" and 0x20 <= byte < 0x7F and chr(byte) not in "'\\":
        return f"'{chr(byte)}'"
    return f"'\\x{byte:02X}'" if element == "char" else f"0x{byte:02X}"


def known_enums(shape: Shape) -> list[tuple[str, list[str]]]:
    """Return each enum of the struct and of those within it, by its full name, with its enumerators."""
    found = []
    for member in shape.members:
        if member.shape is not None and member.is_own_type:
            found += known_enums(member.shape)
        elif member.spec.enum:
            found.append(
                (member.type_name, [f"{member.type_name}::{names.identifier(name)}" for name, _ in member.spec.enum])
            )
    return found
