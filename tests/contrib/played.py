"""A device that Wirebond plays at the far end of a pty, for libraries that expect the real one."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, TypeVar

import wirebond
from tests.contrib.cases import CONTRIB
from tests.link.test_role_mcu import line
from tests.waiting import wait_until
from wirebond import Message

_ATTEMPTS = 100  # a library waits up to half a second for each answer; a busy computer may need more
_Result = TypeVar("_Result")

#: What answers a message: the reply's name, its values and, where they are not the defaults, its header values.
Answer = Callable[[Message], tuple[str, Mapping[str, Any]] | tuple[str, Mapping[str, Any], Mapping[str, Any]] | None]


class Played:
    """``answers`` by the names of messages; others are heard and not answered."""

    def __init__(self, link: wirebond.Link, path: str, answers: Mapping[str, Answer]) -> None:
        self.link = link
        self.path = path
        self.heard: list[Message] = []
        self._answers = answers
        link.on()(self._hear)

    def _hear(self, message: Message) -> None:
        self.heard.append(message)
        answer = self._answers.get(message.name)
        reply = None if answer is None else answer(message)
        if reply is not None:
            name, values, *header = reply
            self.link.send(name, values, header=header[0] if header else None)

    def named(self, name: str) -> list[Message]:
        return [message for message in self.heard if message.name == name]

    def last(self, name: str) -> Message:
        """The newest message of this name, which may still be on its way."""
        wait_until(lambda: self.named(name), f"{name} comes")
        return self.named(name)[-1]


@contextmanager
def played(protocol: str, answers: Mapping[str, Answer] | None = None, **options: Any) -> Iterator[Played]:
    """The device of a file of protocols/contrib. At the end: all that the library sent was understood."""
    with (
        line() as (near, far),
        wirebond.open(wirebond.load(CONTRIB / f"{protocol}.yaml"), far.path, role="mcu", **options) as link,
    ):
        device = Played(link, near.path, answers or {})
        yield device
        received = link.stats.receive
        assert [message for message in device.heard if message.name == "unknown"] == []
        assert [(message.name, message.violations) for message in device.heard if message.violations] == []
        discarded = {cause: number for cause, number in received.discarded_bytes.items() if number}
        assert (discarded, link.stats.handler_errors, received.unlisted) == ({}, 0, {})


def asked_until(ask: Callable[[], _Result | None], expected: _Result) -> None:
    """Ask until this is the result. Where the answer to one request comes after the library has asked again, most
    libraries take it for the answer to the next one."""

    def result() -> bool | None:
        seen.append(ask())
        return True if seen[-1] == expected else None

    seen: list[_Result | None] = []
    try:
        asked_again(result)
    except AssertionError as error:
        raise AssertionError(f"{expected!r} never came; last {seen[-3:]}") from error


def asked_again(ask: Callable[[], _Result]) -> _Result:
    """The first result that is neither an exception nor None."""
    last: Exception | None = None
    with contextlib.redirect_stdout(io.StringIO()):
        for _ in range(_ATTEMPTS):
            try:
                if (result := ask()) is not None:
                    return result
            except AttributeError:
                raise
            except Exception as error:  # each library has its own for a late answer
                last = error
    raise AssertionError("no answer came") from last
