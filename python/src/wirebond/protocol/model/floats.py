"""Floats on the wire: one entry for each format of IEEE 754.

Beside its entry in `FLOATS`, a new format needs its conversion in C++ where no C++ type has it: see `float_of` in
`engine/src/element.cpp` and `is_plain` in `generate/code/cpp_field.py`.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from fractions import Fraction


@dataclass(frozen=True)
class FloatFormat:
    """:ivar size: bytes.
    :ivar code: its letter in Python's `struct`.
    :ivar digits: binary digits of its numbers.
    :ivar most: its greatest exponent: all numbers are less than 2 to this power.
    :ivar least: its least normal exponent: from 2 to this power on numbers have all digits.
    :ivar cpp: the C++ type in which an MCU computes with its values.
    """

    size: int
    code: str
    digits: int
    most: int
    least: int
    cpp: str

    @property
    def name(self) -> str:
        """Its type in a protocol file, without a byte order."""
        return f"f{8 * self.size}"

    @property
    def greatest(self) -> Fraction:
        return Fraction(2**self.digits - 1) * Fraction(2) ** (self.most - self.digits)

    @property
    def least_normal(self) -> Fraction:
        return Fraction(2) ** self.least

    @property
    def smallest(self) -> Fraction:
        """The least number above zero: the step between numbers near zero."""
        return Fraction(2) ** (self.least - self.digits + 1)

    @property
    def steps(self) -> int:
        """An MCU that scales a value loses at most 1 / `steps` of it."""
        return 1 << min(self.digits, 24) - 4

    def number_of(self, bits: int) -> float:
        """Return the number that these bits mean."""
        return float(struct.unpack(f"<{self.code}", bits.to_bytes(self.size, "little"))[0])

    def rounded(self, value: float) -> float | None:
        """Return the nearest number; None: the value is too large for one."""
        try:
            return float(struct.unpack(self.code, struct.pack(self.code, value))[0])
        except OverflowError:
            return None

    def shortest(self, value: float) -> float:
        """Return the number with the fewest decimal digits that is sent as the same bits: 0.1 for
        0.10000000149011612."""
        wanted = self.rounded(value)
        for digits in range(1, 17):
            short = float(f"{value:.{digits}g}")
            if self.rounded(short) == wanted:  # none where it was rounded up past the greatest float
                return short
        return value


F32 = FloatFormat(4, "f", 24, 128, -126, "float")
F64 = FloatFormat(8, "d", 53, 1024, -1022, "double")

FLOATS = (F32, F64)
