"""A measurement of latency counts correctly if the peer is slow, silent, wrong, or goes away."""

from __future__ import annotations

import threading
import time

import pytest

import wirebond
from tests.link.mcu import Mcu, linked
from tests.shared import codec
from tests.waiting import PATIENCE, Stopwatch, let_pass, moments, wait_until
from wirebond import MessageError, UsageError
from wirebond.link import Link
from wirebond.sim.latency import Measurement, measure, probe_for

pytestmark = pytest.mark.live

NATIVE = codec("native")
DIFFDRIVE = codec("diffdrive")


def pong(number: int) -> bytes:
    return NATIVE.encode("pong", number=number)


def ask(link: Link, into: Measurement, number: int, timeout: float = PATIENCE, message: str | None = None) -> None:
    """So many questions more."""
    probe, end = probe_for(link.codec, message, {}), time.monotonic() + 3600
    measure(link, probe, into, count=into.asked + number, rate=1000.0, end=end, timeout=timeout, header={})


def measured(link: Link, number: int) -> Measurement:
    into = Measurement()
    ask(link, into, number)
    return into


def test_pings_are_numbered_and_timed() -> None:
    def slow(message: wirebond.Message) -> bytes:
        if message.name != "ping":
            return b""
        let_pass(0.01)
        return pong(message["number"])

    with linked(NATIVE, slow, clock_sync=False) as (link, mcu):
        into = measured(link, 5)
        assert [m["number"] for m in mcu.heard if m.name == "ping"] == [0, 1, 2, 3, 4]
    assert (into.asked, len(into.round_trips), into.lost) == (5, 5, 0)
    assert all(time >= 0.01 for time in into.round_trips)
    assert into.to_mcu == []


def test_replies_that_stay_away_are_lost_and_the_advice_says_what_to_look_at() -> None:
    answer = {0: True, 1: False, 2: True}
    with linked(NATIVE, lambda m: pong(m["number"]) if m.name == "ping" and answer[m["number"]] else b"") as (link, _):
        into = measured(link, 1)
        ask(link, into, 1, timeout=0.3)
        ask(link, into, 1)
    assert (into.asked, len(into.round_trips), into.lost, into.wrong) == (3, 2, 1, 0)
    assert "no pong within 0.3 s of ping" in into.advice


def test_a_reply_with_another_number_is_wrong_and_no_round_trip() -> None:
    with linked(NATIVE, lambda m: pong(m["number"] + 7) if m.name == "ping" else b"") as (link, _):
        into = Measurement()
        for _ in moments("two answers in time"):
            ask(link, into, 1, timeout=0.2)
            if into.wrong == 2:
                break
    assert (into.round_trips, into.lost) == ([], into.asked)
    assert "pong came back with number " in into.advice and f", and {into.asked - 1} was asked" in into.advice


def test_a_late_reply_that_carries_nothing_back_is_not_taken_for_the_next_one() -> None:
    links: list[Link] = []

    def late(_: wirebond.Message) -> bytes:
        wait_until(lambda: links and links[0].stats.send.sent == 2, "the first one is given up, and asked again")
        return DIFFDRIVE.encode("status", battery=12.0, errors=[], state=[])

    with linked(DIFFDRIVE, late) as (link, _):
        links.append(link)
        into = Measurement()
        ask(link, into, 1, timeout=0.3, message="status_query")
        ask(link, into, 1, message="status_query")
    assert into.lost == 1
    assert len(into.round_trips) == 1


def test_one_way_times_add_up_within_their_bound() -> None:
    """The MCU's clock is this machine's, less a hundred seconds."""

    def answer(message: wirebond.Message) -> bytes:
        if message.name == "ping":
            return pong(message["number"])
        if message.name != "clock_request":
            return b""
        now = round((time.monotonic() - 100.0) * 1e6) & 0xFFFFFFFF
        return NATIVE.encode("clock_reply", host_us=message["host_us"], received_us=now, sent_us=now)

    with linked(NATIVE, answer) as (link, _):
        wait_until(lambda: link.clock is not None, "the clock")
        watch = Stopwatch()
        into = measured(link, 20)
    assert len(into.to_mcu) == len(into.to_host) == 20
    # Where the MCU answers at once, both ways together are an exchange, whatever the two clocks differ by.
    together = [there + back for there, back in zip(into.to_mcu, into.to_host, strict=True)]
    assert min(together) > 0
    assert sum(together) < watch.seconds
    assert min(into.to_mcu) > -into.one_way_error
    assert min(into.to_host) > -into.one_way_error


def test_a_port_that_goes_away_in_the_middle_loses_only_requests_of_that_time() -> None:
    enough = threading.Event()

    def answer(message: wirebond.Message) -> bytes:
        if message.name != "ping":
            return b""
        if message["number"] == 10:
            enough.set()
        return pong(message["number"])

    mcu = Mcu(NATIVE, answer)

    def go_away() -> None:
        enough.wait(PATIENCE)
        mcu.close()

    into = Measurement()
    probe = probe_for(NATIVE, None, {})
    going = threading.Thread(target=go_away)
    with wirebond.open(NATIVE, mcu.path) as link:
        going.start()
        for _ in moments(lambda: f"the port goes away; {into.advice}"):
            if "is away" in into.advice or "went away" in into.advice or mcu.path in into.advice:
                break
            end = time.monotonic() + PATIENCE
            measure(link, probe, into, count=into.asked + 5, rate=200.0, end=end, timeout=0.1, header={})
    going.join()
    assert len(into.round_trips) >= 10
    assert into.lost
    assert into.asked == len(into.round_trips) + into.lost


def test_impossible_requests_get_a_sentence() -> None:
    with pytest.raises(UsageError, match=r"diffdrive maps no ping service; name a request .* --message: status_query"):
        probe_for(DIFFDRIVE, None, {})
    with pytest.raises(UsageError, match="velocity has no `reply` in diffdrive"):
        probe_for(DIFFDRIVE, "velocity", {})
    with pytest.raises(MessageError, match="parameter_read needs index"):
        probe_for(NATIVE, "parameter_read", {})
