"""The lines that move a payload into a message."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import assert_never

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
    walk,
)
from wirebond.protocol.model import Field
from wirebond.protocol.model.layout import Array, Bits, Characters, Constant, Group, List, Number, Padding, Told

_LOCALS = frozenset({"message", "payload", "size", "spare", "found", "wire", "bits", "bytes", *"ijklmnopq"})


@dataclass(frozen=True)
class _Told:
    """The variable that holds the number of a field that counts."""

    variable: str
    bits: int

    def size_lines(self, size: str, most: int, step: int) -> list[str]:
        """Return lines that compute the number of elements or bytes, ``most`` at most; the count has ``step`` for
        each."""
        number = f"static_cast<std::size_t>({self.variable})"
        divided = [f"if ({number} % {step} != 0) return false;"] if step > 1 else []
        return [
            *refusal(self.variable, most * step, self.bits),
            *divided,
            f"const std::size_t {size} = {number}{f' / {step}' if step > 1 else ''};",
        ]


def _told_lines(by: tuple[Told, ...], size: str, most: int, told: Mapping[str, _Told]) -> list[str]:
    """Return lines that compute a number of elements or bytes from its counts."""
    first, *others = by
    lines = told[first.name].size_lines(size, most, first.per)
    agree = (f"if ({told[one.name].variable} != {product(one.per, size)}) return false;" for one in others)
    return [*lines, *agree]


class Reader:
    """The lines of one decode function."""

    def __init__(self, trims_zeros: bool) -> None:
        self._locals = names.Scope(_LOCALS)
        self._trims_zeros = trims_zeros

    def lines(self, shape: Shape, here: Here | None = None) -> list[str]:
        """Return the body of decode after the check of its size, up to `return true`."""
        here = here or Here()
        lines: list[str] = []
        told: dict[str, _Told] = {}
        for member, step, more in walk(shape, here):
            spec, value, place = member.spec, f"{here.value}.{member.name}", here.place(step.at)
            match step:
                case Number(slot=int()):
                    lines.append(self._tell(spec.name, spec, Slot(place), told))
                case Number():
                    lines += read_value(spec, value, Slot(place), member.type_name)
                case Array():
                    lines += self._array(member, here, step.at)
                case Bits():
                    number = load_integer(container(spec), Slot(place))
                    for run in step.members:
                        if run.slot is not None:
                            name = f"{spec.name}.{run.field.name}"
                            lines.append(self._tell(name, run.field, Slot(number, shift=run.low), told))
                    lines += self._bits(member, step, value, number)
                case Characters():
                    lines += self._characters(step, value, place, member.type_name, told, more)
                case List():
                    lines += self._list(member, step, here, told, more)
                case Group():
                    lines += self._group(member, step, here, more)
                case Padding() | Constant():
                    pass
                case _:
                    assert_never(step)
        return lines

    def _tell(self, name: str, spec: Field, slot: Slot, told: dict[str, _Told]) -> str:
        """Keep the number of a field that counts."""
        told[name] = _Told(self._locals.claim(f"{names.code_name(spec.name)}_count", "_"), spec.width)
        return f"const auto {told[name].variable} = {load_integer(spec, slot)};"

    def _bits(self, member: Member, step: Bits, value: str, number: str) -> list[str]:
        assert member.shape is not None
        if not any(inner.name for inner in member.shape.members):
            return []
        lines = [f"const {container_type(member.spec)} bits = {number};"]
        for inner, run in zip(member.shape.members, step.members, strict=True):
            if inner.name:
                slot = Slot("bits", shift=run.low)
                lines += read_value(inner.spec, f"{value}.{inner.name}", slot, inner.type_name)
        return ["{", *indented(lines), "}"]

    def _characters(
        self, step: Characters, value: str, place: str, type_name: str, told: Mapping[str, _Told], more: bool
    ) -> list[str]:
        spec = step.field
        if spec.size and spec.digits is not None:
            return read_digits(spec, spec.digits, value, place, str(spec.size), type_name)
        if spec.size:
            return [f"std::memcpy({value}.data(), {place}, {spec.size});"]
        size, lines = self._size(step, place, told)
        if spec.digits is not None:
            lines += read_digits(spec, spec.digits, value, place, size, type_name)
        else:
            if spec.ends_with is None and not step.told and self._trims_zeros and spec.value_type is str:
                last = f"payload[{place.removeprefix('payload + ')} + {size} - 1]"
                lines.append(f"while ({size} != 0 && {last} == 0) --{size};")  # zeros that pad a payload are not text
            lines += [
                f"{value}.size = static_cast<std::uint16_t>({size});",
                f"std::memcpy({value}.data.data(), {place}, {size});",
            ]
        return [*lines, f"payload += {size};", f"spare -= {size};"] if more else lines

    def _size(self, step: Characters, place: str, told: Mapping[str, _Told]) -> tuple[str, list[str]]:
        """Return the variable with the bytes of what varies in size, and the lines that declare it."""
        spec = step.field
        size = self._locals.claim(f"{names.code_name(spec.name)}_size", "_")
        if step.told:
            return size, [*_told_lines(step.told, size, spec.max_size, told), f"if ({size} > spare) return false;"]
        if spec.ends_with is not None:
            most = f"spare < {spec.max_size} ? spare : {spec.max_size}"
            return size, [
                f"const std::size_t {size} = wirebond::size_before({place}, {most}, {spec.ends_with:#04x});",
                f"if ({size} > ({most})) return false;",
            ]
        return size, [f"std::size_t {size} = spare;", f"if ({size} > {spec.max_size}) {size} = {spec.max_size};"]

    def _group(self, member: Member, step: Group, here: Here, more: bool) -> list[str]:
        assert member.shape is not None
        if member.spec.count is None:
            return self.lines(member.shape, here.inner(member.name, step.at, more))
        body = self.lines(member.shape, here.element(member.name, step.at, step.stride, here.index))
        return loop(here.index, str(member.spec.count), body)

    def _list(self, member: Member, step: List, here: Here, told: Mapping[str, _Told], more: bool) -> list[str]:
        spec, value, index = member.spec, f"{here.value}.{member.name}", here.index
        stride = step.stride
        varies = any(field.is_variable for field in spec.fields)
        size = self._locals.claim(f"{names.code_name(spec.name)}_size", "_")
        if member.shape is not None:
            body = self.lines(member.shape, here.element(member.name, step.at, stride, index, ".data"))
        else:
            slot = element_slot(spec, here, step.at, index)
            body = read_value(spec, f"{value}.data[{index}]", slot, member.type_name)
        if step.told:
            lines = _told_lines(step.told, size, spec.max_count, told)
        elif varies:
            lines = [f"std::size_t {size} = 0;"]
        else:
            there = "spare" if stride == 1 else f"spare / {stride}"
            lines = [f"const std::size_t {size} = {there} < {spec.max_count} ? {there} : {spec.max_count};"]
        if varies and not step.told:
            head = f"for (std::size_t {index} = 0; {index} < {spec.max_count} && spare >= {stride}; ++{index}) {{"
            lines += [head, *indented([f"spare -= {stride};", *body, f"++{size};"]), "}"]
        elif varies:
            lines += loop(index, size, [f"if (spare < {stride}) return false;", f"spare -= {stride};", *body])
        else:
            lines += [f"if ({product(stride, size)} > spare) return false;"] if step.told else []
            lines += [f"spare -= {product(stride, size)};"] if more else []
            lines += loop(index, size, body)
        lines.append(f"{value}.size = static_cast<std::uint16_t>({size});")
        return [*lines, f"payload += {product(stride, size)};"] if more else lines

    def _array(self, member: Member, here: Here, at: int) -> list[str]:
        spec, value, index = member.spec, f"{here.value}.{member.name}", here.index
        if is_plain(spec) and not spec.packed:
            return [f"wirebond::load_array{block_copy(spec, element_type(spec, ''))}({here.place(at)}, {value});"]
        body = read_value(spec, f"{value}[{index}]", element_slot(spec, here, at, index), member.type_name)
        return loop(index, str(spec.count), body)
