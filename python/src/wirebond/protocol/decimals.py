"""Writes numbers for people: 10 and 0.00002, not 1e+01 and 2e-05."""

from __future__ import annotations

from decimal import Decimal
from math import floor, isfinite, log10

_LEAST, _MOST = 1e-5, 1e15  # numbers beyond have too many zeros to count, and get an exponent


def decimal_text(value: float, digits: int) -> str:
    """Write ``value`` with up to ``digits`` significant digits. Digits before the decimal point are never rounded."""
    if not isfinite(value) or not _LEAST <= abs(value) < _MOST:
        return f"{value:.{digits}g}"
    text = f"{value:.{max(digits, floor(log10(abs(value))) + 1)}g}"
    return format(Decimal(text), "f") if "e" in text else text
