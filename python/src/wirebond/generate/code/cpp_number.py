"""C++ literals and the arithmetic between SI values and wire numbers, as text. It knows fields, not messages."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

from wirebond.protocol.model import F32, F64, UNSIGNED, Coding, Field

_DIGITS = {one.cpp: one.digits for one in (F32, F64)}  # binary digits of the C++ types


def nearest_float(value: float) -> float:
    """Return ``value`` as a C++ float holds it; infinite if it is too large."""
    rounded = F32.rounded(value)
    return math.copysign(math.inf, value) if rounded is None else rounded


def real(value: Fraction | float, type_name: str) -> str:
    """Return the shortest literal that reads back as the nearest float or double."""
    number = float(value)
    if type_name == "double":
        text = repr(number)
    else:
        wanted = nearest_float(number)
        shortest = (f"{wanted:.{digits}g}" for digits in range(1, 10))
        text = repr(float(next(t for t in shortest if nearest_float(float(t)) == wanted)))
    return text + ("" if type_name == "double" else "F")


def integer(value: int) -> str:
    """Return an integer literal; what is wider than 32 bits says so."""
    if value == -(2**63):
        return "(-9223372036854775807LL - 1)"
    if value == -(2**31):
        return "(-2147483647 - 1)"
    if value >= 2**63 or (value >= 2**31 and value < 2**32):
        return f"{value}U" if value < 2**32 else f"{value}ULL"
    return str(value) if -(2**31) < value < 2**31 else f"{value}LL"


@dataclass(frozen=True)
class WireInteger:
    """The integer type that holds a field's wire value."""

    bits: int  # on the wire
    coding: Coding

    @property
    def type_name(self) -> str:
        bits = next(b for b in (8, 16, 32, 64) if b >= self.bits)
        return f"std::{'int' if self.coding.is_signed else 'uint'}{bits}_t"

    @property
    def low(self) -> int:
        return self.coding.limits(self.bits)[0]

    @property
    def high(self) -> int:
        """The greatest number that can be read."""
        return self.coding.limits(self.bits)[1] + bool(self.coding.gaps)

    @property
    def is_whole(self) -> bool:
        """Does every value of the type fit on the wire?"""
        return self.bits in (8, 16, 32, 64) and self.coding.cpp == UNSIGNED.cpp


def wire_integer(field: Field) -> WireInteger:
    return WireInteger(field.width, field.coding)


def real_type(field: Field) -> str:
    """Return the SI type of a float or a scaled integer: a float where it brings every wire value back as it was."""
    if field.is_float:
        return field.float_format.cpp
    return "float" if _survives_float(field) else "double"


def _survives_float(field: Field) -> bool:
    """Check whether a wire number survives the conversion to a float and back."""
    greatest = (1 << field.width) * abs(field.scale) + abs(field.offset)
    if abs(field.scale) < F32.least_normal or greatest > F32.greatest:
        return False
    return field.lost_digits(F32.digits) < abs(field.scale) / 2


@dataclass(frozen=True)
class Scaling:
    """``value = (wire * numerator + shift) / denominator`` in integers, where these are small enough to be exact.

    One division of exact numbers rounds once, so 300 with a scale of 0.001 becomes the very float that 0.3F is.
    """

    field: Field
    type_name: str

    @property
    def is_exact(self) -> bool:
        if self.field.is_float:
            return False
        numerator, shift, denominator = self.field.common_factors
        wire = wire_integer(self.field)
        limit = 2 ** _DIGITS[self.type_name]
        ends = [abs(wire.low * numerator + shift), abs(wire.high * numerator + shift), denominator]
        return all(end <= limit for end in ends)

    @property
    def _integer_type(self) -> str:
        """The type that has room for each step of the exact arithmetic; empty where there is none to do. Never `int`:
        it has 16 bits on some processors."""
        numerator, shift, _ = self.field.common_factors
        if (numerator, shift) == (1, 0):
            return ""
        wire = wire_integer(self.field)
        products = [wire.low * numerator, wire.high * numerator]
        steps = [numerator, shift, wire.low, wire.high, *products, *(product + shift for product in products)]
        return "std::int32_t" if max(abs(step) for step in steps) < 2**31 else "std::int64_t"

    def from_wire(self, wire: str) -> str:
        """Return the SI value of the wire number that the expression ``wire`` yields. An integer's zero has no sign."""
        if not self.is_exact:
            scale = self.field.scale
            if scale < 0 and not self.field.offset and not self.field.is_float:
                return f"0.0{self._suffix} - static_cast<{self.type_name}>({wire}) * {real(-scale, self.type_name)}"
            text = f"static_cast<{self.type_name}>({wire}) * {real(scale, self.type_name)}"
            if self.field.offset:
                text += f" + {real(self.field.offset, self.type_name)}"
            return text
        numerator, shift, denominator = self.field.common_factors
        wide = self._integer_type
        text = wire if wide in ("", wire_integer(self.field).type_name) else f"static_cast<{wide}>({wire})"
        if numerator != 1:
            text += f" * {integer(numerator)}"
        if shift:
            text += f" {'+' if shift > 0 else '-'} {integer(abs(shift))}"
        text = f"static_cast<{self.type_name}>({text})"
        return text if denominator == 1 else f"{text} / {real(denominator, self.type_name)}"

    @property
    def _suffix(self) -> str:
        return "" if self.type_name == "double" else "F"

    def to_wire(self, value: str) -> str:
        """Return the wire number, not yet rounded, of the SI value that the expression ``value`` yields."""
        scale, offset = self.field.scale, self.field.offset
        if offset:
            value = f"({value} {'-' if offset > 0 else '+'} {real(abs(offset), self.type_name)})"
        if scale == 1:
            return value
        limit = 2 ** _DIGITS[self.type_name]
        if scale.denominator > limit or abs(scale.numerator) > limit:
            return f"{value} / {real(scale, self.type_name)}"
        if scale.denominator != 1:
            value = f"{value} * {real(scale.denominator, self.type_name)}"
        return value if scale.numerator == 1 else f"{value} / {real(scale.numerator, self.type_name)}"

    def given_limit(self, bound: float, upper: bool) -> Fraction:
        """Return the bound for values to send: what the arithmetic lost of the bound itself is not held against a
        value."""
        if self.field.is_float or self.is_exact:
            return Fraction(str(bound))
        mantissa = _DIGITS[self.type_name]
        slack = min(self.field.lost_digits(mantissa), abs(self.field.scale) / 4)
        return Fraction(str(bound)) + (slack if upper else -slack)

    def received_limit(self, bound: float, upper: bool) -> Fraction:
        """Return the bound for received values: a bound between two wire values lets the one pass that it is rounded
        to."""
        exact = Fraction(str(bound))
        scale, offset = self.field.scale, self.field.offset
        wire = (exact - offset) / scale
        if wire.denominator == 1 and self.is_exact:
            return exact
        nearest = Fraction(math.floor(abs(wire) + Fraction(1, 2))) * (1 if wire >= 0 else -1)
        slack = abs(scale) / 4 * (1 if upper else -1)
        rounded = nearest * scale + offset + slack
        return max(exact, rounded) if upper else min(exact, rounded)
