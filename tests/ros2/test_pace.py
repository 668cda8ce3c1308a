"""A thread that looks for messages: often enough for each, and not once for each of many."""

from __future__ import annotations

from wirebond.ros2.pace import Pace


class Clock:
    def __init__(self) -> None:
        self.now = 100.0
        self.slept = 0.0

    def sleep(self, seconds: float) -> None:
        self.now += seconds
        self.slept += seconds


def looks(clock: Clock, pace: Pace, every: float, seconds: float) -> int:
    """Return how often a thread looks that finds a message each ``every`` seconds, and all that came since."""
    count, end, next_message = 0, clock.now + seconds, clock.now + every
    while clock.now < end:
        pace.wait()
        clock.now = max(clock.now, next_message)
        while next_message <= clock.now:
            next_message += every
        count += 1
    return count


def test_at_a_high_rate_many_messages_are_found_at_once() -> None:
    clock = Clock()
    assert looks(clock, Pace(0.001, lambda: clock.now, clock.sleep), 0.0001, 1.0) <= 1002


def test_messages_that_come_slowly_do_not_wait() -> None:
    clock = Clock()
    assert looks(clock, Pace(0.001, lambda: clock.now, clock.sleep), 0.002, 1.0) >= 498
    assert clock.slept == 0.0


def test_second_of_two_does_not_wait_either() -> None:
    clock = Clock()
    pace = Pace(0.001, lambda: clock.now, clock.sleep)
    for _ in range(10):
        pace.wait()
        clock.now += 0.05  # the first comes
        pace.wait()
        assert clock.slept == 0.0
        clock.now += 0.05
