"""Polynomials over GF(2), as the bits of an integer: bit n is the coefficient of x^n."""

from __future__ import annotations

from collections.abc import Iterator

_MOST_EXTRA = 8  # degrees by which a number may be larger than the divisors that are looked for


def remainder(number: int, divisor: int) -> int:
    """Return the remainder of a division."""
    size = divisor.bit_length()
    while (over := number.bit_length() - size) >= 0:
        number ^= divisor << over
    return number


def quotient(number: int, divisor: int) -> int:
    """Return the whole part of a division."""
    size, whole = divisor.bit_length(), 0
    while (over := number.bit_length() - size) >= 0:
        number ^= divisor << over
        whole |= 1 << over
    return whole


def product(number: int, sparse: int) -> int:
    """Multiply. ``sparse`` has few terms."""
    found = 0
    while sparse:
        term = sparse.bit_length() - 1
        found ^= number << term
        sparse ^= 1 << term
    return found


def common_divisor(one: int, other: int) -> int:
    """Return the greatest, by Euclid's algorithm."""
    while other:
        one, other = other, remainder(one, other)
    return one


def divisors_of_degree(number: int, degree: int) -> Iterator[int]:
    """Yield divisors with a constant term, of a number whose degree is not much larger."""
    while number and not number & 1:
        number >>= 1
    extra = number.bit_length() - 1 - degree
    if 0 <= extra <= _MOST_EXTRA:
        for factor in range(1 << extra, 2 << extra):
            if not remainder(number, factor):
                yield quotient(number, factor)
