"""Log lines of the MCU on their way to the program: what a handler gets, and how many a second `logging` gets."""

from __future__ import annotations

import logging
from dataclasses import dataclass

from wirebond.arguments import shown
from wirebond.codec import Codec, Message
from wirebond.errors import UsageError
from wirebond.protocol.log import LEVELS, LogLine
from wirebond.visible import visible

MOST_A_SECOND = 100  # lines that are given to `logging`; the rest is counted

_lines = logging.getLogger("wirebond.log")  # lines of the MCU
_NUMBERS = {"debug": logging.DEBUG, "info": logging.INFO, "warning": logging.WARNING, "error": logging.ERROR}


@dataclass(frozen=True)
class LogEvent:
    """A log line of the MCU. As ``str`` it is one line that is safe to print.

    :ivar line: its ``level`` and ``text``.
    :ivar message: the message that said it, with its time ``t`` and its header.
    """

    line: LogLine
    message: Message

    def __str__(self) -> str:
        return str(self.line)


def log_names(codec: Codec) -> list[str]:
    """Return the messages that are log lines."""
    service = codec.model.service("log")
    of_service = None if service is None else service.message("message")
    return [m.name for m in codec.model.messages if m.log is not None or m.name == of_service]


def least_number(level: str) -> int:
    """Return the number of `logging` for a level.

    :raises UsageError: there is no such level.
    """
    if level not in _NUMBERS:
        raise UsageError(f"level is {shown(level)}; expected {', '.join(LEVELS)}")
    return _NUMBERS[level]


def number_of(line: LogLine) -> int:
    """Return the number for `logging`; a level that only the MCU knows is info."""
    return _NUMBERS.get(line.level, logging.INFO)


def safe_text(line: LogLine) -> str:
    """Return the text on one line, without what could command a terminal."""
    return visible(line.text)


def say_line(place: str, codec: Codec, message: Message) -> None:
    """Give it to `logging`, where it is a log line."""
    line = codec.log_line(message)
    if line is not None:
        _lines.log(number_of(line), "%s: %s", place, safe_text(line))


def say_missed(place: str, missed: int) -> None:
    """Do the same for lines that did not pass a `LineLimit`."""
    if missed:
        _lines.warning("%s: %d more log lines came within a second; they are not shown here", place, missed)


class LineLimit:
    """Limits the lines per second. One thread at a time.

    :param most: lines that pass within a second.
    """

    def __init__(self, most: int = MOST_A_SECOND) -> None:
        self._most = most
        self._began = float("-inf")  # of this second
        self._passed = 0
        self._missed = 0

    def passes(self, t: float) -> bool:
        """Return whether a line of this time passes. One that does not is counted."""
        if t - self._began >= 1.0:
            self._began, self._passed = t, 0
        self._passed += 1
        if self._passed <= self._most:
            return True
        self._missed += 1
        return False

    @property
    def due(self) -> float:
        """Return when missed lines are due to be reported."""
        return self._began + 1.0 if self._missed else float("inf")

    def take_missed(self, t: float) -> int:
        """Return how many did not pass, once their second is over."""
        if self._missed == 0 or t - self._began < 1.0:
            return 0
        missed, self._missed = self._missed, 0
        return missed
