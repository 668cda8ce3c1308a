"""One field of a message: from its syntax to the model, and whether a value fits it."""

from __future__ import annotations

import math
import sys
from fractions import Fraction

from wirebond.protocol.document import Mapping
from wirebond.protocol.grammar import FieldSyntax
from wirebond.protocol.model import ByteOrder, Field, FieldKind, OnRange
from wirebond.protocol.problems import Place, Problems, quoted, suggestion

_NUMBERS = (FieldKind.UNSIGNED, FieldKind.SIGNED, FieldKind.FLOAT)
_INTEGERS = (FieldKind.UNSIGNED, FieldKind.SIGNED)
_STRINGS = (FieldKind.TEXT, FieldKind.BYTES)
_F32_MAX = Fraction(2**24 - 1) * 2**104
_F64_MAX = Fraction(sys.float_info.max)

# Which options have a meaning for which types. The others are refused rather than ignored.
_OPTIONS: tuple[tuple[str, tuple[FieldKind, ...], str], ...] = (
    ("count", (*_NUMBERS, FieldKind.BOOL), "numbers and bool; give a text its bytes with `size` or `max`"),
    ("size", _STRINGS, "text and bytes; for an array of numbers write `count`"),
    ("max", _STRINGS, "text and bytes; for an array of numbers write `count`"),
    ("scale", _NUMBERS, "numbers; remove it"),
    ("offset", _NUMBERS, "numbers; remove it"),
    ("unit", _NUMBERS, "numbers; remove it"),
    ("range", _NUMBERS, "numbers; remove it"),
    ("enum", _INTEGERS, "whole numbers; take u8, or remove it"),
    ("flags", (FieldKind.UNSIGNED,), "unsigned whole numbers; take u8, or remove it"),
)


def read_field(name: str, syntax: FieldSyntax, node: Mapping, order: ByteOrder, problems: Problems) -> Field | None:
    """The field, or None when something about it was wrong and has been reported."""
    reader = _FieldReader(syntax, node, problems)
    return reader.read(name, order)


class _FieldReader:
    def __init__(self, syntax: FieldSyntax, node: Mapping, problems: Problems) -> None:
        self._syntax = syntax
        self._node = node
        self._problems = problems
        self._good = True

    def _wrong(self, place: Place, message: str) -> None:
        self._problems.add(place, message)
        self._good = False

    def read(self, name: str, order: ByteOrder) -> Field | None:
        syntax = self._syntax
        kind = syntax.type.kind
        self._check_options(kind)
        if kind in _STRINGS and syntax.size is None and syntax.max is None:
            self._wrong(
                self._node.value_place("type"),
                f"a {syntax.type.word} field needs a size; add `size: 16` (bytes, always as many) "
                "or `max: 16` (at most)",
            )
        if syntax.size is not None and syntax.max is not None:
            self._wrong(self._node.key_place("max"), "`max` cannot stand beside `size`; keep one of the two")
        if not self._good:
            return None
        field = Field(
            name=name,
            kind=kind,
            size=syntax.size or 0 if kind in _STRINGS else syntax.type.size,
            order=syntax.type.order or order,
            count=syntax.count,
            max_size=syntax.max or 0,
            scale=Fraction(1) if syntax.scale is None else syntax.scale,
            offset=Fraction(0) if syntax.offset is None else syntax.offset,
            unit=syntax.unit or "",
            minimum=None if syntax.range is None else float(syntax.range[0]),
            maximum=None if syntax.range is None else float(syntax.range[1]),
            on_range=OnRange(syntax.on_range or "reject"),
            enum=tuple((syntax.enum or {}).items()),
            flags=tuple((syntax.flags or {}).items()),
            description=syntax.description,
        )
        self._check_scale(field)
        if self._good:
            self._check_range(field)
        self._check_enum(field)
        self._check_flags(field)
        if not self._good or syntax.default is None:
            return field if self._good else None
        return self._with_default(field, syntax.default)

    def _check_options(self, kind: FieldKind) -> None:
        syntax = self._syntax
        for option, kinds, whose in _OPTIONS:
            if getattr(syntax, option) is not None and kind not in kinds:
                self._wrong(self._node.key_place(option), f"`{option}` is for {whose}")
        for one, other in (("enum", "flags"), ("enum", "range"), ("flags", "range")):
            if getattr(syntax, one) is not None and getattr(syntax, other) is not None:
                self._wrong(self._node.key_place(other), f"`{other}` cannot stand beside `{one}`; keep one of the two")
        for names in ("enum", "flags"):
            for option in ("scale", "offset", "unit"):
                if getattr(syntax, names) is not None and getattr(syntax, option) is not None:
                    place = self._node.key_place(option)
                    self._wrong(place, f"`{option}` has no meaning for named numbers (`{names}`); remove it")
        if syntax.on_range is not None and syntax.range is None:
            self._wrong(
                self._node.key_place("on_range"),
                "`on_range` has no meaning without `range`; add `range: [0, 1]`",
            )
        if syntax.count is not None and syntax.default is not None:
            self._wrong(self._node.key_place("default"), "an array has no default; remove `default`")

    def _check_scale(self, field: Field) -> None:
        if field.scale == 0:
            self._wrong(self._node.value_place("scale"), "a scale of 0 would make every value the same; write another")
        elif field.kind in _NUMBERS and field.is_scaled:
            greatest = max(abs(bound) for bound in value_limits(field))
            if field.kind != FieldKind.FLOAT and greatest > _F64_MAX:
                self._wrong(
                    self._node.value_place("scale"),
                    "with this scale the greatest value is beyond a double; scale less",
                )

    def _check_range(self, field: Field) -> None:
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
                    place,
                    f"{number_text(bound)} does not fit: {_capacity(field, self._syntax)}; narrow the range",
                )
        if fits and field.kind in _INTEGERS:
            ends = sorted(((least - field.offset) / field.scale, (greatest - field.offset) / field.scale))
            if math.ceil(ends[0]) > math.floor(ends[1]):
                self._wrong(place, "no number on the wire has a value in this range; widen it, or take a finer scale")

    def _check_enum(self, field: Field) -> None:
        node = self._node.get("enum")
        if not field.enum or not isinstance(node, Mapping):
            return
        lowest, highest = wire_limits(field)
        by_value: dict[int, str] = {}
        for name, value in field.enum:
            if not lowest <= value <= highest:
                self._wrong(
                    node.value_place(name),
                    f"{value} does not fit {self._syntax.type.word} (from {lowest} to {highest}); take a wider type",
                )
            other = by_value.setdefault(value, name)
            if other != name:
                self._wrong(node.value_place(name), f"`{other}` is {value} already; give `{name}` a value of its own")

    def _check_flags(self, field: Field) -> None:
        node = self._node.get("flags")
        if not field.flags or not isinstance(node, Mapping):
            return
        by_bit: dict[int, str] = {}
        for name, bit in field.flags:
            if bit >= 8 * field.size:
                self._wrong(
                    node.value_place(name),
                    f"{self._syntax.type.word} has no bit {bit}; its bits are 0 to {8 * field.size - 1}",
                )
            other = by_bit.setdefault(bit, name)
            if other != name:
                self._wrong(node.value_place(name), f"`{other}` is bit {bit} already; give `{name}` a bit of its own")

    def _with_default(self, field: Field, default: Fraction | bool | str) -> Field | None:
        value, fault = fit_value(field, default)
        if fault:
            self._wrong(self._node.value_place("default"), fault)
            return None
        return Field(**{**vars(field), "default": value})


def wire_limits(field: Field) -> tuple[Fraction, Fraction]:
    """Least and greatest number on the wire."""
    bits = 8 * field.size
    if field.kind == FieldKind.UNSIGNED:
        return Fraction(0), Fraction(2**bits - 1)
    if field.kind == FieldKind.SIGNED:
        return Fraction(-(2 ** (bits - 1))), Fraction(2 ** (bits - 1) - 1)
    greatest = _F32_MAX if field.size == 4 else _F64_MAX
    return -greatest, greatest


def value_limits(field: Field) -> tuple[Fraction, Fraction]:
    """Least and greatest value in the field's unit that the wire can carry."""
    ends = sorted(bound * field.scale + field.offset for bound in wire_limits(field))
    return ends[0], ends[1]


def number_text(value: Fraction) -> str:
    return str(value.numerator) if value.denominator == 1 and abs(value) < 10**15 else f"{float(value):.10g}"


def fit_value(field: Field, value: Fraction | bool | str) -> tuple[float | int | bool | str | None, str]:
    """The value as the API takes it and an empty text, or None and what is wrong. Not for arrays."""
    if field.kind == FieldKind.BOOL:
        return (value, "") if isinstance(value, bool) else (None, f"`{field.name}` is a bool; write true or false")
    if field.kind == FieldKind.TEXT:
        if not isinstance(value, str):
            return None, f"`{field.name}` is a text; put the value in quotes"
        size, room = len(value.encode()), field.max_wire_bytes
        return (
            (value, "")
            if size <= room
            else (None, f"the text has {size} bytes, and `{field.name}` has room for {room}")
        )
    if field.kind == FieldKind.BYTES:
        return None, f"`{field.name}` is a byte string, which has no value in a protocol file; leave it out"
    if isinstance(value, str):
        names = dict(field.enum)
        if value in names:
            return value, ""
        if names:
            return None, f"{quoted(value)} is not a name of `{field.name}`; {suggestion(value, names)}"
    if isinstance(value, (bool, str)):
        shown = str(value).lower() if isinstance(value, bool) else value
        return None, f"{quoted(shown)} is not a number; `{field.name}` takes a number"
    return _fit_number(field, value)


def _fit_number(field: Field, value: Fraction) -> tuple[float | int | None, str]:
    lowest, highest = value_limits(field)
    if field.minimum is not None and field.maximum is not None:
        lowest, highest = max(lowest, Fraction(field.minimum)), min(highest, Fraction(field.maximum))
        # The bounds were decimals: what equals one as a double is inside.
        value = min(max(value, lowest), highest) if float(value) in (field.minimum, field.maximum) else value
    if not lowest <= value <= highest:
        limits = f"from {number_text(lowest)} to {number_text(highest)}"
        return None, f"{number_text(value)} does not fit `{field.name}`, which takes values {limits}"
    if field.kind in _INTEGERS and not field.is_scaled:
        if value.denominator != 1:
            return (
                None,
                f"{number_text(value)} is not a whole number, and `{field.name}` takes whole numbers; add a `scale`?",
            )
        if field.enum and int(value) not in dict(field.enum).values():
            return (
                None,
                f"{value} has no name in `{field.name}`; write one of {', '.join(name for name, _ in field.enum)}",
            )
        unnamed = int(value) & ~sum(1 << bit for _, bit in field.flags)
        if field.flags and unnamed:
            return (
                None,
                f"bit {unnamed.bit_length() - 1} of {value} has no name in `{field.name}`; name it, or leave it 0",
            )
        return int(value), ""
    return float(value), ""


def _capacity(field: Field, syntax: FieldSyntax) -> str:
    lowest, highest = value_limits(field)
    scaled = f" with scale {number_text(field.scale)}" if field.scale != 1 else ""
    scaled += f" and offset {number_text(field.offset)}" if field.offset != 0 else ""
    return f"{syntax.type.word}{scaled} carries {number_text(lowest)} to {number_text(highest)}"
