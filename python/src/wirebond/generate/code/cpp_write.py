"""The lines that move a message into its payload, and those that say how many bytes it takes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import assert_never

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
    walk,
)
from wirebond.protocol.model import Field
from wirebond.protocol.model.layout import Array, Bits, Characters, Constant, Group, List, Number, Padding, Told


def write_lines(shape: Shape, here: Here | None = None) -> list[str]:
    """Return the body of write_payload, up to `return true`."""
    here = here or Here()
    lines: list[str] = []
    counted: dict[str, str] = {}  # field that counts -> the number that the first one that it counts gives it
    for member, step, more in walk(shape, here):
        spec, value, place = member.spec, f"{here.value}.{member.name}", here.place(step.at)
        match step:
            case Padding():
                lines.append(f"std::memset({place}, 0, {spec.size});")
            case Constant() if not any(step.wire):
                lines.append(f"std::memset({place}, 0, {spec.size});")
            case Constant():
                letters = "".join(f"\\x{byte:02X}" for byte in step.wire)
                lines.append(f'std::memcpy({place}, "{letters}", {spec.size});')
            case Number(slot=int()):
                lines += _count_lines(shape, here, spec.name, counted)
                lines.append(store_container(spec, _as_type(spec, counted[spec.name]), place))
            case Number():
                lines += write_value(spec, value, Slot(place))
            case Array():
                lines += _write_array(member, here, step.at)
            case Bits():
                for run in (f"{spec.name}.{one.field.name}" for one in step.members if one.slot is not None):
                    lines += _count_lines(shape, here, run, counted)
                lines += _write_bits(member, step, value, place, counted)
            case Characters():
                lines += _agree_lines(step.told, value, counted)
                lines += _write_characters(step, value, place, more)
            case List():
                lines += _agree_lines(step.told, value, counted)
                lines += _write_list(member, step, here, more)
            case Group():
                lines += _write_group(member, step, here, more)
            case _:
                assert_never(step)
    return lines


def _agree_lines(told: tuple[Told, ...], value: str, counted: Mapping[str, str]) -> list[str]:
    """Return lines that refuse a size which differs from that of earlier counts of the same fields."""
    sizes = [(product(one.per, f"{value}.size"), counted[one.name]) for one in told]
    return [f"if ({own} != {other}) return false;" for own, other in sizes if own != other]


def _count_lines(shape: Shape, here: Here, name: str, counted: dict[str, str]) -> list[str]:
    """Note the number of a field that counts; the lines that refuse more than it can express."""
    first, per = next((m, per) for m in shape.members for counter, per in m.spec.counters if counter == name)
    size = f"{here.value}.{first.name}.size"
    is_refused = any(number.endswith(size) for number in counted.values())
    counted[name] = product(per, size)
    return [] if is_refused else refusal(size, first.spec.max_count or first.spec.max_size, 16)


def _as_type(spec: Field, number: str) -> str:
    return f"static_cast<{element_type(spec, '')}>({number})"


def _write_bits(member: Member, step: Bits, value: str, place: str, counted: Mapping[str, str]) -> list[str]:
    assert member.shape is not None
    spec = member.spec
    fixed = sum((run.field.constant or 0) << run.low for run in step.members)
    lines = [f"{container_type(spec)} bits = {integer(fixed)};"]
    for inner, run in zip(member.shape.members, step.members, strict=True):
        slot = Slot("bits", shift=run.low)
        if run.slot is not None:
            lines += write_value(run.field, _as_type(run.field, counted[f"{spec.name}.{run.field.name}"]), slot)
        elif inner.name:
            lines += write_value(run.field, f"{value}.{inner.name}", slot)
    return ["{", *indented([*lines, store_container(spec, "bits", place)]), "}"]


def _has_mark(data: str, size: str, mark: bytes) -> str:
    """Write a test whether this delimiter, of one or two bytes, is in a text."""
    return (
        f"wirebond::has_{'byte' if len(mark) == 1 else 'pair'}({data}, {size}, {', '.join(f'{b:#04x}' for b in mark)})"
    )


def _write_characters(step: Characters, value: str, place: str, more: bool) -> list[str]:
    spec = step.field
    if spec.digits is not None:
        return write_digits(spec, spec.digits, value, place, more)
    if not spec.is_variable:
        return [
            *(f"if ({_has_mark(f'{value}.data()', str(spec.size), mark)}) return false;" for mark in spec.excludes),
            f"std::memcpy({place}, {value}.data(), {spec.size});",
        ]
    lines = [] if step.told else refusal(f"{value}.size", spec.max_size, 16)
    data, size = f"{value}.data.data()", f"{value}.size"
    lines += [f"if ({_has_mark(data, size, mark)}) return false;" for mark in spec.excludes]
    if spec.ends_with is not None:
        lines.append(f"if (wirebond::has_byte({value}.data.data(), {value}.size, {spec.ends_with:#04x})) return false;")
    lines.append(f"std::memcpy({place}, {value}.data.data(), {value}.size);")
    if spec.ends_with is not None:
        lines.append(f"*({place} + {value}.size) = {spec.ends_with:#04x};")
    return [*lines, f"payload += {value}.size;"] if more else lines


def _write_group(member: Member, step: Group, here: Here, more: bool) -> list[str]:
    assert member.shape is not None
    if member.spec.count is None:
        return write_lines(member.shape, here.inner(member.name, step.at, more))
    inner = here.element(member.name, step.at, step.stride, here.index)
    return loop(here.index, str(member.spec.count), write_lines(member.shape, inner))


def _write_list(member: Member, step: List, here: Here, more: bool) -> list[str]:
    spec, value, index = member.spec, f"{here.value}.{member.name}", here.index
    lines = [] if step.told else refusal(f"{value}.size", spec.max_count, 16)
    if member.shape is not None:
        inner = here.element(member.name, step.at, step.stride, index, ".data")
        body = write_lines(member.shape, inner)
    else:
        body = write_value(spec, f"{value}.data[{index}]", element_slot(spec, here, step.at, index))
    lines += loop(index, f"{value}.size", body)
    return [*lines, f"payload += {product(step.stride, f'{value}.size')};"] if more else lines


def _write_array(member: Member, here: Here, at: int) -> list[str]:
    spec, value, index = member.spec, f"{here.value}.{member.name}", here.index
    if is_plain(spec) and not spec.packed and not spec.is_float and not outside(spec, value, received=False):
        arguments = block_copy(spec, element_type(spec, ""))
        return [f"wirebond::store_array{arguments}({here.place(at)}, {value});"]
    body = write_value(spec, f"{value}[{index}]", element_slot(spec, here, at, index))
    lines = [f"std::memset({here.place(at)}, 0, {spec.min_wire_bytes});"] if spec.packed is not None else []
    return [*lines, *loop(index, str(spec.count), body)]


def size_lines(shape: Shape, here: Here | None = None) -> list[str]:
    """Return lines that add to ``bytes`` how much fields of varying size exceed their minimum."""
    here = here or Here()
    lines = []
    for member, step, more in walk(shape, here):
        spec, value = member.spec, f"{here.value}.{member.name}"
        if not spec.is_variable:
            continue
        match step:
            case Characters() if spec.digits is not None:
                lines.append(f"bytes += {digits_size(spec, spec.digits, value)};")
            case Characters():
                lines.append(f"bytes += {value}.size;")
            case List():
                lines.append(f"bytes += {product(step.stride, f'{value}.used()')};")
                if member.shape is not None:
                    inner = here.element(member.name, step.at, 0, here.index, ".data")
                    lines += loop(here.index, f"{value}.used()", size_lines(member.shape, inner))
            case Group() if member.shape is not None and spec.count is not None:
                inner = here.element(member.name, step.at, 0, here.index)
                lines += loop(here.index, str(spec.count), size_lines(member.shape, inner))
            case Group() if member.shape is not None:
                lines += size_lines(member.shape, here.inner(member.name, step.at, more))
    return lines
