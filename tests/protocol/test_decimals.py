"""Numbers for people."""

from __future__ import annotations

import math

import pytest

from wirebond.cli.shown import values_text
from wirebond.protocol.decimals import decimal_text


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (10.0, 1, "10"),
        (-10.0, 1, "-10"),
        (0.0, 4, "0"),
        (12345.678, 4, "12346"),
        (1e6, 6, "1000000"),
        (9.9999, 4, "10"),
        (0.00002, 6, "0.00002"),
        (0.1, 10, "0.1"),
        (1e20, 4, "1e+20"),
        (1e-9, 4, "1e-09"),
        (math.inf, 4, "inf"),
        (math.nan, 4, "nan"),
    ],
)
def test_numbers_have_an_exponent_only_where_the_zeros_cannot_be_counted(value: float, digits: int, text: str) -> None:
    assert decimal_text(value, digits) == text


def test_values_in_a_line_are_not_rounded_before_the_decimal_point() -> None:
    assert values_text({"rpm": 12345.6, "gain": 0.00002}) == "rpm 12346  gain 0.00002"
