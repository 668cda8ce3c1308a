"""A value of a message: from its syntax to the model, and what its keys mean together."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from typing import Any

from wirebond.protocol import names
from wirebond.protocol.meaning.field_values import (
    Given,
    fit_value,
    number_text,
    value_limits,
    wire_limits,
)
from wirebond.protocol.model import F32, F64, NUMBERS, UNSIGNED, ByteOrder, Field, FieldKind, OnRange
from wirebond.protocol.problems import Place, Problems
from wirebond.protocol.text.field_grammar import (
    BitFieldSyntax,
    NumberSyntax,
    ValueSyntax,
)
from wirebond.protocol.text.field_types import most_bits
from wirebond.protocol.text.scalars import WireType
from wirebond.protocol.text.yaml_tree import Mapping, Scalar

# How many steps of the scale an offset may have, so that a double tells neighbours on the wire apart, there and back:
# it has 53 bits, and what is not exact in it takes some of them.
_MOST_EXACT_STEPS = 2**51
_MOST_STEPS = 2**48

MAX_CONSTANT = 64  # bytes of the constants of one message
STRINGS = (FieldKind.TEXT, FieldKind.BYTES)

# Which options have a meaning for which types: see `_sorts`. The others are refused rather than ignored.
_OPTIONS: tuple[tuple[str, tuple[str, ...], str], ...] = (
    ("count", ("number", "bool"), "numbers and bool; give a text its bytes with `size` or `max`"),
    ("packed", ("integer", "bool"), "whole numbers and bool; remove it"),
    ("size", ("string", "padding"), "text, bytes and padding; for an array of numbers write `count`"),
    ("ends_with", ("string",), "text and bytes; remove it"),
    ("scale", ("number",), "numbers; remove it"),
    ("offset", ("number",), "numbers; remove it"),
    ("unit", ("number",), "numbers; remove it"),
    ("range", ("number",), "numbers; remove it"),
    ("enum", ("integer",), "whole numbers; take u8, or remove it"),
    ("flags", ("unsigned",), "unsigned whole numbers; take u8, or remove it"),
    ("default", ("number", "bool", "string"), "values, and padding has none; remove it"),
    (
        "constant",
        ("integer", "bool", "string"),
        "whole numbers, bool, text and bytes; for padding write `must_be_zero: true`",
    ),
    ("must_be_zero", ("padding",), "padding; for a number write `constant: 0`"),
    (
        "text",
        ("unsigned", "signed", "sign_magnitude"),
        "whole numbers, such as u16 and i32; for one with a point write i32 and `decimals: 2`",
    ),
)
# Those that a number in characters has, as a string has.
_OF_CHARACTERS = ("size", "ends_with")
# What a field that has one value only cannot have, too.
_NOT_CONSTANT = (
    "count", "packed", "max", "ends_with", "scale", "offset", "unit", "range", "on_range", "default", "enum", "flags",
    "clock",
)  # fmt: skip


def _sorts(wire_type: WireType) -> set[str]:
    """Return the properties of a type for `_OPTIONS`: its kind, its coding, a number, a string."""
    found = {wire_type.kind.value}
    if wire_type.is_integer:
        found.add(wire_type.coding.name)
    if wire_type.kind in NUMBERS:
        found.add("number")
    if wire_type.kind in STRINGS:
        found.add("string")
    return found


def read_bit_field(
    name: str, syntax: BitFieldSyntax, node: Mapping, problems: Problems, continued: int = 0
) -> Field | None:
    """Read one of the values that share a number's bits, as `read_plain`.

    ``continued``: bits of it that are elsewhere among them.
    """
    return _BitFieldReader(syntax, syntax.type, node, problems).read(name, syntax, continued)


class ValueReader:
    """Reads the properties that all kinds of values share."""

    def __init__(self, syntax: NumberSyntax, wire_type: WireType, node: Mapping, problems: Problems) -> None:
        self._syntax = syntax
        self._type = wire_type
        self._node = node
        self._problems = problems
        self._good = True

    def _wrong(self, place: Place, message: str) -> None:
        self._problems.add(place, message)
        self._good = False

    def _common(self, name: str) -> dict[str, Any]:
        """Return the model's form of the options that every value has."""
        syntax = self._syntax
        return {
            "name": name,
            "kind": self._type.kind,
            "coding": self._type.coding,
            "scale": Fraction(1) if syntax.scale is None else syntax.scale,
            "offset": Fraction(0) if syntax.offset is None else syntax.offset,
            "unit": syntax.unit or "",
            "minimum": None if syntax.range is None else float(syntax.range[0]),
            "maximum": None if syntax.range is None else float(syntax.range[1]),
            "on_range": OnRange(getattr(syntax, "on_range", None) or "reject"),
            "enum": tuple((syntax.enum or {}).items()),
            "flags": tuple((syntax.flags or {}).items()),
            "description": syntax.description,
        }

    def _validated(self, field: Field) -> Field | None:
        """Return the field with its default, validated with all its options."""
        if not self._means_something(field):
            return None
        field = _with_range_of_digits(field)
        assert isinstance(self._syntax, ValueSyntax)
        default: Given | None = self._syntax.default
        if default is None:
            return field
        node = self._node.get("default")
        if field.value_type is bytes and isinstance(node, Scalar):
            default = node.text  # a single 0x01 was read as a number
        value, fault = fit_value(field, default)
        if fault:
            self._wrong(self._node.value_place("default"), fault)
            return None
        return Field(**{**vars(field), "default": value})

    def _means_something(self, field: Field) -> bool:
        """Return whether its options fit its type and each other."""
        self._validate_scale(field)
        if self._good:
            self._validate_range(field)
        self._validate_enum(field)
        self._validate_flags(field)
        return self._good

    def _validate_options(self) -> None:
        syntax, sorts = self._syntax, _sorts(self._type)
        for option, wanted, whose in _OPTIONS:
            is_allowed = not sorts.isdisjoint(wanted) or (
                option in _OF_CHARACTERS and getattr(syntax, "text", None) is not None
            )
            if getattr(syntax, option, None) is not None and not is_allowed:
                self._wrong(self._node.key_place(option), f"`{option}` is for {whose}")
        for one, other in (("enum", "flags"), ("enum", "range"), ("flags", "range")):
            if getattr(syntax, one) is not None and getattr(syntax, other) is not None:
                self._wrong(
                    self._node.key_place(other), f"`{other}` cannot be combined with `{one}`; keep one of the two"
                )
        for named in ("enum", "flags"):
            for option in ("scale", "offset", "unit"):
                if getattr(syntax, named) is not None and getattr(syntax, option) is not None:
                    place = self._node.key_place(option)
                    self._wrong(place, f"`{option}` has no meaning for named numbers (`{named}`); remove it")
        for option in _NOT_CONSTANT if getattr(syntax, "constant", None) is not None else ():
            if getattr(syntax, option, None) is not None:
                self._wrong(
                    self._node.key_place(option),
                    f"`{option}` cannot be combined with `constant`, which is one value; remove it",
                )
        if getattr(syntax, "on_range", None) is not None and syntax.range is None:
            self._wrong(
                self._node.key_place("on_range"),
                "`on_range` has no meaning without `range`; add `range: [0, 1]`",
            )

    def _constant(self, field: Field) -> Field | None:
        """Return padding with the bits that the file requires. ``field``: as it would be with a value."""
        assert isinstance(self._syntax, ValueSyntax)
        given = self._syntax.constant
        if given is None:
            return replace(field, constant=0 if self._syntax.must_be_zero else None)
        node = self._node.get("constant")
        if field.value_type is bytes and isinstance(node, Scalar):
            given = node.text  # a single 0x01 was read as a number
        value, fault = fit_value(field, given)
        if not fault and field.is_string:
            data = value.encode() if isinstance(value, str) else value
            assert isinstance(data, bytes)
            size = field.size or len(data)
            wire = int.from_bytes(data.ljust(size, b"\0"), "big")
            if size:
                return _as_constant(replace(field, size=size, max_size=0, order=ByteOrder.BIG), wire)
            fault = "this constant has no byte; write it, or remove the field"
        if fault:
            self._wrong(self._node.value_place("constant"), fault)
            return None
        assert isinstance(value, int)
        return _as_constant(field, field.wire_bits(value))

    def _validate_scale(self, field: Field) -> None:
        if field.scale == 0:
            self._wrong(self._node.value_place("scale"), "a scale of 0 would make every value the same; write another")
        elif field.is_number and field.is_scaled:
            for option, fault in _scale_faults(field):
                self._wrong(self._node.value_place(option), fault)

    def _validate_range(self, field: Field) -> None:
        bounds = self._syntax.range
        if bounds is None:
            return
        least, greatest = bounds
        place = self._node.value_place("range")
        if least >= greatest:
            self._wrong(
                place,
                f"the range ends ({number_text(greatest)}) before it begins ({number_text(least)}); swap them",
            )
            return
        lowest, highest = value_limits(field)
        fits = True
        for bound in bounds:
            if not lowest <= bound <= highest:
                fits = False
                self._wrong(
                    place, f"{number_text(bound)} does not fit: {_capacity(field, self._type)}; narrow the range"
                )
        if fits and field.is_integer:
            ends = sorted(((least - field.offset) / field.scale, (greatest - field.offset) / field.scale))
            if math.ceil(ends[0]) > math.floor(ends[1]):
                self._wrong(place, "no number on the wire has a value in this range; widen it, or take a finer scale")

    def _validate_names(self, node: Mapping, named: tuple[tuple[str, int], ...]) -> None:
        for name, other in names.meeting(name for name, _ in named):
            self._wrong(node.key_place(name), names.meeting_fault(name, other))

    def _validate_enum(self, field: Field) -> None:
        node = self._node.get("enum")
        if not field.enum or not isinstance(node, Mapping):
            return
        lowest, highest = wire_limits(field)
        self._validate_names(node, field.enum)
        by_value: dict[int, str] = {}
        for name, value in field.enum:
            if not lowest <= value <= highest:
                self._wrong(
                    node.value_place(name),
                    f"{value} does not fit {self._type.word} (from {lowest} to {highest}); take a wider type",
                )
            other = by_value.setdefault(value, name)
            if other != name:
                self._wrong(node.value_place(name), f"`{other}` is {value} already; give `{name}` a value of its own")

    def _validate_flags(self, field: Field) -> None:
        node = self._node.get("flags")
        if not field.flags or not isinstance(node, Mapping):
            return
        self._validate_names(node, field.flags)
        by_bit: dict[int, str] = {}
        for name, bit in field.flags:
            if bit >= field.width:
                self._wrong(
                    node.value_place(name),
                    f"{self._type.word} has no bit {bit}; its bits are 0 to {field.width - 1}",
                )
            other = by_bit.setdefault(bit, name)
            if other != name:
                self._wrong(node.value_place(name), f"`{other}` is bit {bit} already; give `{name}` a bit of its own")


def _with_range_of_digits(field: Field) -> Field:
    """Give decimal digits their own range, so that a receiver refuses other characters: see `Coding.gaps`."""
    if not field.coding.gaps or field.enum or field.minimum is not None:
        return field
    least, greatest = value_limits(field)
    return replace(field, minimum=float(least), maximum=float(greatest))


def _as_constant(field: Field, wire: int) -> Field:
    return replace(field, kind=FieldKind.PADDING, constant=wire, coding=UNSIGNED)


def _scale_faults(field: Field) -> Iterator[tuple[str, str]]:
    """Yield faults of scale and offset: values beyond those that a float of the type can hold."""
    greatest = max(abs(bound) for bound in value_limits(field))
    if not field.is_float and greatest > F64.greatest:
        yield "scale", "with this scale the maximum is beyond a double; use a smaller scale"
        return
    if field.is_float and field.float_format.cpp == "float":
        for option, number in (("scale", field.scale), ("offset", field.offset)):
            if number and not F32.least_normal <= abs(number) <= F32.greatest:
                yield (
                    option,
                    (
                        f"{field.float_format.name} values are computed in 32-bit floats, and {number_text(number)} is "
                        "out of their range (1.2e-38 to 3.4e+38); write a number within it, or take f64"
                    ),
                )
                return
    most = abs(field.scale) * (_MOST_EXACT_STEPS if field.is_exact_in_double else _MOST_STEPS)
    if abs(field.offset) > most:
        beside = f"beside an offset of {number_text(field.offset)} a double loses the steps of"
        yield "offset", f"{beside} {number_text(field.scale)}; write an offset of at most {number_text(most)}"


class _BitFieldReader(ValueReader):
    def read(self, name: str, syntax: BitFieldSyntax, continued: int) -> Field | None:
        is_padding = self._type.kind == FieldKind.PADDING
        self._validate_options()
        if continued:
            self._validate_continued(name, continued)
        if is_padding and syntax.size is None:
            self._wrong(self._node.value_place("type"), "padding needs its number of bits; add `size: 2`")
        if not self._good:
            return None
        bits = 1 if self._type.kind == FieldKind.BOOL else self._type.width
        bits = (syntax.size or 0) if is_padding else bits
        field = Field(**self._common(name), size=0, bits=bits + continued, own_bits=bits if continued else 0)
        is_constant = syntax.constant is not None or syntax.must_be_zero
        return self._constant(field) if is_constant else self._validated(field)

    def _validate_continued(self, name: str, continued: int) -> None:
        assert isinstance(self._syntax, BitFieldSyntax)
        if not self._type.is_integer or self._syntax.constant is not None:
            sentence = f"`{name}` is not a whole number of its own, so nothing continues it; take `u4`"
            self._wrong(self._node.value_place("type"), sentence)
            return
        most = most_bits(self._type.coding)
        total = self._type.width + continued
        if total > most:
            self._wrong(self._node.value_place("type"), f"`{name}` has {total} bits in all; it can have {most} at most")


def _capacity(field: Field, wire_type: WireType) -> str:
    lowest, highest = value_limits(field)
    scaled = f" with scale {number_text(field.scale)}" if field.scale != 1 else ""
    scaled += f" and offset {number_text(field.offset)}" if field.offset != 0 else ""
    return f"{wire_type.word}{scaled} carries {number_text(lowest)} to {number_text(highest)}"
