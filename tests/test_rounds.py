"""The loops of commands that run for some seconds, on a clock of their own."""

from __future__ import annotations

import random
from itertools import islice

import pytest

from wirebond.cli.rounds import paced, time_left


class Clock:
    """In place of the module ``time``. ``oversleeps``: seconds that each sleep takes longer."""

    def __init__(self, now: float, oversleeps: float = 0.0) -> None:
        self.now, self.oversleeps = now, oversleeps

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds + self.oversleeps


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock(1000.0)
    monkeypatch.setattr("wirebond.cli.rounds.time", made)
    return made


def test_there_is_a_last_round_after_the_end(clock: Clock) -> None:
    found = []
    for left in time_left(1.0):
        found.append(left)
        clock.now += 0.75
    assert found == [1.0, 0.25, 0.0]
    assert list(time_left(0.0)) == [0.0]
    assert next(time_left(None)) == float("inf")


def test_rounds_of_a_rate_are_as_many_as_fit(clock: Clock) -> None:
    """Whatever the clock shows: sums of its parts of a second are not exact."""
    source = random.Random("rounds")
    for start in (0.0, *(source.uniform(0, 1e6) for _ in range(200))):
        for rate, seconds, count in ((20, 0.5, 10), (50, 0.3, 15), (10_000, 0.1, 1000), (3, 1.0, 3), (1, 0.2, 1)):
            clock.now, clock.oversleeps = start, 0.1 / rate
            assert len(list(paced(rate, seconds))) == count, (start, rate, seconds)


def test_a_stall_is_followed_by_no_burst(clock: Clock) -> None:
    times = []
    for number, _ in enumerate(islice(paced(10, None), 6)):
        times.append(clock.now)
        clock.now += 5.0 * (number == 2)
    assert times == pytest.approx([1000.0, 1000.1, 1000.2, 1005.2, 1005.3, 1005.4])
