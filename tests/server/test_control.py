"""One program at a time commands what moves; whatever becomes of it, the robot stops."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable

import pytest

import wirebond
from tests.relay import Relay
from tests.server.conftest import Served, Writer, wait_until
from wirebond import NotInControlError, StoppedError
from wirebond.attach import words
from wirebond.server.control import ControlBook

SAFE = 0.0  # m/s


def speeds(messages: list[wirebond.Message]) -> list[float]:
    return [m["linear"] for m in messages if m.name == "velocity"]


def test_the_first_command_takes_control_and_another_program_is_refused(served: Served) -> None:
    with served.attach() as first, served.attach() as second:
        assert first.control.holder is None
        first.send("velocity", linear=0.5, angular=0.0)
        wait_until(lambda: first.control.is_own and second.control.holder == first.control.holder)
        with pytest.raises(NotInControlError, match=r"is in control of the robot.*over=True"):
            second.send("velocity", linear=0.1, angular=0.0)
        with pytest.raises(NotInControlError):
            second.repeat("velocity", linear=0.1, angular=0.0)
        second.send("status_query")  # moves nothing
        assert speeds(served.sent(0.05)) == [0.5]


def test_taking_over_is_explicit_and_sends_the_safe_value_between(served: Served) -> None:
    with served.attach() as first, served.attach() as second:
        first.repeat("velocity", linear=0.5, angular=0.0, hold=60)
        with pytest.raises(NotInControlError):
            second.take_control()
        second.take_control(over=True)
        second.send("velocity", linear=0.25, angular=0.0)
        with pytest.raises(NotInControlError):
            first.repeat("velocity", linear=0.5, angular=0.0)
        found = speeds(served.sent(0.3))
        assert found.index(SAFE) < found.index(0.25)
        assert set(found[: found.index(SAFE)]) == {0.5}
        assert set(found[found.index(SAFE) :]) == {SAFE, 0.25}
        wait_until(lambda: not first.control.is_own)


def test_a_program_that_lost_control_must_ask_for_it(served: Served) -> None:
    with served.attach() as first, served.attach() as second:
        first.send("velocity", linear=0.5, angular=0.0)
        second.take_control(over=True)
        second.release_control()
        with pytest.raises(NotInControlError, match=r"call take_control\(\)"):
            first.send("velocity", linear=0.5, angular=0.0)
        first.take_control()
        first.send("velocity", linear=0.5, angular=0.0)


def test_a_stop_by_anyone_holds_for_all_and_its_end_leaves_nobody_in_control(served: Served) -> None:
    with served.attach() as driver, served.attach() as watcher:
        driver.repeat("velocity", linear=0.5, angular=0.0, hold=60)
        watcher.emergency_stop()
        for link in (driver, watcher):
            assert link.stopped
            with pytest.raises(StoppedError):
                link.send("velocity", linear=0.5, angular=0.0)
        watcher.release_stop()
        wait_until(lambda: driver.control.holder is None)
        with pytest.raises(NotInControlError):
            driver.repeat("velocity", linear=0.5, angular=0.0)
        served.sent(0.05)
        assert speeds(served.sent(0.2)) == []


def test_the_end_of_a_program_ends_its_leases_at_once(served: Served) -> None:
    with served.attach() as watcher:
        with served.attach() as driver:
            driver.repeat("velocity", linear=0.5, angular=0.0, hold=60)
            wait_until(lambda: watcher.control.holder is not None)
            served.sent(0.1)
        wait_until(lambda: watcher.control.holder is None)
        assert speeds(served.sent(0.1))[-1] == SAFE
        assert speeds(served.sent(0.2)) == []


@pytest.mark.parametrize("how", ["send", "repeat"])
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP])
def test_a_program_that_is_killed_or_stopped_cannot_leave_the_robot_driving(
    served: Served, start_writer: Callable[..., Writer], how: str, end: signal.Signals
) -> None:
    writer = start_writer(how)
    served.sent(0.1)
    writer.process.send_signal(end)
    began = time.monotonic()
    after = []
    while SAFE not in after:  # how soon: `test_silence_ends_control_within_its_time`, in virtual time
        assert time.monotonic() - began < 20
        after += speeds(served.sent(0.005))
    assert speeds(served.sent(0.3)) == []
    if end == signal.SIGSTOP:
        writer.process.send_signal(signal.SIGCONT)
        while (said := writer.line()) != "NotInControlError":  # it does not drive on
            assert said == "LateCommandError"
        assert set(speeds(served.sent(0.1))) <= {SAFE}


def test_a_program_whose_packets_are_dropped_without_a_close_is_silent(
    served: Served, start_writer: Callable[..., Writer]
) -> None:
    with Relay(served.server.port or 0) as relay:
        start_writer("repeat", f"wirebond://127.0.0.1:{relay.port}")
        served.sent(0.1)
        relay.drops.set()
        seen: list[float] = []
        wait_until(lambda: SAFE in seen or seen.extend(speeds(served.sent(0.005))), "the safe value")
        assert speeds(served.sent(0.2)) == []


# ---- the rules, in virtual time


def book_of_two() -> ControlBook:
    book = ControlBook()
    for client in "ab":
        book.add(client, f"program {client}", asks=False, now=0.0)
    return book


def test_silence_ends_control_within_its_time() -> None:
    book = book_of_two()
    now = 0.0
    for _ in range(40):  # a beat each 0.1 s
        tick = book.ticks.next(now)
        assert book.refuses("a", tick, now) is None
        book.beat("a", tick, now)
        now += words.BEAT_EVERY
        assert not book.silent(now)
    last = now - words.BEAT_EVERY
    assert not book.silent(last + words.SILENCE)
    assert book.silent(last + words.SILENCE + 0.001)


def test_a_command_that_was_under_way_for_long_is_refused() -> None:
    book = book_of_two()
    old = book.ticks.next(0.0)
    for n in range(1, 10):
        book.ticks.next(n * words.TICK_EVERY)
    now = 9 * words.TICK_EVERY
    refused = book.refuses("a", old, now)
    assert refused is not None
    assert refused[0] == "late"
    assert book.holder is None
    assert book.refuses("a", book.ticks.newest, now) is None


def test_beats_that_come_late_in_one_burst_show_nothing() -> None:
    book = book_of_two()
    tick = book.ticks.next(0.0)
    assert book.refuses("a", tick, 0.0) is None
    for n in range(1, 20):
        book.ticks.next(n * words.TICK_EVERY)
    book.beat("a", tick, 0.95)
    assert book.silent(0.95)


def test_a_tick_that_never_was_is_late() -> None:
    book = book_of_two()
    refused = book.refuses("a", 10_000, 0.0)
    assert refused is not None
    assert refused[0] == "late"
