"""The MCU's clock in the host's time, with simulated lines: jitter, drift, outliers, restarts, a clock that wraps."""

from __future__ import annotations

import random
from dataclasses import dataclass, field

import pytest

from wirebond import UsageError
from wirebond.link.clock_sync import ClockSync, Verdict


@dataclass
class Wire:
    """A host, an MCU whose clock drifts and wraps, and a line between them. Times of the host are true ones."""

    drift: float = 0.0  # of the MCU's clock: 1e-6 is a part per million
    delay: float = 0.001  # seconds one way, at least
    jitter: float = 0.0005  # seconds on top, each way by itself
    booted: float = -1234.0
    bits: int = 32
    random: random.Random = field(default_factory=lambda: random.Random(7))

    def mcu_us(self, t: float) -> int:
        return int((t - self.booted) * (1 + self.drift) * 1e6) % (1 << self.bits)

    def one_way(self) -> float:
        return self.delay + self.random.expovariate(1 / self.jitter)

    def exchange(self, sync: ClockSync, t: float, late: float = 0.0) -> Verdict:
        """Beginning at `t`; the reply is `late` seconds later than usual."""
        there = t + self.one_way()
        gone = there + 0.0003
        return sync.feed(t, self.mcu_us(there), self.mcu_us(gone), gone + self.one_way() + late)

    def error(self, sync: ClockSync, t: float) -> float:
        """Return the error of the answer for a stamp of now; it is verified against the bound."""
        answer = sync.to_host(self.mcu_us(t), t + self.one_way())
        assert abs(answer.t - t) <= answer.error, (answer, t)
        return abs(answer.t - t)


@pytest.mark.parametrize("drift", [0.0, 50e-6, -50e-6, 0.01, -0.01])
@pytest.mark.parametrize("seed", range(3))
def test_the_bound_holds_and_drift_is_found(drift: float, seed: int) -> None:
    wire, sync = Wire(drift, random=random.Random(seed)), ClockSync()
    worst = 0.0
    for second in range(200):
        wire.exchange(sync, float(second))
        for step in range(5):
            error = wire.error(sync, second + 0.15 + 0.2 * step)
            worst = max(worst, error) if second > 60 else worst
    reading = sync.reading()
    assert reading is not None
    assert reading.drift == pytest.approx(drift * 1e6, abs=5)
    assert worst < 0.0003  # jitter is 0.5 ms each way, on average
    assert reading.error < 0.003  # the round trip and what the drift leaves open
    assert (reading.exchanges, reading.restarts) == (200, 0)
    assert reading.round_trip == pytest.approx(0.002, abs=0.0005)


def test_nothing_is_known_before_the_first_exchange() -> None:
    sync = ClockSync()
    assert sync.reading() is None
    with pytest.raises(UsageError, match="not known yet"):
        sync.to_host(0, 0.0)


def test_one_exchange_gives_a_time_whose_bound_grows() -> None:
    wire, sync = Wire(0.015), ClockSync()
    assert wire.exchange(sync, 0.0) == Verdict.USED
    first = sync.to_host(wire.mcu_us(0.01), 0.01)
    later = sync.to_host(wire.mcu_us(10.0), 10.0)
    assert abs(later.t - 10.0) <= later.error
    assert later.error > 10 * first.error


@pytest.mark.parametrize("late", [0.02, 0.5])
def test_exchanges_that_were_held_up_do_not_count(late: float) -> None:
    wire, sync = Wire(20e-6), ClockSync()
    verdicts = []
    for second in range(120):
        verdicts.append(wire.exchange(sync, float(second), late if second > 10 and second % 3 == 0 else 0.0))
        wire.error(sync, second + 0.5)
        if second > 60:
            assert wire.error(sync, second + 0.7) < 0.0005
    held_up = verdicts[12::3]
    assert set(held_up) == {Verdict.OUTLIER}
    reading = sync.reading()
    assert reading is not None
    assert reading.outliers >= len(held_up)
    assert reading.restarts == 0


def test_a_reply_with_wrong_times_is_left_out() -> None:
    wire, sync = Wire(), ClockSync()
    for second in range(20):
        wire.exchange(sync, float(second))
    before = sync.to_host(wire.mcu_us(20.0), 20.0)
    assert sync.feed(20.0, 5, 6, 20.003) == Verdict.OUTLIER
    assert sync.feed(21.0, 7_000_000, 9_000_000, 21.003) == Verdict.NONSENSE
    assert sync.to_host(wire.mcu_us(20.0), 20.0) == before
    for second in range(22, 30):
        assert wire.exchange(sync, float(second)) != Verdict.RESTARTED
        wire.error(sync, second + 0.5)


def test_a_restart_of_the_mcu_is_found_and_begins_a_new_clock() -> None:
    wire, sync = Wire(30e-6), ClockSync()
    for second in range(30):
        wire.exchange(sync, float(second))
    wire.booted = 30.2
    assert wire.exchange(sync, 31.0) == Verdict.OUTLIER
    assert wire.exchange(sync, 32.0) == Verdict.RESTARTED
    for second in range(33, 120):
        wire.exchange(sync, float(second))
        wire.error(sync, second + 0.5)
    reading = sync.reading()
    assert reading is not None
    assert reading.restarts == 1
    assert reading.drift == pytest.approx(30, abs=5)


def test_a_reported_restart_needs_no_finding() -> None:
    wire, sync = Wire(), ClockSync()
    for second in range(10):
        wire.exchange(sync, float(second))
    wire.booted = 10.0
    sync.restart()
    assert sync.reading() is None
    assert wire.exchange(sync, 11.0) == Verdict.USED
    wire.error(sync, 11.5)


@pytest.mark.parametrize("bits", [24, 32, 64])
def test_the_mcus_clock_wraps(bits: int) -> None:
    """With 64 bits it is the firmware's counter that wraps, and 32 of them are looked at."""
    wrap = min(bits, 32)
    wire = Wire(40e-6, booted=5.0 - (1 << wrap) * 1e-6, bits=wrap)  # it wraps five seconds from now
    sync = ClockSync(bits)
    offsets = []
    for second in range(40):
        wire.exchange(sync, float(second))
        wire.error(sync, second + 0.5)
        reading = sync.reading()
        assert reading is not None
        offsets.append(reading.offset)
    assert max(offsets) - min(offsets) < 0.01
    assert sync.restarts == 0


def test_an_hour_and_a_half_without_an_exchange_is_bridged() -> None:
    wire, sync = Wire(10e-6), ClockSync()
    for second in range(60):
        wire.exchange(sync, float(second))
    assert wire.exchange(sync, 60.0 + 5400) in (Verdict.USED, Verdict.OUTLIER)
    assert sync.restarts == 0
    wire.error(sync, 5461.0)


def test_a_clock_that_wraps_too_soon_is_refused() -> None:
    with pytest.raises(UsageError, match=r"16 bits, so it wraps after 0\.066 s; clock sync needs at least 24"):
        ClockSync(16)


@pytest.mark.parametrize("seed", range(4))
def test_later_stamps_have_later_times_whatever_the_line_does(seed: int) -> None:
    """Round trips become shorter all the time, and it is the way back that was long: each exchange moves the line back.
    Stamps are asked for up to the moment in which the reply is there."""
    chance = random.Random(seed)
    wire, sync = Wire(chance.uniform(-0.001, 0.001), jitter=0.0001, random=chance), ClockSync()
    before, moved = float("-inf"), 0.0
    for exchange in range(40):
        t, late = exchange * 0.2, 0.5 * 0.8**exchange
        there = t + wire.one_way()
        back = there + wire.one_way() + late
        if exchange:
            for step in range(1, 20):  # while it is under way
                answer = sync.to_host(wire.mcu_us(t + step / 100), t + step / 100).t
                assert answer > before
                before = answer
            unmoved = sync.to_host(wire.mcu_us(t + 0.2), t + 0.2).t
        sync.feed(t, wire.mcu_us(there), wire.mcu_us(there), back)
        if exchange:
            assert sync.to_host(wire.mcu_us(t + 0.2), t + 0.2).t >= unmoved  # asked again: not earlier
            moved += sync.to_host(wire.mcu_us(t + 5), t + 5).t - unmoved - 4.8
            before = unmoved
    assert sync.restarts == 0
    assert moved < -0.1  # else this would show nothing


@pytest.mark.parametrize("drift", [0.0, 300e-6])
def test_the_times_of_bytes_on_the_line_are_no_part_of_the_doubt(drift: float) -> None:
    """A line of 9600 baud: a request of 16 bytes, a reply of 40, and 1 ms for all the rest."""
    to_mcu, to_host = 16 * 10 / 9600, 40 * 10 / 9600
    wire = Wire(drift, delay=0.0002, jitter=0.0002)
    plain, sync = ClockSync(), ClockSync()
    errors: dict[ClockSync, float] = {plain: 0.0, sync: 0.0}
    for second in range(100):
        there = second + to_mcu + wire.one_way()
        gone = there + 0.0003
        back = gone + to_host + wire.one_way()
        times = (float(second), wire.mcu_us(there), wire.mcu_us(gone), back)
        assert plain.feed(*times) is not Verdict.NONSENSE
        assert sync.feed(*times, to_mcu, to_host) is not Verdict.NONSENSE
        if second > 30:
            errors = {one: max(worst, wire.error(one, second + 0.5)) for one, worst in errors.items()}
    bounds = {one: reading.error for one in errors if (reading := one.reading()) is not None}
    assert errors[plain] > (to_host - to_mcu) / 2 - 0.001  # half of what the reply is longer
    assert errors[sync] < 0.001
    assert bounds[plain] > (to_mcu + to_host) / 2
    assert bounds[sync] < 0.05 * (to_mcu + to_host) + 0.001


def test_a_port_that_is_faster_than_its_baud_rate_has_no_line() -> None:
    wire, sync = Wire(delay=0.0005), ClockSync()
    for second in range(20):
        there = second + wire.one_way()
        times = (float(second), wire.mcu_us(there), wire.mcu_us(there), there + wire.one_way())
        assert sync.feed(*times, 0.02, 0.03) is not Verdict.NONSENSE
        wire.error(sync, second + 0.5)  # within its bound
    assert (sync.restarts, sync.exchanges) == (0, 20)
