"""Deadlines that strike and end, ports that come and go: the engine tells each, and no thread looks for it."""

from __future__ import annotations

import dis
import sys
import threading
from itertools import pairwise
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

import wirebond
from tests.link.drivers import no_engine_ports
from tests.link.mcu import Mcu, linked
from tests.link.protocol import manipulator, without_deadlines
from tests.shared import ROOT
from tests.waiting import PATIENCE, Stopwatch, wait_until
from wirebond import _engine
from wirebond.link.attention import Attention
from wirebond.link.python_link import PythonLink
from wirebond.link.settings import engine_settings

pytestmark = pytest.mark.live

ARM = manipulator()
CALM = without_deadlines()
SERVED = wirebond.load(ROOT / "protocols" / "native.yaml")


def test_each_change_of_a_deadline_is_reported_with_its_time() -> None:
    core = _engine.LinkCore(ARM.tables.protocol, ARM.tables.format_for("mcu"), engine_settings(ARM, 115_200), 0)
    core.port_up(1_000)
    assert core.next_due(1_000) == 300_000  # no look before
    core.poll(299_999)
    assert core.changes() == [("port_up", 1_000, 0)]
    core.poll(300_000)
    core.idle(300_500)
    core.received(ARM.encode("pose", x=1), 301_000, 302_000)
    assert core.next_due(302_000) == 300_500 + 300_000
    core.poll(600_500)
    core.poll(1_300_500)
    core.recover_deadline(1, 1_400_000)  # it ends all of its message
    core.port_down(1_500_000)
    assert core.has_news()
    assert core.changes() == [
        ("struck", 300_000, 0),
        ("ended", 302_000, 0),
        ("struck", 600_500, 0),
        ("struck", 1_300_500, 1),
        ("ended", 1_400_000, 0),
        ("ended", 1_400_000, 1),
        ("port_down", 1_500_000, 0),
    ]


@pytest.mark.usefixtures("ports")
def test_a_deadline_that_strikes_and_ends_while_a_handler_works_is_seen() -> None:
    events: list[tuple[str, bool]] = []
    with linked(ARM) as (link, mcu):
        link.on_deadline("warn")(lambda event: events.append((event.action, event.struck)))
        begun, ends = threading.Event(), threading.Event()

        @link.on("pose")
        def work(_: wirebond.Message) -> None:
            begun.set()
            assert ends.wait(PATIENCE)

        def has_ended() -> bool:
            mcu.send("pose", x=2)  # one that may have waited for long in a stall ends nothing
            return not link.deadlines["warn"]

        mcu.send("pose", x=1)
        assert begun.wait(PATIENCE)
        before = len(events)  # on a slow machine it may have struck before the first message
        wait_until(lambda: link.deadlines["warn"], "it strikes")
        wait_until(has_ended, "it ends")
        ends.set()
        both = (("warn", True), ("warn", False))
        wait_until(lambda: both in pairwise(events[before:]), lambda: f"both are told; {events} were")


def _wakes(name: str) -> int:
    """Return how often the threads of this name have gone to sleep."""
    wakes = 0
    for task in Path("/proc/self/task").iterdir():
        thread = next((t for t in threading.enumerate() if str(t.native_id) == task.name), None)
        if thread is not None and thread.name.startswith(name):
            status = (task / "status").read_text().splitlines()
            wakes += int(next(line for line in status if line.startswith("voluntary")).split()[1])
    return wakes


def test_a_waiter_for_changes_sleeps_until_there_is_one() -> None:
    struck: list[Any] = []
    with linked(SERVED) as (link, _), linked(ARM) as (arm, _):
        arm.on_deadline("halt")(struck.append)
        wait_until(lambda: link.stats.send.sent, "it says hello")
        watch = Stopwatch()
        before = _wakes("services of"), _wakes("handlers of")
        wait_until(lambda: struck, "it strikes after a second")
        after = _wakes("services of"), _wakes("handlers of")
        seconds = max(1.0, watch.seconds)
    # Hello again, the clock that is not answered; 10 a second where it looks every 100 ms.
    assert after[0] - before[0] <= 8 * seconds
    assert after[1] - before[1] <= 20 * seconds  # 100 where it looks every 10 ms


@pytest.mark.timed(tolerance=0.08)
@pytest.mark.usefixtures("ports")
def test_hello_is_said_as_soon_as_the_port_is_open_again(tmp_path: Path) -> None:
    place = tmp_path / "tty"
    mcu = Mcu(SERVED)
    place.symlink_to(mcu.path)
    with wirebond.open(SERVED, place, clock_sync=False) as link:
        wait_until(lambda: mcu.heard, "it says hello")
        place.unlink()
        mcu.close()
        wait_until(lambda: link.state == "down", "it notices")
        mcu = Mcu(SERVED)
        place.symlink_to(mcu.path)
        wait_until(lambda: mcu.heard, "it says hello again")
        sent = link.dump().pieces
        opened = [p.t for p in sent if p.kind == "port_up"][-1]
        said = next(p.t for p in sent if p.kind == "sent" and p.t >= opened)
        assert said - opened < 0.09  # a look every 100 ms, as before, would be later than that nearly always
    mcu.close()


def test_a_signal_that_raises_in_a_link_in_python_loses_no_message() -> None:
    """Its handler runs behind a call or a jump back: it raises behind each of them in turn."""

    class AlarmError(Exception):
        pass

    steps = (PythonLink.receive, PythonLink._receive, Attention.wait, Attention._wait_for)
    opcodes = {step.__code__: {i.offset: i.opname for i in dis.get_instructions(step)} for step in steps}
    with no_engine_ports(), linked(CALM) as (link, mcu):
        at = 0
        has_raised = True
        while has_raised:
            has_raised = False
            at += 1
            left = at
            before: dict[FrameType, str] = {}

            def trace(frame: FrameType, event: str, _: object) -> Any:
                nonlocal left, has_raised
                if frame.f_code not in opcodes:
                    return None
                frame.f_trace_opcodes = True
                if event == "opcode":
                    left -= before.get(frame, "").startswith(("CALL", "RESUME", "JUMP_BACKWARD"))  # noqa: B023
                    before[frame] = opcodes[frame.f_code][frame.f_lasti]  # noqa: B023
                    if left == 0:
                        has_raised, left = True, -1
                        raise AlarmError
                return trace

            mcu.send("pose", x=at)
            wait_until(lambda: link.stats.receive.frames == at, "it came")  # noqa: B023
            sys.settrace(trace)
            try:
                link.internals.inbox._pull(0.0)
            except AlarmError:
                pass
            finally:
                sys.settrace(None)
            assert [m["x"] for m in link.receive(PATIENCE)] == [at]
    assert at > 8  # places were tried
