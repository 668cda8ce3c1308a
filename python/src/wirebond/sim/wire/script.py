"""Faults of a wire that are written down: a file with a line for each, and what the wire's process takes of it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from wirebond.errors import UsageError

_DIRECTIONS = {"a_to_b": (0,), "b_to_a": (1,)}
_BOTH = (0, 1)
_KINDS = ("flip", "drop", "insert", "split")  # in the order of ScriptedFault::Kind in sim/include/wirebond/sim/wire.hpp
_VALUES = {"flip": (1, 1, 255), "drop": (1, 1, 1_000_000), "insert": (0, 0, 255)}  # default, least, most
_MOST_SECONDS = 1e6
_EXAMPLE = "such as `2.5 unplug 0.5`, `3 a_to_b drop 10`, `3 flip 0x80`, `4 b_to_a insert 0x55` or `5 split`"


def read_script(path: Path) -> tuple[str, ...]:
    """Return the faults of this file, as words for the process.

    :raises UsageError: it cannot be read, or a line of it: the sentence names the line.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise UsageError(f"{path} cannot be read: {reason}") from None
    words: list[str] = []
    for number, line in enumerate(text.splitlines(), 1):
        given = line.partition("#")[0].split()
        if given:
            try:
                words += _arguments(given)
            except ValueError as error:
                raise UsageError(f"{path}, line {number}: {error}; expected AT [DIRECTION] FAULT [VALUE], {_EXAMPLE}") \
                    from None  # fmt: skip
    return tuple(words)


def _arguments(given: list[str]) -> Iterator[str]:
    at = _seconds(given[0], "the time")
    rest = given[1:]
    has_direction = bool(rest) and rest[0] in _DIRECTIONS
    directions = _DIRECTIONS[rest[0]] if has_direction else _BOTH
    rest = rest[1:] if has_direction else rest
    if not rest:
        raise ValueError("there is no fault")
    kind, *values = rest
    if kind == "unplug":
        if has_direction:
            raise ValueError("a cable is pulled for both directions")
        if len(values) != 1:
            raise ValueError("unplug needs a number of seconds")
        yield f"unplug:{at}:{_seconds(values[0], 'the time of unplug')}"
        return
    if kind not in _KINDS:
        raise ValueError(f"there is no fault '{kind}'; there are {', '.join(_KINDS)} and unplug")
    if len(values) > (kind in _VALUES):
        raise ValueError(f"'{values[-1]}' is one word too many")
    value = 0
    if kind in _VALUES:
        value, least, most = _VALUES[kind]
        value = _whole(values[0], least, most, kind) if values else value
    for direction in directions:
        yield f"fault:{at}:{direction}:{_KINDS.index(kind)}:{value}"


def _seconds(text: str, what: str) -> int:
    """Convert to nanoseconds."""
    try:
        seconds = float(text)
    except ValueError:
        seconds = -1.0
    if not 0 <= seconds <= _MOST_SECONDS:
        raise ValueError(f"{what} is '{text}', and 0 to {_MOST_SECONDS:g} seconds are possible")
    return round(seconds * 1e9)


def _whole(text: str, least: int, most: int, kind: str) -> int:
    try:
        value = int(text, 0)
    except ValueError:
        value = -1
    if not least <= value <= most:
        raise ValueError(f"{kind} takes {least} to {most}, not '{text}'")
    return value
