"""Codings: how the bits of a whole number mean it, such as two's complement or decimal digits.

Each is one entry of `CODINGS`, and a class where it has a rule of its own. Beside that entry, a new coding needs its
types in `text/field_types.py`, and its conversion in C++ in `core/include/wirebond/bits.hpp`.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Coding:
    """Plain binary numbers without a sign; the base of all others.

    :ivar name: its name in the engine.
    :ivar letters: how its types begin in a protocol file: `u` of `u16`.
    :ivar cpp: its enumerator of `wirebond::Coding` in C++.
    :ivar is_signed: it has negative numbers.
    :ivar is_binary: numbers from 0 on have the bits that they have in plain binary.
    :ivar gaps: why some bits mean no number, as the end of a sentence; empty if all mean one. A receiver reads such
        bits as the number after the greatest one.
    """

    name: str
    letters: str
    cpp: str = "binary"
    is_signed: bool = False
    is_binary: bool = True
    gaps: str = ""

    def limits(self, width: int) -> tuple[int, int]:
        """Return the least and the greatest number of ``width`` bits."""
        return 0, (1 << width) - 1

    def bits_of(self, number: int, width: int) -> int:
        """Return the bits of a number within `limits`."""
        return number & ((1 << width) - 1)

    def number_of(self, bits: int, width: int) -> int | None:  # noqa: ARG002  (others need the width)
        """Return the number that these bits mean; None: none."""
        return bits


class _TwosComplement(Coding):
    def limits(self, width: int) -> tuple[int, int]:
        return -(1 << width - 1), (1 << width - 1) - 1

    def number_of(self, bits: int, width: int) -> int:
        return bits - (1 << width) if bits >> width - 1 else bits


class _SignMagnitude(Coding):
    def limits(self, width: int) -> tuple[int, int]:
        greatest = (1 << width - 1) - 1
        return -greatest, greatest

    def bits_of(self, number: int, width: int) -> int:
        return 1 << width - 1 | -number if number < 0 else number

    def number_of(self, bits: int, width: int) -> int:
        magnitude = bits & ((1 << width - 1) - 1)
        return -magnitude if bits >> width - 1 else magnitude


class _DecimalDigits(Coding):
    def limits(self, width: int) -> tuple[int, int]:
        return 0, int(10 ** (width // 4)) - 1

    def bits_of(self, number: int, width: int) -> int:  # noqa: ARG002  (others need the width)
        return int(str(number), 16)

    def number_of(self, bits: int, width: int) -> int | None:
        digits = f"{bits:0{width // 4}x}"
        return int(digits) if digits.isdecimal() else None


UNSIGNED = Coding("unsigned", "u")
TWOS_COMPLEMENT = _TwosComplement("signed", "i", is_signed=True)
SIGN_MAGNITUDE = _SignMagnitude("sign_magnitude", "s", "sign_magnitude", is_signed=True)
BCD = _DecimalDigits("bcd", "bcd", "bcd", is_binary=False, gaps="which has other digits than 0 to 9")

CODINGS = (UNSIGNED, TWOS_COMPLEMENT, SIGN_MAGNITUDE, BCD)
