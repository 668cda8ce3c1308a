"""Rates, losses and use of the line, from two looks at an account; and the account's sums at any moment under load."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest

import wirebond
from tests.link.drivers import balances
from tests.link.mcu import linked
from tests.link.protocol import manipulator
from tests.shared import account_closes, codec
from tests.waiting import moments, wait_until
from wirebond import Codec, LinkStats, QueueFullError, SequenceStats, UsageError
from wirebond.codec import Stats
from wirebond.link import SendStats
from wirebond.link.rates import LONGEST_WINDOW, RateMeter, rates_between
from wirebond.protocol import loads
from wirebond.protocol.model import End, Protocol
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live


def look(
    *,
    received: int = 0,
    discarded: int = 0,
    messages: dict[str, int] | None = None,
    left: dict[str, int] | None = None,
    **sent: int,
) -> LinkStats:
    counts = messages or {}
    frames = sum(counts.values())
    receive = Stats(received, frames, 0, 0, 0, received - discarded, 0, 0, {"no_start": discarded}, {}, counts)
    names = SendStats.__dataclass_fields__
    counted: dict[str, Any] = {name: sent.get(name, 0) for name in names}
    return LinkStats(receive, SendStats(**counted | {"messages": left or {}}), *[0] * 6)


def even() -> Protocol:
    return replace(codec("diffdrive").model, link=replace(codec("diffdrive").model.link, parity="even", stop_bits=2))


def test_line_use_counts_start_parity_and_stop_bits() -> None:
    later = look(received=4800, sent_bytes=1200)
    plain = rates_between(codec("diffdrive").model, 48_000, look(), later, 2.0)
    assert (plain.bits_per_byte, plain.receive.line_use, plain.send.line_use) == (10, 0.5, 0.125)
    long = rates_between(even(), 48_000, look(), later, 2.0)
    assert (long.bits_per_byte, long.receive.line_use, long.send.line_use) == (12, 0.6, 0.15)


def test_a_full_line_is_one() -> None:
    rates = rates_between(codec("diffdrive").model, 115_200, look(), look(received=11_520), 1.0)
    assert rates.receive.line_use == 1
    assert rates.receive.bytes_per_second == 11_520


def test_messages_are_compared_with_their_schedule() -> None:
    model = codec("diffdrive").model  # odometry every 50 ms
    rates = rates_between(
        model, 115_200, look(messages={"odometry": 10}), look(messages={"odometry": 20, "status": 3}), 2
    )
    assert set(rates.messages) == {"odometry", "status"}
    odometry = rates.messages["odometry"]
    assert (odometry.per_second, odometry.due) == (5, 20)
    assert odometry.missing == pytest.approx(29 / 39)  # 40 are due, and one more or less lies at the edges
    assert (rates.messages["status"].due, rates.messages["status"].missing) == (None, None)
    full = rates_between(model, 115_200, look(), look(messages={"odometry": 39}), 2)
    assert full.messages["odometry"].missing == 0


def test_sent_messages_are_compared_with_their_schedule() -> None:
    model = codec("diffdrive").model  # velocity every 50 ms, status_query every second
    rates = rates_between(model, 115_200, look(left={"velocity": 5}), look(left={"velocity": 24}), 2)
    assert set(rates.sent) == {m.name for m in model.messages if m.sent_by(End.HOST) and m.every is not None}
    velocity = rates.sent["velocity"]
    assert (velocity.per_second, velocity.due) == (9.5, 20)
    assert velocity.missing == pytest.approx(20 / 39)
    assert rates.sent["status_query"].missing == 1


@pytest.mark.usefixtures("ports")
def test_a_link_counts_what_left_by_message() -> None:
    with linked(manipulator()) as (link, mcu):
        link.repeat("lamp", level=1, hold=60)
        for number in range(5):
            link.send("note", number=number)
        wait_until(lambda: link.stats.send.messages.get("lamp", 0) >= 5, "the lamp is repeated")
        wait_until(lambda: link.stats.send.messages.get("note") == 5, "the notes leave")
        stats = link.stats.send
        assert sum(stats.messages.values()) == stats.sent
        assert link.rates().sent["lamp"].per_second > 0
        wait_until(lambda: {m.name for m in mcu.heard} == set(stats.messages), "the MCU hears them")


def test_loss_is_reported_as_part_of_the_offered_load() -> None:
    later = look(offered=100, accepted=90, refused_full=6, refused_down=4, sent=70, replaced=10, expired=5, queued=5)
    send = rates_between(codec("diffdrive").model, 115_200, look(), later, 2.0).send
    assert (send.offered_per_second, send.frames_per_second, send.lost) == (50, 35, 0.15)
    assert rates_between(codec("diffdrive").model, 115_200, look(), look(), 2.0).send.lost == 0


def test_discarded_bytes_and_missing_numbers_are_of_the_window_alone() -> None:
    before = look(received=1000, discarded=900)
    after = look(received=3000, discarded=1000)
    model = codec("diffdrive").model
    assert rates_between(model, 115_200, before, after, 1.0).receive.discarded == 0.05
    assert rates_between(model, 115_200, before, after, 1.0).receive.missing is None

    def numbered(stats: LinkStats, came: int, gaps: int) -> LinkStats:
        return replace(stats, receive=replace(stats.receive, sequence=SequenceStats(came, gaps, 0, 0, {})))

    rates = rates_between(model, 115_200, numbered(before, 50, 50), numbered(after, 140, 60), 1.0)
    assert rates.receive.missing == 0.1


def test_the_window_is_the_newest_look_that_is_old_enough() -> None:
    meter = RateMeter(codec("diffdrive").model, 115_200, look(), 100.0)
    assert meter.rates(look(received=10), 101.0, 2.0).seconds == 1
    assert meter.rates(look(received=20), 103.5, 2.0).seconds == 2.5
    assert meter.rates(look(received=30), 104.0, 2.0).seconds == 3
    for second in range(1, 1000):
        rates = meter.rates(look(received=30 + second), 104.0 + second, LONGEST_WINDOW)
    assert rates.seconds == pytest.approx(LONGEST_WINDOW, abs=1)
    assert rates.receive.bytes_per_second == pytest.approx(1, rel=0.02)
    assert len(meter._looks) < 300


@pytest.fixture
def pty() -> Iterator[PtyPort]:
    port = PtyPort()
    yield port
    port.close()


BOTH = """
wirebond: 1
protocol: both_ways
link: {baud: 2000000}
frame: [magic: 0xAA 0x55, length: u8, id: u8, payload: by_length, check: crc-16/modbus]
messages:
  up:   {id: 1, sender: mcu, every: 1 ms, fields: {text: {type: bytes, max: 60}}}
  down: {id: 2, sender: host, fields: {text: {type: bytes, max: 60}}}
"""


def test_both_sums_close_at_any_moment_under_load(pty: PtyPort) -> None:
    described = Codec(loads(BOTH))
    burst = b"\xaa\x55\x03" + b"".join(described.encode("up", text=bytes(size)) for size in range(0, 60, 7)) + b"\xaa"
    ends = threading.Event()
    with wirebond.open(described, pty.path) as link:

        def mcu() -> None:
            while not ends.wait(0.0005):
                pty.read(0)
                pty.write(burst)

        def sender() -> None:
            while not ends.is_set():
                try:
                    link.send("down", text=bytes(50))
                except QueueFullError:
                    ends.wait(0.0005)

        threads = [threading.Thread(target=run) for run in (mcu, sender)]
        for thread in threads:
            thread.start()
        try:
            for looked, _ in enumerate(moments("a load")):
                stats = link.stats
                if looked >= 300 and stats.send.refused_full and stats.receive.frames >= 1000:
                    break
                assert account_closes(stats.receive)
                assert balances(stats.send)
                link.receive(0)
            rates = link.rates()
        finally:
            ends.set()
            for thread in threads:
                thread.join()
    assert 0 < rates.send.line_use <= 1.2  # the driver takes a little ahead
    assert rates.receive.line_use > 0
    assert 0 < rates.receive.discarded < 0.1
    assert rates.messages["up"].per_second > 0
    assert 0 < rates.send.lost < 1


def test_a_wrong_window_is_refused(pty: PtyPort) -> None:
    with wirebond.open(manipulator(), pty.path) as link:
        for window in (0, -1, float("nan"), float("inf")):
            with pytest.raises(UsageError, match="window is"):
                link.rates(window)
        assert link.rates().as_dict()["receive"]["line_use"] == 0
