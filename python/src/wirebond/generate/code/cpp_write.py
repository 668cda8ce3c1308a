"""The lines that move a message into its payload, and those that say how many bytes it takes."""

from __future__ import annotations

from collections.abc import Mapping

from wirebond.generate.code.cpp_field import (
    Slot,
    digits_size,
    element_type,
    is_plain,
    outside,
    store_container,
    write_digits,
    write_value,
)
from wirebond.generate.code.cpp_number import integer
from wirebond.generate.code.cpp_shape import Member, Shape
from wirebond.generate.code.cpp_walk import (
    Here,
    block_copy,
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
from wirebond.protocol.model import Field, FieldKind


def write_lines(shape: Shape, here: Here | None = None) -> list[str]:
    """The body of write_payload, up to `return true`."""
    here = here or Here()
    lines: list[str] = []
    counted: dict[str, str] = {}  # field that counts -> the number that the first one that it counts gives it
    for member, at, more in walk(shape, here):
        spec, value, place = member.spec, f"{here.value}.{member.name}", here.place(at)
        for name, step in spec.counters:
            own = product(step, f"{value}.size")
            if counted[name] != own:
                lines.append(f"if ({own} != {counted[name]}) return false;")
        if not spec.has_value and spec.constant:
            letters = "".join(f"\\x{byte:02X}" for byte in spec.constant_bytes)
            lines.append(f'std::memcpy({place}, "{letters}", {spec.size});')
        elif not spec.has_value:
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
            lines += loop(here.index, str(spec.count), write_lines(member.shape, inner))
        elif member.shape is not None:
            lines += write_lines(member.shape, here.inner(member.name, at, more))
        elif spec.count is not None:
            lines += _write_array(member, here, at)
        else:
            lines += write_value(spec, value, Slot(place))
    return lines


def _count_lines(shape: Shape, here: Here, name: str, counted: dict[str, str]) -> list[str]:
    """Note what a field that counts is given; the lines that refuse more than it may tell."""
    first, step = next((m, step) for m in shape.members for counter, step in m.spec.counters if counter == name)
    size = f"{here.value}.{first.name}.size"
    is_refused = any(number.endswith(size) for number in counted.values())
    counted[name] = product(step, size)
    return [] if is_refused else refusal(size, first.spec.max_count or first.spec.max_size, 16)


def _as_type(spec: Field, number: str) -> str:
    return f"static_cast<{element_type(spec, '')}>({number})"


def _write_bits(member: Member, value: str, place: str, counted: Mapping[str, str]) -> list[str]:
    assert member.shape is not None
    spec = member.spec
    fixed = sum((inner.constant or 0) << shift for inner, shift in zip(spec.fields, shifts(spec), strict=True))
    lines = [f"{container_type(spec)} bits = {integer(fixed)};"]
    for inner, shift in zip(member.shape.members, shifts(spec), strict=True):
        slot = Slot("bits", shift=shift)
        if inner.spec.is_count:
            lines += write_value(inner.spec, _as_type(inner.spec, counted[f"{spec.name}.{inner.spec.name}"]), slot)
        elif inner.name:
            lines += write_value(inner.spec, f"{value}.{inner.name}", slot)
    return ["{", *indented([*lines, store_container(spec, "bits", place)]), "}"]


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
    lines = [] if spec.counted_by else refusal(f"{value}.size", spec.max_size, 16)
    data, size = f"{value}.data.data()", f"{value}.size"
    lines += [f"if ({_has_mark(data, size, mark)}) return false;" for mark in spec.excludes]
    if spec.ends_with is not None:
        lines.append(f"if (wirebond::has_byte({value}.data.data(), {value}.size, {spec.ends_with:#04x})) return false;")
    lines.append(f"std::memcpy({place}, {value}.data.data(), {value}.size);")
    if spec.ends_with is not None:
        lines.append(f"*({place} + {value}.size) = {spec.ends_with:#04x};")
    return [*lines, f"payload += {value}.size;"] if more else lines


def _write_list(member: Member, here: Here, at: int, more: bool) -> list[str]:
    spec, value, index = member.spec, f"{here.value}.{member.name}", here.index
    lines = [] if spec.counted_by else refusal(f"{value}.size", spec.max_count, 16)
    if member.shape is not None:
        inner = here.element(member.name, at, spec.element_min_bytes, index, ".data")
        body = write_lines(member.shape, inner)
    else:
        body = write_value(spec, f"{value}.data[{index}]", element_slot(spec, here, at, index))
    lines += loop(index, f"{value}.size", body)
    return [*lines, f"payload += {times(spec, f'{value}.size')};"] if more else lines


def _write_array(member: Member, here: Here, at: int) -> list[str]:
    spec, value, index = member.spec, f"{here.value}.{member.name}", here.index
    if is_plain(spec) and not spec.packed and not spec.is_float and not outside(spec, value, received=False):
        arguments = block_copy(spec, element_type(spec, ""))
        return [f"wirebond::store_array{arguments}({here.place(at)}, {value});"]
    body = write_value(spec, f"{value}[{index}]", element_slot(spec, here, at, index))
    lines = [f"std::memset({here.place(at)}, 0, {spec.min_wire_bytes});"] if spec.packed is not None else []
    return [*lines, *loop(index, str(spec.count), body)]


def size_lines(shape: Shape, here: Here | None = None) -> list[str]:
    """Lines that add to ``bytes`` what fields of varying size take beyond their least."""
    here = here or Here()
    lines = []
    for member, at, more in walk(shape, here):
        spec, value = member.spec, f"{here.value}.{member.name}"
        if not spec.is_variable:
            continue
        if spec.digits is not None:
            lines.append(f"bytes += {digits_size(spec, spec.digits, value)};")
        elif spec.is_string:
            lines.append(f"bytes += {value}.size;")
        if spec.is_list:
            lines.append(f"bytes += {times(spec, f'{value}.used()')};")
        if member.shape is not None:
            repeats = spec.is_list or spec.count is not None
            inner = (
                here.element(member.name, at, 0, here.index, ".data" if spec.is_list else "")
                if repeats
                else here.inner(member.name, at, more)
            )
            body = size_lines(member.shape, inner)
            end = f"{value}.used()" if spec.is_list else str(spec.count)
            lines += loop(here.index, end, body) if repeats else body
    return lines
