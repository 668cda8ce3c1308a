"""Arguments that a program gives: shown in a sentence, and numbers checked. A wrong one is a `UsageError`."""

from __future__ import annotations

import numbers
import operator
import os
import re

from wirebond.errors import UsageError

_MOST_DIGITS = 100  # of an integer that is shown; Python itself refuses to write more than 4 300
_BITS_OF_MOST_DIGITS = 332


def shown(value: object, length: int = 80) -> str:
    """Return ``repr`` of any value, shortened. It never raises: Python writes no integer of more than 4 300 digits."""
    if isinstance(value, int) and not isinstance(value, bool) and value.bit_length() > _BITS_OF_MOST_DIGITS:
        return f"{'a negative' if value < 0 else 'an'} integer of more than {_MOST_DIGITS - 1} digits"
    try:
        text = repr(value)
    except Exception:  # a list with such an integer in it, or a class whose __repr__ fails
        return f"a value of the type {type(value).__name__} that cannot be shown"
    return text if len(text) <= length else f"{text[: length - 3]}..."


def path(name: str, value: str | os.PathLike[str], expected: str) -> str | os.PathLike[str]:
    """Return a path, or a name that is written as one.

    :raises UsageError: it is something else.
    """
    if isinstance(value, str | bytes | os.PathLike):
        return value
    raise UsageError(f"{name} is {shown(value)}; expected {expected}")


def real(name: str, value: object, expected: str) -> float:
    """Return a number of any kind that Python and numpy have.

    :param name: of the argument.
    :param expected: what it should be, for the sentence.
    :raises UsageError: it is not a number, or one that no float holds.
    """
    if isinstance(value, numbers.Real) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError:
            pass
    raise UsageError(f"{name} is {shown(value)}; expected {expected}")


def whole(name: str, value: object, least: int, greatest: int, unit: str) -> int:
    """Return a whole number within bounds.

    :raises UsageError: it is not one, or out of its bounds.
    """
    try:
        number = None if isinstance(value, bool) else operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        number = None
    if number is None or not least <= number <= greatest:
        raise UsageError(f"{name} is {shown(value)}; expected a whole number from {least} to {greatest} {unit}")
    return number


def hex_bytes(text: str) -> bytes:
    """Read hex digits in any usual notation: ``AA 55 01``, ``aa5501``, ``0xAA,0x55``, ``AA:55``.

    :raises UsageError: it has something else in it, or half a byte.
    """
    digits = re.sub(r"0[xX]|[\s:,;_-]", "", text)
    wrong = re.search(r"[^0-9a-fA-F]", digits)
    if wrong:
        raise UsageError(f"'{wrong.group()}' is not a hex digit; write bytes as AA 55 01 or aa5501")
    if len(digits) % 2:
        raise UsageError(f"{len(digits)} hex digits do not make whole bytes; write two digits per byte")
    return bytes.fromhex(digits)
