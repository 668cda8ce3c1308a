"""Numbers as options of the command line: ASCII digits, without the underscores and other scripts that Python takes."""

from __future__ import annotations

import re

import typer

_WHOLE = re.compile(r"[0-9]{1,18}")
_DECIMAL = re.compile(r"([0-9]{1,300}\.?[0-9]{0,300}|\.[0-9]{1,300})([eE][+-]?[0-9]{1,3})?")


def whole(text: str) -> int:
    """Read a whole number: 0, 1, 2, …

    :raises typer.BadParameter: it is something else.
    """
    if not _WHOLE.fullmatch(text):
        raise typer.BadParameter(f"'{text}' is not a whole number; write digits alone, such as 115200")
    return int(text)


def amount(text: str) -> float:
    """Return a number from 0 on, with or without decimals.

    :raises typer.BadParameter: it is something else.
    """
    if not _DECIMAL.fullmatch(text):
        raise typer.BadParameter(f"'{text}' is not a number from 0 on; write it as 20, 0.5 or 1e3")
    return float(text)
