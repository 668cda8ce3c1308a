"""Messages with the values that the file gives, as C++: the lines that assign them, and those that compare them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from wirebond.generate.code.cpp_field import initial_value
from wirebond.generate.code.cpp_number import Scaling, integer, real, real_type
from wirebond.generate.code.cpp_shape import Member, Shape, declared_string
from wirebond.protocol.model import Field, GivenValue


def given_value(member: Member, value: GivenValue) -> str:
    """Write one value of the file as an expression for the field's member, or for one element of it."""
    spec = member.spec
    if spec.is_string:
        assert isinstance(value, str | bytes), "the reader gives no others"
        return declared_string(replace(spec, default=value), "given").split(" = ", 1)[1]
    if isinstance(value, tuple):  # names of flags
        bits = dict(spec.flags)
        value = sum(1 << bits[str(name)] for name in value)
    assert isinstance(value, float | int | bool | str), "the reader gives no others"
    return initial_value(spec, member.type_name, _as_carried(spec, value))


def assign_lines(shape: Shape, values: Mapping[str, GivenValue], target: str) -> list[str]:
    """Return lines that give members of the struct ``target`` these values."""
    lines: list[str] = []
    for name, value in values.items():
        member = shape.member(name)
        place = f"{target}.{member.name}"
        if not member.name:  # it counts others
            continue
        if isinstance(value, Mapping):
            assert member.shape is not None, "the reader gives no others"
            lines += assign_lines(member.shape, value, place)
        elif not _repeats(member.spec):
            lines.append(f"{place} = {given_value(member, value)};")
        elif not isinstance(value, tuple):
            raise AssertionError("the reader gives no others")
        elif member.shape is None:
            elements = ", ".join(given_value(member, one) for one in value)
            listed = f"{{{len(value)}, {{{elements}}}}}" if value else "{}"
            lines.append(f"{place} = {listed if member.spec.is_list else f'{{{elements}}}'};")
        else:
            if member.spec.is_list:
                lines.append(f"{place}.size = {len(value)};")
            for index, one in enumerate(value):
                assert isinstance(one, Mapping), "the reader gives no others"
                lines += assign_lines(member.shape, one, f"{place}[{index}]")
    return lines


def equal_lines(members: tuple[Member, ...], a: str, b: str, depth: int = 0) -> list[str]:
    """Return lines that return false if members of the structs ``a``, received, and ``b`` differ."""
    lines: list[str] = []
    for member in members:
        spec, one, other = member.spec, f"{a}.{member.name}", f"{b}.{member.name}"
        if not member.name:
            continue
        index = "ijklmnopq"[depth]
        at = f".data[{index}]" if spec.is_list else f"[{index}]" if _repeats(spec) else ""
        if member.shape is not None:
            body = equal_lines(member.shape.members, one + at, other + at, depth + _repeats(spec))
        else:
            body = [f"if (!{_same(spec, one + at, other + at)}) return false;"]
        if spec.is_list:
            lines.append(f"if ({one}.used() != {other}.used()) return false;")
        if not _repeats(spec):
            lines += body
        elif body:
            end = f"{other}.used()" if spec.is_list else integer(spec.count or 0)
            lines += [f"for (std::size_t {index} = 0; {index} < {end}; ++{index}) {{", *(f"  {x}" for x in body), "}"]
    return lines


def _repeats(spec: Field) -> bool:
    """Check whether it is an array or a group."""
    return spec.is_list or spec.count is not None


def _same(spec: Field, a: str, b: str) -> str:
    """Write a test whether two values are the same number on the wire."""
    is_number = spec.is_number
    if not is_number or not spec.is_scaled or Scaling(spec, real_type(spec)).is_exact:
        return f"wirebond::detail::are_equal({a}, {b}, 0)"
    kind = real_type(spec)
    if spec.is_float:
        offset = real(abs(spec.offset), kind)
        return f"wirebond::detail::are_close<{kind}>({a}, {b}, {offset}, {spec.float_format.steps})"
    return f"wirebond::detail::are_near<{kind}>({a}, {b}, {real(abs(spec.scale) / 2, kind)})"


def _as_carried(spec: Field, value: float | int | bool | str) -> float | int | bool | str:
    """Return the value of a scaled integer as it is on the wire: a receiver compares it with the decoded value."""
    if not spec.is_integer or not spec.is_scaled or isinstance(value, str):
        return value
    return float(spec.wire_number(value) * spec.scale + spec.offset)
