"""The exceptions that callers of the package may catch. Each carries its facts; its text is for a person."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from wirebond.visible import visible


class WirebondError(Exception):
    """Base of every error that Wirebond raises on purpose. Its text is safe to print: what a device, a file's name or a
    file has put into it cannot command a terminal.
    """

    def __str__(self) -> str:
        return visible(str(self.args[0]) if self.args else "", keep="\n")


@dataclass(frozen=True, order=True)
class Problem:
    """One thing wrong in a protocol file.

    ``line`` and ``column`` count from 1, in characters; both are 0 where the file as a whole is meant.
    ``sentence`` says what is wrong and what would be right.
    """

    path: str
    line: int
    column: int
    sentence: str

    def __str__(self) -> str:
        place = f"{self.path}:{self.line}:{self.column}" if self.line else self.path
        return visible(f"{place}: {self.sentence}")


class ProtocolFileError(WirebondError):
    """A protocol file cannot be used. ``problems`` holds every reason, sorted by place, at least one."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems: tuple[Problem, ...] = tuple(sorted(set(problems)))
        super().__init__("\n".join(str(problem) for problem in self.problems))

    def __reduce__(self) -> tuple[type[ProtocolFileError], tuple[tuple[Problem, ...]]]:
        return type(self), (self.problems,)  # else a copy would be made from the text alone


class HeaderFileError(WirebondError):
    """A C header cannot be imported. ``problems`` holds the reasons, at least one."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems: tuple[Problem, ...] = tuple(problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))

    def __reduce__(self) -> tuple[type[HeaderFileError], tuple[tuple[Problem, ...]]]:
        return type(self), (self.problems,)


class ProtocolMismatchError(WirebondError):
    """Two that must have the same protocol have not: a generated module and the protocol file that it names."""


class EngineError(WirebondError, ImportError):
    """The compiled engine is missing, or was built from another version of the Python code."""


class UsageError(WirebondError, ValueError):
    """The program asked for something that the protocol or the call does not have."""


class MessageError(WirebondError, ValueError):
    """A message cannot be encoded: no such message or field, or a value refused. Nothing was sent."""


class PortError(WirebondError, OSError):
    """A port cannot be opened.

    ``errno`` is the system's error number (``errno.ENOENT``, ``errno.EACCES``, ``errno.EBUSY``, …), or None where the
    system had nothing against it; ``filename`` is the port.
    """

    def __init__(self, text: str, code: int | None = None, port: str | None = None) -> None:
        super().__init__(text)
        self.errno = code
        self.strerror = text
        self.filename = port


class LinkDownError(WirebondError, ConnectionError):
    """The port is not connected at the moment, or the program has closed the link; nothing was sent. A link that is
    not closed reconnects by itself."""


class QueueFullError(WirebondError):
    """The line does not keep up with what is sent; this frame was refused."""


class RequestTimeoutError(WirebondError, TimeoutError):
    """No reply to a request came in time. ``message`` is the request, ``reply`` the expected reply, ``timeout`` the
    time in seconds."""

    def __init__(self, text: str, message: str, reply: str, timeout: float) -> None:
        super().__init__(text)
        self.message = message
        self.reply = reply
        self.timeout = timeout

    def __reduce__(self) -> tuple[type[RequestTimeoutError], tuple[str, str, str, float]]:
        return type(self), (str(self.args[0]), self.message, self.reply, self.timeout)


class NotInControlError(WirebondError):
    """Another program is in control of the robot, or this one has lost control; nothing was sent. ``take_control()``
    of the link takes it."""


class StoppedByOtherError(WirebondError):
    """Another program stopped the robot, or the server was restarted since; the stop still holds.
    ``release_stop(over=True)`` releases it nevertheless. ``by`` is the name of the program that stopped."""

    def __init__(self, text: str, by: str = "") -> None:
        super().__init__(text)
        self.by = by

    def __reduce__(self) -> tuple[type[StoppedByOtherError], tuple[str, str]]:
        return type(self), (str(self.args[0]), self.by)


class LateCommandError(WirebondError):
    """The command reached the server so late that it may not be meant any more; nothing was sent."""


class ParameterError(WirebondError, ValueError):
    """A parameter of the MCU could not be read or set.

    ``parameter`` is its name or index. ``reason`` is ``no_such_name``, ``no_such_index``, ``out_of_range``,
    ``wrong_index``, or what else the MCU answered. ``value`` is what stays in force, or None. ``refused`` has a
    sentence for each refused parameter of several.
    """

    def __init__(
        self,
        text: str,
        *,
        parameter: str = "",
        reason: str = "",
        value: float | None = None,
        refused: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(text)
        self.parameter = parameter
        self.reason = reason
        self.value = value
        self.refused: dict[str, str] = dict(refused or {})

    def __reduce__(self) -> tuple[object, ...]:
        return _parameter_error, (str(self.args[0]), self.parameter, self.reason, self.value, self.refused)


def _parameter_error(
    text: str, parameter: str, reason: str, value: float | None, refused: dict[str, str]
) -> ParameterError:
    return ParameterError(text, parameter=parameter, reason=reason, value=value, refused=refused)


class StoppedError(WirebondError):
    """An emergency stop holds this message until ``release_stop()``; nothing was sent.

    ``message`` is its name; ``stopped`` names every message that the stop holds.
    """

    def __init__(self, message: str, stopped: Iterable[str]) -> None:
        self.message = message
        self.stopped: tuple[str, ...] = tuple(stopped)
        super().__init__(
            f"{message} was not sent: an emergency stop holds {', '.join(self.stopped)} until release_stop() is called"
        )

    def __reduce__(self) -> tuple[type[StoppedError], tuple[str, tuple[str, ...]]]:
        return type(self), (self.message, self.stopped)  # else a copy would be made from the text alone
