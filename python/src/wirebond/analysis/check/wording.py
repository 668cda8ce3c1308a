"""Formats numbers for findings and figures."""

from __future__ import annotations

_UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "us"))


def count(number: float) -> str:
    """Write a number without decimals in groups of three: `181 818`."""
    return f"{number:,.0f}".replace(",", " ")


def percent(share: float) -> str:
    """Write a share with at most three digits, never rounded to nothing: `72.6 %`, `0.0015 %`."""
    value = 100 * share
    if value == 0:
        return "0 %"
    if value >= 99.95:
        return f"{value:.1f} %" if value % 100 else f"{value:.0f} %"
    if value >= 1:
        return f"{value:.1f} %"
    return f"{value:.2g} %" if value >= 1e-4 else f"{value:.1e} %"


def seconds(value: float) -> str:
    """Write a duration: `1.3 ms`, `200 us`, `2 s`."""
    unit, name = next(((u, n) for u, n in _UNITS if value >= u), _UNITS[-1])
    return f"{float(f'{value / unit:.3g}'):g} {name}"


def rate(per_second: float) -> str:
    """Write a rate: `3 992/s`, `0.5/s`."""
    return f"{count(per_second)}/s" if per_second >= 10 else f"{per_second:.2g}/s"


def direction(sender: str) -> str:
    return "host to MCU" if sender == "host" else "MCU to host"


def plural(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
