"""The lines that compare a whole message with the rules of its fields, or bring it within them."""

from __future__ import annotations

from wirebond.generate.code.cpp_field import clamp_value, outside, validate_value
from wirebond.generate.code.cpp_shape import Shape
from wirebond.generate.code.cpp_walk import Here, loop
from wirebond.protocol.model import Field


def validate_lines(shape: Shape, value: str = "message") -> list[str]:
    """Return the body of violations, between the declaration of ``found`` and its return. ``value``: its argument."""
    return _rule_lines(shape, Here(value), clamps=False)


def clamp_lines(shape: Shape) -> list[str]:
    """Return the body of clamp."""
    return _rule_lines(shape, Here(), clamps=True)


def _rule_lines(shape: Shape, here: Here, *, clamps: bool) -> list[str]:
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
        lines += loop(index, f"{value}.used()" if spec.is_list else str(spec.count), body) if repeats else body
    return lines


def _only_finite(spec: Field) -> bool:
    """Check whether it is an array whose elements must be finite and have no other rule."""
    bounded = outside(spec, "", received=True) or spec.enum
    return spec.is_float and spec.count is not None and not spec.is_list and not bounded
