"""The lines that move a payload into a message."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from wirebond.generate.code import names
from wirebond.generate.code.cpp_field import Slot, element_type, is_plain, load_integer, read_digits, read_value
from wirebond.generate.code.cpp_shape import Member, Shape
from wirebond.generate.code.cpp_walk import (
    Here,
    block_copy,
    container,
    container_type,
    element_slot,
    indented,
    loop,
    product,
    refusal,
    shifts,
    times,
    walk,
)
from wirebond.protocol.model import Digits, Field, FieldKind

_LOCALS = frozenset({"message", "payload", "size", "spare", "found", "wire", "bits", "bytes", *"ijklmnopq"})


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
            *refusal(self.variable, most * step, self.bits),
            *divided,
            f"const std::size_t {size} = {number}{f' / {step}' if step > 1 else ''};",
        ]


def _told_lines(spec: Field, size: str, told: Mapping[str, _Told]) -> list[str]:
    """Lines that make what its counts tell its number of elements or bytes."""
    (name, step), *others = spec.counters
    lines = told[name].size_lines(size, spec.max_count or spec.max_size, step)
    return [*lines, *(f"if ({told[other].variable} != {product(by, size)}) return false;" for other, by in others)]


class Reader:
    """The lines of one decode function."""

    def __init__(self, trims_zeros: bool) -> None:
        self._locals = names.Scope(_LOCALS)
        self._trims_zeros = trims_zeros

    def lines(self, shape: Shape, here: Here | None = None) -> list[str]:
        """The body of decode behind the check of its size, up to `return true`."""
        here = here or Here()
        lines: list[str] = []
        told: dict[str, _Told] = {}
        for member, at, more in walk(shape, here):
            spec, value, place = member.spec, f"{here.value}.{member.name}", here.place(at)
            if not spec.has_value:
                continue
            if spec.is_count:
                lines.append(self._tell(spec.name, spec, Slot(place), told))
            elif spec.kind == FieldKind.BITS:
                number = load_integer(container(spec), Slot(place))
                for run, shift in zip(spec.fields, shifts(spec), strict=True):
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
                lines += loop(here.index, str(spec.count), body) if body else []
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
        lines = [f"const {container_type(spec)} bits = {number};"]
        for inner, shift in zip(member.shape.members, shifts(spec), strict=True):
            if inner.name:
                slot = Slot("bits", shift=shift)
                lines += read_value(inner.spec, f"{value}.{inner.name}", slot, inner.type_name)
        return ["{", *indented(lines), "}"]

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

    def _list(self, member: Member, here: Here, at: int, told: Mapping[str, _Told], more: bool) -> list[str]:
        spec, value, index = member.spec, f"{here.value}.{member.name}", here.index
        stride = spec.element_min_bytes
        varies = any(field.is_variable for field in spec.fields)
        size = self._locals.claim(f"{names.code_name(spec.name)}_size", "_")
        if member.shape is not None:
            body = self.lines(member.shape, here.element(member.name, at, stride, index, ".data"))
        else:
            slot = element_slot(spec, here, at, index)
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
            lines += [head, *indented([f"spare -= {stride};", *body, f"++{size};"]), "}"]
        elif varies:
            lines += loop(index, size, [f"if (spare < {stride}) return false;", f"spare -= {stride};", *body])
        else:
            lines += [f"if ({times(spec, size)} > spare) return false;"] if spec.counters else []
            lines += [f"spare -= {times(spec, size)};"] if more else []
            lines += loop(index, size, body)
        lines.append(f"{value}.size = static_cast<std::uint16_t>({size});")
        return [*lines, f"payload += {times(spec, size)};"] if more else lines

    def _array(self, member: Member, here: Here, at: int) -> list[str]:
        spec, value, index = member.spec, f"{here.value}.{member.name}", here.index
        if is_plain(spec) and not spec.packed:
            return [f"wirebond::load_array{block_copy(spec, element_type(spec, ''))}({here.place(at)}, {value});"]
        body = read_value(spec, f"{value}[{index}]", element_slot(spec, here, at, index), member.type_name)
        return loop(index, str(spec.count), body)
