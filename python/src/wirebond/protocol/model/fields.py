"""Fields: what a value is on the wire, and what it means."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from fractions import Fraction
from math import copysign, floor, lcm

from wirebond.protocol.model.codings import UNSIGNED, Coding
from wirebond.protocol.model.floats import FLOATS, FloatFormat


class End(StrEnum):
    """One of the two computers; the sender of a message is one, or both."""

    HOST = "host"
    MCU = "mcu"
    BOTH = "both"


class ByteOrder(StrEnum):
    LITTLE = "little"
    BIG = "big"


class BitOrder(StrEnum):
    """The order of bits in a byte or in a number."""

    LOW = "low"
    HIGH = "high"


class FieldKind(StrEnum):
    INTEGER = "integer"  # a whole number on the wire, in one of `codings`
    FLOAT = "float"
    BOOL = "bool"
    TEXT = "text"  # UTF-8
    BYTES = "bytes"
    PADDING = "padding"  # no value; sent as zeros and ignored on receive, or ``constant``
    BITS = "bits"  # a number whose bits are shared by ``fields``
    STRUCT = "struct"  # ``fields``, once or several times


NUMBERS = (FieldKind.INTEGER, FieldKind.FLOAT)
_VALUE_TYPES = {
    FieldKind.FLOAT: float,
    FieldKind.BOOL: bool,
    FieldKind.TEXT: str,
    FieldKind.BYTES: bytes,
    FieldKind.BITS: dict,
    FieldKind.STRUCT: dict,
}


@dataclass(frozen=True)
class Digits:
    """The form of an integer in characters: decimal digits with a point before the last ``decimals``, or hex digits. A
    negative number begins with `-`."""

    base: int = 10
    decimals: int = 0

    def text(self, number: int, size: int = 0) -> str:
        """Return the characters of a number, with zeros in front up to ``size`` characters."""
        digits = f"{abs(number):X}" if self.base == 16 else str(abs(number))
        sign, point = "-" * (number < 0), "." * (self.decimals > 0)
        digits = digits.rjust(max(self.decimals + 1, size - len(sign) - len(point)), "0")
        return sign + (f"{digits[: -self.decimals]}.{digits[-self.decimals :]}" if self.decimals else digits)

    def greatest(self, size: int, *, signed: bool) -> int:
        """Return the greatest number of ``size`` characters, one of which is a sign if it has one."""
        return int(self.base ** max(0, size - (self.decimals > 0) - signed) - 1)


class OnRange(StrEnum):
    """The receiver's reaction to a value outside its range."""

    REJECT = "reject"
    CLAMP = "clamp"


Default = float | int | bool | str | bytes | tuple[float | int | bool | str, ...]


@dataclass(frozen=True)
class Field:
    """A value of a message, or several.

    ``value = wire * scale + offset`` for numbers.

    How often it occurs: ``count`` elements always; or up to ``max_count`` elements, as many as ``counters`` (fields
    before it, beside it) say, or as the payload has where there are none; or once, where both are unset. A text or byte
    string has ``size`` bytes always, or up to ``max_size`` in the same two ways, or up to the byte ``ends_with``, which
    follows it on the wire and is not in it. So has a number with ``digits``, whose ``bits`` say how large it can be.
    """

    name: str
    kind: FieldKind
    size: int  # wire bytes of one element; 0 for bit fields, packed elements, structs and strings of varying size
    order: ByteOrder = ByteOrder.LITTLE
    count: int | None = None  # elements of a fixed array
    max_size: int = 0
    scale: Fraction = Fraction(1)
    offset: Fraction = Fraction(0)
    unit: str = ""
    minimum: float | None = None  # SI
    maximum: float | None = None  # SI
    on_range: OnRange = OnRange.REJECT
    default: Default | None = None  # a tuple for an array
    enum: tuple[tuple[str, int], ...] = ()
    flags: tuple[tuple[str, int], ...] = ()  # name, bit number
    description: str = ""
    bits: int = 0  # of one element, where that does not begin and end with a byte: a bit field, a packed element
    split: tuple[tuple[int, int], ...] = ()  # of a bit field: lowest bit and width of each of its pieces, lowest first
    own_bits: int = 0  # of these, those of the piece at its own place; 0: all
    coding: Coding = UNSIGNED  # of kind INTEGER
    packed: BitOrder | None = None  # elements follow each other bit by bit, from this bit of each byte on
    first: BitOrder = BitOrder.LOW  # of kind BITS: where its first field is
    fields: tuple[Field, ...] = ()  # of kinds BITS and STRUCT
    max_count: int = 0  # most elements of a list
    counted_by: str = ""  # the field with the number of elements; `state.number` for one among the bits of `state`
    counted_in_bytes: bool = False  # it counts the bytes of all elements, not the elements
    bytes_counted_by: str = ""  # the field that counts their bytes, if another one counts the elements
    asked_by: str = ""  # of a list in a reply: the field of the request that says how many elements it wants
    is_count: bool = False  # it counts others: its value follows from theirs, and is not given
    ends_with: int | None = None  # of a string: the byte after it
    excludes: tuple[bytes, ...] = ()  # of a text: delimiters of its frame, which it must not have in it
    type_name: str = ""  # of kind STRUCT: the type of the file that it is; empty for one of its own
    clock: End | None = None  # it is a time of this end's clock: when the values of its message were measured
    constant: int | None = None  # of kind PADDING: the number that its ``width`` bits must be; None: any
    digits: Digits | None = None  # of a whole number: it is sent in characters

    def without_ends(self, text: str) -> str:
        """Return the text without the bytes that no sender may write in it: its own end, and its frame's delimiters."""
        ends = b"".join(self.excludes) + (b"" if self.ends_with is None else bytes([self.ends_with]))
        return "".join(character for character in text if character.encode() not in ends)

    @property
    def constant_bytes(self) -> bytes:
        """Return the bytes of a constant that begins and ends at a byte boundary."""
        return (self.constant or 0).to_bytes(self.size, "big" if self.order == ByteOrder.BIG else "little")

    @property
    def is_scaled(self) -> bool:
        return self.scale != 1 or self.offset != 0

    @property
    def common_factors(self) -> tuple[int, int, int]:
        """``value = (wire * numerator + addend) / denominator`` in whole numbers."""
        denominator = lcm(self.scale.denominator, self.offset.denominator)
        return int(self.scale * denominator), int(self.offset * denominator), denominator

    @property
    def is_exact_in_double(self) -> bool:
        """Are all whole numbers exact in a double, between a wire number and its value?"""
        numerator, addend, denominator = self.common_factors
        largest = self._span * abs(numerator) + abs(addend)
        return not self.is_float and max(largest, denominator) <= 2**53

    @property
    def double_factors(self) -> tuple[Fraction | int, int, int, Fraction | int]:
        """``value = (wire * numerator + addend) / denominator + offset`` as doubles compute it, with one rounding where
        the whole numbers are exact in a double: then the offset is in the addend."""
        if self.is_exact_in_double:
            return *self.common_factors, 0
        numerator, denominator = self.scale.as_integer_ratio()
        if max(abs(numerator), denominator) > 2**53:
            return self.scale, 0, 1, self.offset
        return numerator, 0, denominator, self.offset

    def lost_digits(self, mantissa: int) -> Fraction:
        """Return the most that a scaled integer's value loses, there and back, in floats of this many bits where the
        whole numbers are not exact.

        Each operation and each constant is off by half a unit in the last place at most (IEEE 754, round to nearest):
        there are five of the value's size on the way, and three of the offset's.
        """
        span = self._span * abs(self.scale)
        return (5 * span + 3 * abs(self.offset)) / (1 << mantissa)

    @property
    def double_slack(self) -> Fraction | int:
        """Return how far a double may exceed a bound and still count as the bound itself."""
        return 0 if self.is_float or self.is_exact_in_double else self.lost_digits(53)

    @property
    def width(self) -> int:
        """Bits of one element."""
        return self.bits or 8 * self.size

    @property
    def _span(self) -> int:
        """More than the difference of any two whole numbers on the wire."""
        least, greatest = self.coding.limits(self.width)
        return greatest - least + 1

    @property
    def has_value(self) -> bool:
        """Has it a value that programs see? Padding and constants have none."""
        return self.kind != FieldKind.PADDING

    @property
    def value_type(self) -> type | None:
        """The Python type of its value, or of one element: a dict for a group and for bits, None where it has no value.

        An int may be shown as a name of ``enum`` or a list of ``flags``.
        """
        if self.kind == FieldKind.INTEGER:
            return float if self.is_scaled else int
        return _VALUE_TYPES.get(self.kind)

    @property
    def is_number(self) -> bool:
        return self.kind in NUMBERS

    @property
    def is_integer(self) -> bool:
        """Is it a whole number on the wire?"""
        return self.kind == FieldKind.INTEGER

    @property
    def is_unsigned(self) -> bool:
        """Is it a plain binary number without a sign?"""
        return self.is_integer and self.coding == UNSIGNED

    @property
    def is_float(self) -> bool:
        return self.kind == FieldKind.FLOAT

    @property
    def float_format(self) -> FloatFormat:
        """Return the format of a float."""
        return next(one for one in FLOATS if one.size == self.size)

    @property
    def accepted_limits(self) -> tuple[float, float] | None:
        """Least and greatest value that breaks no rule, where it has a range. A bound that a float does not hold
        arrives as the next float, which may be beyond it: 0.3 in 32 bits as 0.30000001. An MCU that scales a float
        loses some units in its last place besides."""
        if self.minimum is None or self.maximum is None or not self.is_float:
            return None if self.minimum is None or self.maximum is None else (self.minimum, self.maximum)
        of = self.float_format
        carried = []
        for bound in (self.minimum, self.maximum):
            slack = 0.0
            if self.is_scaled:
                lost = (5 * abs(Fraction(bound)) + 8 * abs(self.offset)) / (1 << of.digits)
                slack = float(lost + of.smallest * abs(self.scale))
            rounded = of.rounded(bound)
            carried += [bound - slack, bound + slack, bound if rounded is None else rounded]
        return min(carried), max(carried)

    def shortest(self, value: float) -> float:
        """Return the value with the fewest decimal digits that is the same float; that of another field itself."""
        return self.float_format.shortest(value) if self.is_float else value

    def wire_bits(self, value: float | int | str) -> int:
        """Return the bits on the wire of one integer's value, at the bottom. The value fits: see ``field_values``.

        A scaled value becomes a whole number as in the engine: with the same doubles, halves away from zero.
        """
        return self.coding.bits_of(self.wire_number(value), self.width)

    def wire_number(self, value: float | int | str) -> int:
        """Return the whole number on the wire of one integer's value. The value fits: see ``field_values``."""
        if isinstance(value, str):
            return dict(self.enum)[value]
        if not self.is_scaled:
            return int(value)
        numerator, addend, denominator, offset = (float(factor) for factor in self.double_factors)
        wire = ((value - offset) * denominator - addend) / numerator
        return int(copysign(floor(abs(wire) + 0.5), wire))

    @property
    def bits_here(self) -> int:
        """Bits that it takes among the others of a number, at its own place."""
        return self.own_bits or self.width

    @property
    def is_string(self) -> bool:
        return self.kind in (FieldKind.TEXT, FieldKind.BYTES)

    @property
    def is_characters(self) -> bool:
        """Is it a string on the wire: a text, a byte string, or a number in characters?"""
        return self.is_string or self.digits is not None

    @property
    def whole_limits(self) -> tuple[int, int]:
        """Least and greatest whole number of an integer on the wire."""
        least, greatest = self.coding.limits(self.width)
        if self.digits is None:
            return least, greatest
        fits = [self.digits.greatest(self.room, signed=signed) for signed in (True, False)]
        return max(least, -fits[0]), min(greatest, fits[1])

    @property
    def room(self) -> int:
        """Most bytes of a string's value."""
        return self.size or self.max_size

    @property
    def is_list(self) -> bool:
        """Has it a varying number of elements?"""
        return self.max_count > 0

    @property
    def is_variable(self) -> bool:
        """Does its size on the wire vary?"""
        return self.is_list or (self.is_characters and self.size == 0) or any(f.is_variable for f in self.fields)

    @property
    def reaches_end(self) -> bool:
        """Is it as long as the payload is?"""
        open_ended = self.is_list or (self.is_characters and self.size == 0 and self.ends_with is None)
        return (open_ended and not self.counted_by) or any(f.reaches_end for f in self.fields)

    @property
    def only_counts(self) -> bool:
        """Are these bits of which each counts others, or pads? Generated structs have no member for them."""
        bits = self.fields if self.kind == FieldKind.BITS else ()
        return any(one.is_count for one in bits) and all(one.is_count or one.kind == FieldKind.PADDING for one in bits)

    @property
    def counters(self) -> tuple[tuple[str, int], ...]:
        """The fields that count it, each with its number for one element or byte. The first one counts the elements;
        another one agrees with it."""
        step = 1 if self.is_string else self.element_min_bytes
        first = ((self.counted_by, step if self.counted_in_bytes else 1),) if self.counted_by else ()
        return (*first, (self.bytes_counted_by, step)) if self.bytes_counted_by else first

    @property
    def element_min_bytes(self) -> int:
        """Minimum wire bytes of one element; of a bit field, which is in a number's bytes, 0."""
        return sum(f.min_wire_bytes for f in self.fields) if self.kind == FieldKind.STRUCT else self.size

    @property
    def min_wire_bytes(self) -> int:
        if self.packed is not None:
            return (self.bits * (self.count or 1) + 7) // 8
        if self.ends_with is not None:
            return 1
        return 0 if self.is_list else self.element_min_bytes * (self.count or 1)

    @property
    def max_wire_bytes(self) -> int:
        if self.is_characters and self.size == 0:
            return self.max_size + (self.ends_with is not None)
        if self.kind == FieldKind.STRUCT:
            return sum(f.max_wire_bytes for f in self.fields) * (self.max_count or self.count or 1)
        return self.size * self.max_count if self.is_list else self.min_wire_bytes
