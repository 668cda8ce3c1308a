"""A signal's handler that raises in the main thread: no message is lost, and none comes twice."""

from __future__ import annotations

import dis
import sys
from collections.abc import Callable
from types import CodeType, FrameType
from typing import Any

import pytest

import wirebond
from tests.link.mcu import linked
from tests.link.protocol import without_deadlines
from tests.waiting import PATIENCE, wait_until
from wirebond.link import handlers, inbox, receiving, requests

pytestmark = pytest.mark.live

TRACED = tuple(module.__file__ for module in (handlers, inbox, receiving, requests))


class AlarmError(Exception):
    """Raised by the signal's handler."""


class Alarm:
    """Raises in the code that takes and routes, where Python runs handlers: behind a call, at a function's begin, at a
    jump back. ``place`` says at which of these.
    """

    def __init__(self, place: int) -> None:
        self._left = place
        self._before: dict[FrameType, str] = {}
        self._opcodes: dict[CodeType, dict[int, str]] = {}
        self.has_raised = False

    def __call__(self, frame: FrameType, event: str, _: object) -> Any:
        code = frame.f_code
        if code.co_filename not in TRACED:
            return None
        frame.f_trace_opcodes = True
        if event != "opcode" or self.has_raised:
            return self
        if code not in self._opcodes:
            self._opcodes[code] = {i.offset: i.opname for i in dis.get_instructions(code)}
        before = self._before.get(frame, "")
        self._before[frame] = self._opcodes[code][frame.f_lasti]
        self._left -= before.startswith(("CALL", "RESUME", "JUMP_BACKWARD", "POP_JUMP_BACKWARD"))
        if self._left == 0:
            self.has_raised = True
            raise AlarmError
        return self


def received(link: wirebond.Link) -> list[int]:
    return [m["x"] for m in link.receive(PATIENCE)]


def iterated(link: wirebond.Link) -> list[int]:
    return [next(iter(link))["x"]]


@pytest.mark.parametrize("take", [received, iterated])
@pytest.mark.parametrize("before", ["nothing", "a question of plain send", "the thread routes"])
def test_a_handler_that_raises_anywhere_loses_no_message_and_doubles_none(
    take: Callable[[wirebond.Link], list[int]], before: str
) -> None:
    reads = before == "the thread routes"
    with linked(without_deadlines()) as (link, mcu):
        if reads:
            link._start_reading()
        place = sent = 0
        has_raised = True
        while has_raised:
            place += 1
            if before == "a question of plain send":
                link.send("query")
            for _ in range(2):
                sent += 1
                mcu.send("pose", x=sent)
            wait_until(lambda: link.stats.receive.frames == sent, "they came")  # noqa: B023
            if reads:
                wait_until(lambda: link.internals.inbox._queue.qsize() == 2, "they are routed")
            alarm = Alarm(place)
            got: list[int] = []
            sys.settrace(alarm)
            try:
                got = take(link)
            except AlarmError:
                pass
            finally:
                sys.settrace(None)
            while len(got) < 2 and (more := received(link)):
                got += more
            assert got == [sent - 1, sent]
            assert link.receive() == []
            has_raised = alarm.has_raised
    assert place > 5  # places were tried
