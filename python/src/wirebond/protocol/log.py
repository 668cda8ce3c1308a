"""Log lines: a message that says one becomes its text, with the values in the places that the file gives them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from math import isfinite
from typing import Any

from wirebond.protocol.decimals import decimal_text
from wirebond.protocol.meaning.field_values import number_text
from wirebond.protocol.meaning.log_text import Shown, log_pieces
from wirebond.protocol.model import Field, LogLevel, Message, Protocol
from wirebond.visible import visible

LEVELS = tuple(level.value for level in LogLevel)  # by the number that the log service has on the wire


@dataclass(frozen=True)
class LogLine:
    """The log text of a message. As ``str`` it is one line that is safe to print.

    :ivar level: debug, info, warning or error; where a log service sends another, what it sent.
    :ivar text: as the file gives it, or as the device sent it: it may hold any character.
    """

    level: str
    text: str

    def __str__(self) -> str:
        return visible(f"{self.level}: {self.text}")


def log_line(protocol: Protocol, message: Message, values: Mapping[str, Any]) -> LogLine | None:
    """Return the line that ``message`` with these values says; None where it is not a log line.

    Its text is the file's (``log:``), or came with the message (the log service).
    """
    if message.log is not None:
        return LogLine(message.log_level, _text(message, values))
    if any(
        service.name == "log" and dict(service.messages)["message"] == message.name for service in protocol.services
    ):
        return LogLine(_level(values.get("level")), str(values.get("text", "")))
    return None


def _level(value: object) -> str:
    """Return the level of the log service: a number, or the file's name for it."""
    if isinstance(value, int):
        return LEVELS[value] if value < len(LEVELS) else f"level {value}"
    return str(value)


def _text(message: Message, values: Mapping[str, Any]) -> str:
    fields = {field.name: field for field in message.fields}
    shown = []
    for piece in _pieces(message.log or ""):
        if isinstance(piece, Shown):
            shown.append(_shown(fields[piece.field], values[piece.field]) if piece.field in values else "?")
        else:
            shown.append(piece)
    return "".join(shown)


@lru_cache(maxsize=1024)
def _pieces(text: str) -> tuple[str | Shown, ...]:
    return log_pieces(text)


def _shown(field: Field, value: Any) -> str:
    if isinstance(value, dict):
        members = {member.name: member for member in field.fields}
        return ", ".join(f"{name} {_shown(members[name], one)}" for name, one in value.items())
    if isinstance(value, list):
        return ", ".join(_shown(field, one) for one in value) or "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return _number(field, value)
    return value.hex(" ").upper() if isinstance(value, bytes) else str(value)


def _number(field: Field, value: float) -> str:
    """Write a number with as many decimals as the wire carries; a float with six digits."""
    if field.is_float or not isfinite(value):
        return decimal_text(value, 6)
    digits = max(_decimals(number_text(field.scale)), _decimals(number_text(field.offset)))
    return f"{value:.{digits}f}"


def _decimals(number: str) -> int:
    return len(number.partition(".")[2]) if "e" not in number else 9
