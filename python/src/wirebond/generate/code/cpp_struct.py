"""Lists of fields as C++: structs and their members, and the lines that move a whole message to and from its payload.

A place in the payload is ``payload`` and a number known here. Where fields of varying size lie before it, ``payload``
itself is moved on by what they take beyond their least; so these lines read like those of plain messages.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from wirebond.generate.code import names
from wirebond.generate.code.cpp_field import (
    Slot,
    clamp_value,
    digits_size,
    element_type,
    enum_lines,
    flags_lines,
    initial_value,
    is_plain,
    load_integer,
    member_comment,
    outside,
    read_digits,
    read_value,
    store_container,
    validate_value,
    write_digits,
    write_value,
)
from wirebond.generate.code.cpp_number import integer
from wirebond.protocol.model import ByteOrder, Digits, Field, FieldKind, Protocol
from wirebond.protocol.payload_rules import bit_places

_LOCALS = frozenset({"message", "payload", "size", "spare", "found", "wire", "bits", "bytes", *"ijklmnopq"})


@dataclass(frozen=True)
class Member:
    """A field and what it is called. ``name`` is empty for padding and for fields that count: they are no members."""

    spec: Field
    name: str
    type_name: str  # of its enum, flags or struct, by its full name; empty where it has none
    shape: Shape | None  # of its struct

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


def shape_of(path: str, fields: tuple[Field, ...], named: Mapping[str, Shape]) -> Shape:
    """The struct for these fields. ``named``: those of the file's types, by their names in the file."""
    scope = names.Scope(frozenset({path.rpartition("::")[2], "Info", *(shape.path for shape in named.values())}))
    hidden = {f.name for f in fields if f.kind == FieldKind.PADDING or f.is_count or f.only_counts}
    members = {f.name: "" if f.name in hidden else scope.claim(names.identifier(f.name), "_") for f in fields}
    found = []
    for spec in fields:
        type_name, shape = "", None
        if spec.type_name:
            shape = named[spec.type_name]
            type_name = shape.path
        elif spec.enum or spec.flags or spec.fields:
            type_name = f"{path}::{scope.claim(names.type_name(spec.name), 'Value')}"
            shape = shape_of(type_name, spec.fields, named) if spec.fields else None
        found.append(Member(spec, members[spec.name], type_name, shape))
    return Shape(path, tuple(found))


def named_shapes(protocol: Protocol, scope: names.Scope) -> dict[str, Shape]:
    """The structs of the file's types that messages use, each behind those that it needs."""
    found: dict[str, Shape] = {}

    def visit(fields: tuple[Field, ...]) -> None:
        for field in fields:
            visit(field.fields)
            if field.type_name and field.type_name not in found:
                path = scope.claim(names.type_name(field.type_name), "Type")
                found[field.type_name] = shape_of(path, field.fields, found)

    for message in protocol.messages:
        visit(message.fields)
    return found


# ---- declarations -----------------------------------------------------------------------------------------------


def type_blocks(shape: Shape) -> list[list[str]]:
    """The types that a struct declares within itself, each as lines."""
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
    """A whole struct, without a comment before it."""
    lines = [f"struct {shape.path.rpartition('::')[2]} {{"]
    for block in type_blocks(shape):
        lines += [*("  " + line for line in block), ""]
    return [*lines, *("  " + line for line in member_lines(shape)), "};"]


def member_lines(shape: Shape) -> list[str]:
    """The struct's members with their first values, a line each."""
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
    """A text or byte string with its first value."""
    element = "char" if spec.kind == FieldKind.TEXT else "std::uint8_t"
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
    """Each enum of the struct and of those within it, by its full name, with its enumerators."""
    found = []
    for member in shape.members:
        if member.shape is not None and member.is_own_type:
            found += known_enums(member.shape)
        elif member.spec.enum:
            found.append(
                (member.type_name, [f"{member.type_name}::{names.identifier(name)}" for name, _ in member.spec.enum])
            )
    return found


# ---- where things lie -------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Here:
    """Where a struct lies: in the message, and in its payload."""

    value: str = "message"
    at: int = 0
    terms: str = ""  # ` + 7 * i`
    depth: int = 0  # of loops
    more: bool = False  # does something follow in the payload?

    def place(self, at: int) -> str:
        return f"payload + {self.at + at}{self.terms}"

    def inner(self, name: str, at: int, more: bool) -> _Here:
        return replace(self, value=f"{self.value}.{name}", at=self.at + at, more=more)

    @property
    def index(self) -> str:
        return "ijklmnopq"[self.depth]

    def element(self, name: str, at: int, stride: int, index: str, data: str = "") -> _Here:
        """An element of an array of structs; ``index`` is its variable."""
        return _Here(
            f"{self.value}.{name}{data}[{index}]",
            self.at + at,
            f"{self.terms} + {stride} * {index}",
            self.depth + 1,
            True,
        )


def _term(stride: int, index: str) -> str:
    return f" + {index}" if stride == 1 else f" + {stride} * {index}"


def _indented(lines: list[str]) -> list[str]:
    return ["  " + line for line in lines]


def _loop(index: str, end: str, lines: list[str]) -> list[str]:
    head = f"for (std::size_t {index} = 0; {index} < {end}; ++{index}) {{"
    return [head, *_indented(lines), "}"] if lines else []


def _walk(shape: Shape, here: _Here) -> Iterator[tuple[Member, int, bool]]:
    """Each member, its place among the others, and whether something follows it."""
    at = 0
    for number, member in enumerate(shape.members):
        yield member, at, here.more or number + 1 < len(shape.members)
        at += member.spec.min_wire_bytes


def _shifts(spec: Field) -> list[int]:
    """Of bit fields, the place of each one's lowest bit."""
    return [low for _, low in bit_places(spec)]


def _container_type(spec: Field) -> str:
    return element_type(Field(spec.name, FieldKind.UNSIGNED, spec.size), "")


def _container(spec: Field) -> Field:
    """The number that holds bit fields."""
    return Field(spec.name, FieldKind.UNSIGNED, spec.size, spec.order)


def _block_copy(spec: Field, element: str) -> str:
    """Template arguments of load_array and store_array where an array's numbers are the wire's."""
    order = ", wirebond::ByteOrder::big" if spec.order == ByteOrder.BIG else ""
    return f"<{element}, {spec.count}{order}>"


def _element_slot(spec: Field, here: _Here, at: int, index: str) -> Slot:
    if spec.packed is not None:
        return Slot(here.place(at), index)
    return Slot(here.place(at) + _term(spec.size, index))


# ---- writing ----------------------------------------------------------------------------------------------------


def write_lines(shape: Shape, here: _Here | None = None) -> list[str]:
    """The body of write_payload, up to `return true`."""
    here = here or _Here()
    lines: list[str] = []
    counted: dict[str, str] = {}  # field that counts -> the number that the first one that it counts gives it
    for member, at, more in _walk(shape, here):
        spec, value, place = member.spec, f"{here.value}.{member.name}", here.place(at)
        for name, step in spec.counters:
            own = _product(step, f"{value}.size")
            if counted[name] != own:
                lines.append(f"if ({own} != {counted[name]}) return false;")
        if spec.kind == FieldKind.PADDING and spec.constant:
            letters = "".join(f"\\x{byte:02X}" for byte in spec.constant_bytes)
            lines.append(f'std::memcpy({place}, "{letters}", {spec.size});')
        elif spec.kind == FieldKind.PADDING:
            lines.append(f"std::memset({place}, 0, {spec.size});")
        elif spec.is_count:
            lines += _count_lines(shape, here, spec.name, counted)
            lines.append(store_container(spec, _as_type(spec, counted[spec.name]), place))
        elif spec.kind == FieldKind.BITS:
            for run in (f"{spec.name}.{one.name}" for one in spec.fields if one.is_count):
                lines += _count_lines(shape, here, run, counted)
            lines += _write_bits(member, value, place, counted)
        elif spec.digits is not None:
            lines += write_digits(spec, spec.digits, value, place, more)
        elif spec.is_string:
            lines += _write_string(spec, value, place, more)
        elif spec.is_list:
            lines += _write_list(member, here, at, more)
        elif member.shape is not None and spec.count is not None:
            inner = here.element(member.name, at, spec.element_min_bytes, here.index)
            lines += _loop(here.index, str(spec.count), write_lines(member.shape, inner))
        elif member.shape is not None:
            lines += write_lines(member.shape, here.inner(member.name, at, more))
        elif spec.count is not None:
            lines += _write_array(member, here, at)
        else:
            lines += write_value(spec, value, Slot(place))
    return lines


def _count_lines(shape: Shape, here: _Here, name: str, counted: dict[str, str]) -> list[str]:
    """Note what a field that counts is given; the lines that refuse more than it may tell."""
    first, step = next((m, step) for m in shape.members for counter, step in m.spec.counters if counter == name)
    size = f"{here.value}.{first.name}.size"
    is_refused = any(number.endswith(size) for number in counted.values())
    counted[name] = _product(step, size)
    return [] if is_refused else _refusal(size, first.spec.max_count or first.spec.max_size, 16)


def _product(step: int, number: str) -> str:
    return number if step == 1 else f"{step} * {number}"


def _as_type(spec: Field, number: str) -> str:
    return f"static_cast<{element_type(spec, '')}>({number})"


def _write_bits(member: Member, value: str, place: str, counted: Mapping[str, str]) -> list[str]:
    assert member.shape is not None
    spec = member.spec
    fixed = sum((inner.constant or 0) << shift for inner, shift in zip(spec.fields, _shifts(spec), strict=True))
    lines = [f"{_container_type(spec)} bits = {integer(fixed)};"]
    for inner, shift in zip(member.shape.members, _shifts(spec), strict=True):
        slot = Slot("bits", shift=shift)
        if inner.spec.is_count:
            lines += write_value(inner.spec, _as_type(inner.spec, counted[f"{spec.name}.{inner.spec.name}"]), slot)
        elif inner.name:
            lines += write_value(inner.spec, f"{value}.{inner.name}", slot)
    return ["{", *_indented([*lines, store_container(spec, "bits", place)]), "}"]


def _has_mark(data: str, size: str, mark: bytes) -> str:
    """Is this delimiter, of one or two bytes, among the bytes of a text?"""
    return (
        f"wirebond::has_{'byte' if len(mark) == 1 else 'pair'}({data}, {size}, {', '.join(f'{b:#04x}' for b in mark)})"
    )


def _write_string(spec: Field, value: str, place: str, more: bool) -> list[str]:
    if not spec.is_variable:
        return [
            *(f"if ({_has_mark(f'{value}.data()', str(spec.size), mark)}) return false;" for mark in spec.excludes),
            f"std::memcpy({place}, {value}.data(), {spec.size});",
        ]
    lines = [] if spec.counted_by else _refusal(f"{value}.size", spec.max_size, 16)
    data, size = f"{value}.data.data()", f"{value}.size"
    lines += [f"if ({_has_mark(data, size, mark)}) return false;" for mark in spec.excludes]
    if spec.ends_with is not None:
        lines.append(f"if (wirebond::has_byte({value}.data.data(), {value}.size, {spec.ends_with:#04x})) return false;")
    lines.append(f"std::memcpy({place}, {value}.data.data(), {value}.size);")
    if spec.ends_with is not None:
        lines.append(f"*({place} + {value}.size) = {spec.ends_with:#04x};")
    return [*lines, f"payload += {value}.size;"] if more else lines


def _write_list(member: Member, here: _Here, at: int, more: bool) -> list[str]:
    spec, value, index = member.spec, f"{here.value}.{member.name}", here.index
    lines = [] if spec.counted_by else _refusal(f"{value}.size", spec.max_count, 16)
    if member.shape is not None:
        inner = here.element(member.name, at, spec.element_min_bytes, index, ".data")
        body = write_lines(member.shape, inner)
    else:
        body = write_value(spec, f"{value}.data[{index}]", _element_slot(spec, here, at, index))
    lines += _loop(index, f"{value}.size", body)
    return [*lines, f"payload += {_times(spec, f'{value}.size')};"] if more else lines


def _times(spec: Field, count: str) -> str:
    """Least wire bytes of this many elements."""
    return count if spec.element_min_bytes == 1 else f"{spec.element_min_bytes} * {count}"


def _refusal(number: str, most: int, bits: int) -> list[str]:
    """The line that refuses a greater number, where its type can hold one."""
    return [f"if ({number} > {most}) return false;"] if most < 2**bits - 1 else []


def _write_array(member: Member, here: _Here, at: int) -> list[str]:
    spec, value, index = member.spec, f"{here.value}.{member.name}", here.index
    if is_plain(spec) and not spec.packed and spec.kind != FieldKind.FLOAT and not outside(spec, value, received=False):
        arguments = _block_copy(spec, element_type(spec, ""))
        return [f"wirebond::store_array{arguments}({here.place(at)}, {value});"]
    body = write_value(spec, f"{value}[{index}]", _element_slot(spec, here, at, index))
    lines = [f"std::memset({here.place(at)}, 0, {spec.min_wire_bytes});"] if spec.packed is not None else []
    return [*lines, *_loop(index, str(spec.count), body)]


def size_lines(shape: Shape, here: _Here | None = None) -> list[str]:
    """Lines that add to ``bytes`` what fields of varying size take beyond their least."""
    here = here or _Here()
    lines = []
    for member, at, more in _walk(shape, here):
        spec, value = member.spec, f"{here.value}.{member.name}"
        if not spec.is_variable:
            continue
        if spec.digits is not None:
            lines.append(f"bytes += {digits_size(spec, spec.digits, value)};")
        elif spec.is_string:
            lines.append(f"bytes += {value}.size;")
        if spec.is_list:
            lines.append(f"bytes += {_times(spec, f'{value}.used()')};")
        if member.shape is not None:
            repeats = spec.is_list or spec.count is not None
            inner = (
                here.element(member.name, at, 0, here.index, ".data" if spec.is_list else "")
                if repeats
                else here.inner(member.name, at, more)
            )
            body = size_lines(member.shape, inner)
            end = f"{value}.used()" if spec.is_list else str(spec.count)
            lines += _loop(here.index, end, body) if repeats else body
    return lines


# ---- reading ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Told:
    """The variable that holds what a field that counts has told."""

    variable: str
    bits: int

    def size_lines(self, size: str, most: int, step: int) -> list[str]:
        """Lines that make it the number of elements or bytes, ``most`` at most; it tells ``step`` for each."""
        number = f"static_cast<std::size_t>({self.variable})"
        divided = [f"if ({number} % {step} != 0) return false;"] if step > 1 else []
        return [
            *_refusal(self.variable, most * step, self.bits),
            *divided,
            f"const std::size_t {size} = {number}{f' / {step}' if step > 1 else ''};",
        ]


def _told_lines(spec: Field, size: str, told: Mapping[str, _Told]) -> list[str]:
    """Lines that make what its counts tell its number of elements or bytes."""
    (name, step), *others = spec.counters
    lines = told[name].size_lines(size, spec.max_count or spec.max_size, step)
    return [*lines, *(f"if ({told[other].variable} != {_product(by, size)}) return false;" for other, by in others)]


class Reader:
    """The lines of one decode function."""

    def __init__(self, trims_zeros: bool) -> None:
        self._locals = names.Scope(_LOCALS)
        self._trims_zeros = trims_zeros

    def lines(self, shape: Shape, here: _Here | None = None) -> list[str]:
        """The body of decode behind the check of its size, up to `return true`."""
        here = here or _Here()
        lines: list[str] = []
        told: dict[str, _Told] = {}
        for member, at, more in _walk(shape, here):
            spec, value, place = member.spec, f"{here.value}.{member.name}", here.place(at)
            if spec.kind == FieldKind.PADDING:
                continue
            if spec.is_count:
                lines.append(self._tell(spec.name, spec, Slot(place), told))
            elif spec.kind == FieldKind.BITS:
                number = load_integer(_container(spec), Slot(place))
                for run, shift in zip(spec.fields, _shifts(spec), strict=True):
                    if run.is_count:
                        lines.append(self._tell(f"{spec.name}.{run.name}", run, Slot(number, shift=shift), told))
                lines += self._bits(member, value, number)
            elif spec.digits is not None:
                lines += self._digits(spec, spec.digits, value, place, member.type_name, more)
            elif spec.is_string:
                lines += self._string(spec, value, place, told, more)
            elif spec.is_list:
                lines += self._list(member, here, at, told, more)
            elif member.shape is not None and spec.count is not None:
                inner = here.element(member.name, at, spec.element_min_bytes, here.index)
                body = self.lines(member.shape, inner)
                lines += _loop(here.index, str(spec.count), body) if body else []
            elif member.shape is not None:
                lines += self.lines(member.shape, here.inner(member.name, at, more))
            elif spec.count is not None:
                lines += self._array(member, here, at)
            else:
                lines += read_value(spec, value, Slot(place), member.type_name)
        return lines

    def _tell(self, name: str, spec: Field, slot: Slot, told: dict[str, _Told]) -> str:
        """Keep what a field that counts tells."""
        told[name] = _Told(self._locals.claim(f"{names.code_name(spec.name)}_count", "_"), spec.width)
        return f"const auto {told[name].variable} = {load_integer(spec, slot)};"

    def _bits(self, member: Member, value: str, number: str) -> list[str]:
        assert member.shape is not None
        if not any(inner.name for inner in member.shape.members):
            return []
        spec = member.spec
        lines = [f"const {_container_type(spec)} bits = {number};"]
        for inner, shift in zip(member.shape.members, _shifts(spec), strict=True):
            if inner.name:
                slot = Slot("bits", shift=shift)
                lines += read_value(inner.spec, f"{value}.{inner.name}", slot, inner.type_name)
        return ["{", *_indented(lines), "}"]

    def _string(self, spec: Field, value: str, place: str, told: Mapping[str, _Told], more: bool) -> list[str]:
        if not spec.is_variable:
            return [f"std::memcpy({value}.data(), {place}, {spec.size});"]
        size, lines = self._size(spec, place, told)
        if spec.ends_with is None and not spec.counters and self._trims_zeros and spec.kind == FieldKind.TEXT:
            last = f"payload[{place.removeprefix('payload + ')} + {size} - 1]"
            lines.append(f"while ({size} != 0 && {last} == 0) --{size};")  # zeros that pad a payload are not text
        lines += [
            f"{value}.size = static_cast<std::uint16_t>({size});",
            f"std::memcpy({value}.data.data(), {place}, {size});",
        ]
        return [*lines, f"payload += {size};", f"spare -= {size};"] if more else lines

    def _digits(self, spec: Field, digits: Digits, value: str, place: str, type_name: str, more: bool) -> list[str]:
        if spec.size:
            return read_digits(spec, digits, value, place, str(spec.size), type_name)
        size, lines = self._size(spec, place, {})
        lines += read_digits(spec, digits, value, place, size, type_name)
        return [*lines, f"payload += {size};", f"spare -= {size};"] if more else lines

    def _size(self, spec: Field, place: str, told: Mapping[str, _Told]) -> tuple[str, list[str]]:
        """The variable with the bytes of what varies in size, and the lines that declare it."""
        size = self._locals.claim(f"{names.code_name(spec.name)}_size", "_")
        if spec.counters:
            return size, [*_told_lines(spec, size, told), f"if ({size} > spare) return false;"]
        if spec.ends_with is not None:
            most = f"spare < {spec.max_size} ? spare : {spec.max_size}"
            return size, [
                f"const std::size_t {size} = wirebond::size_before({place}, {most}, {spec.ends_with:#04x});",
                f"if ({size} > ({most})) return false;",
            ]
        return size, [f"std::size_t {size} = spare;", f"if ({size} > {spec.max_size}) {size} = {spec.max_size};"]

    def _list(self, member: Member, here: _Here, at: int, told: Mapping[str, _Told], more: bool) -> list[str]:
        spec, value, index = member.spec, f"{here.value}.{member.name}", here.index
        stride = spec.element_min_bytes
        varies = any(field.is_variable for field in spec.fields)
        size = self._locals.claim(f"{names.code_name(spec.name)}_size", "_")
        if member.shape is not None:
            body = self.lines(member.shape, here.element(member.name, at, stride, index, ".data"))
        else:
            slot = _element_slot(spec, here, at, index)
            body = read_value(spec, f"{value}.data[{index}]", slot, member.type_name)
        if spec.counters:
            lines = _told_lines(spec, size, told)
        elif varies:
            lines = [f"std::size_t {size} = 0;"]
        else:
            there = "spare" if stride == 1 else f"spare / {stride}"
            lines = [f"const std::size_t {size} = {there} < {spec.max_count} ? {there} : {spec.max_count};"]
        if varies and not spec.counters:
            head = f"for (std::size_t {index} = 0; {index} < {spec.max_count} && spare >= {stride}; ++{index}) {{"
            lines += [head, *_indented([f"spare -= {stride};", *body, f"++{size};"]), "}"]
        elif varies:
            lines += _loop(index, size, [f"if (spare < {stride}) return false;", f"spare -= {stride};", *body])
        else:
            lines += [f"if ({_times(spec, size)} > spare) return false;"] if spec.counters else []
            lines += [f"spare -= {_times(spec, size)};"] if more else []
            lines += _loop(index, size, body)
        lines.append(f"{value}.size = static_cast<std::uint16_t>({size});")
        return [*lines, f"payload += {_times(spec, size)};"] if more else lines

    def _array(self, member: Member, here: _Here, at: int) -> list[str]:
        spec, value, index = member.spec, f"{here.value}.{member.name}", here.index
        if is_plain(spec) and not spec.packed:
            return [f"wirebond::load_array{_block_copy(spec, element_type(spec, ''))}({here.place(at)}, {value});"]
        body = read_value(spec, f"{value}[{index}]", _element_slot(spec, here, at, index), member.type_name)
        return _loop(index, str(spec.count), body)


# ---- field rules ------------------------------------------------------------------------------------------------


def validate_lines(shape: Shape, value: str = "message") -> list[str]:
    """The body of violations, between the declaration of ``found`` and its return. ``value``: its argument."""
    return _rule_lines(shape, _Here(value), clamps=False)


def clamp_lines(shape: Shape) -> list[str]:
    """The body of clamp."""
    return _rule_lines(shape, _Here(), clamps=True)


def _rule_lines(shape: Shape, here: _Here, *, clamps: bool) -> list[str]:
    rule = clamp_value if clamps else validate_value
    lines: list[str] = []
    for member in shape.members:
        spec, value, index = member.spec, f"{here.value}.{member.name}", here.index
        if not member.name or spec.is_string:
            continue
        repeats = spec.is_list or spec.count is not None
        data = ".data" if spec.is_list else ""
        if member.shape is not None:
            inner = here.element(member.name, 0, 0, index, data) if repeats else here.inner(member.name, 0, True)
            body = _rule_lines(member.shape, inner, clamps=clamps)
        elif not clamps and _only_finite(spec):
            lines.append(f"if (!wirebond::all_finite({value})) found |= wirebond::Violation::not_finite;")
            continue
        else:
            body = rule(spec, f"{value}{data}[{index}]" if repeats else value)
        lines += _loop(index, f"{value}.used()" if spec.is_list else str(spec.count), body) if repeats else body
    return lines


def _only_finite(spec: Field) -> bool:
    """Is it an array whose elements have no other rule than that they are finite?"""
    bounded = outside(spec, "", received=True) or spec.enum
    return spec.kind == FieldKind.FLOAT and spec.count is not None and not spec.is_list and not bounded
