"""An observation of an unknown check: the covered bytes, and the value."""

from __future__ import annotations

from typing import Literal, NamedTuple

Order = Literal["little", "big"]
LEAST_SAMPLES = 4  # that differ


class Sample(NamedTuple):
    """A frame's covered bytes and the number where their check is."""

    covered: bytes
    value: int


def words(data: bytes, unit: int, order: Order) -> list[int]:
    """Return the whole words of ``unit`` bytes."""
    if unit == 1:
        return list(data)
    return [int.from_bytes(data[at : at + unit], order) for at in range(0, len(data) - unit + 1, unit)]


def tail(data: bytes, unit: int) -> bytes:
    """Return the bytes after the last whole word."""
    return data[len(data) - len(data) % unit :]


def reflected(number: int, width: int) -> int:
    """Return the bits in the other order."""
    return int(f"{number:0{width}b}"[::-1], 2)
