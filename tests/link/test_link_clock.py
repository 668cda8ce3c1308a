"""A link follows the MCU's clock by itself: how often it asks, silence, wrong replies, and when it must not ask."""

from __future__ import annotations

import time
import weakref
from pathlib import Path

import pytest

import wirebond
from tests.link.mcu import Mcu, linked
from tests.link.protocol import manipulator
from tests.shared import PROTOCOLS, codec
from tests.waiting import Stopwatch, wait_until
from wirebond import UsageError
from wirebond.link.services import byte_seconds
from wirebond.protocol import loads
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live

NATIVE = codec("native")


def answer(message: wirebond.Message) -> bytes:
    """With the clock of this machine, less a hundred seconds."""
    if message.name != "clock_request":
        return b""
    now = round((time.monotonic() - 100.0) * 1e6) & 0xFFFFFFFF
    return NATIVE.encode("clock_reply", host_us=message["host_us"], received_us=now, sent_us=now)


def test_offset_and_stamps_are_known_soon() -> None:
    watch = Stopwatch()
    with linked(NATIVE, answer) as (link, mcu):
        wait_until(lambda: link.clock is not None and link.clock.exchanges >= 5, "the first exchanges")
        clock = link.clock
        assert clock is not None
        time_of_100 = link.host_time(100_000_000, near=200.0)
        assert time_of_100.t == pytest.approx(200.0, abs=time_of_100.error)
        asked = len([m for m in mcu.heard if m.name == "clock_request"])
        assert asked <= 7 + watch.seconds  # soon at first, then once a second
        assert [m for m in link.receive() if m.name == "clock_reply"] == []


def test_an_mcu_that_does_not_answer_leaves_the_clock_unknown() -> None:
    with linked(NATIVE) as (link, mcu):
        wait_until(lambda: [m for m in mcu.heard if m.name == "clock_request"], "the request")
        assert link.clock is None
        with pytest.raises(UsageError, match="not known yet"):
            link.host_time(5)


def test_a_reply_to_another_request_changes_nothing() -> None:
    wrong = NATIVE.encode("clock_reply", host_us=1, received_us=2, sent_us=3)
    with linked(NATIVE, lambda m: wrong if m.name == "clock_request" else b"") as (link, mcu):
        wait_until(lambda: len([m for m in mcu.heard if m.name == "clock_request"]) > 3, "requests after wrong replies")
        assert link.latest("clock_reply") is not None
        assert link.clock is None


def test_it_can_be_switched_off() -> None:
    with linked(NATIVE, answer, clock_sync=False) as (link, mcu):
        wait_until(lambda: len(mcu.heard) >= 2, "hello again")
        assert link.clock is None
        with pytest.raises(UsageError, match="open it with clock_sync=True"):
            link.host_time(5)
        assert {m.name for m in mcu.heard} == {"hello"}  # said again while no answer has come


def test_a_file_without_the_service_says_so() -> None:
    with linked(manipulator()) as (link, _), pytest.raises(UsageError, match="manipulator maps no `clock` service"):
        link.host_time(5)


def test_a_clock_that_wraps_too_soon_is_not_asked() -> None:
    text = (PROTOCOLS / "native.yaml").read_text()
    for name in ("received_us: {type: u32", "sent_us:     {type: u32"):
        assert name in text
        text = text.replace(name, name.replace("u32", "u16"))
    with linked(wirebond.Codec(loads(text))) as (link, mcu):
        wait_until(lambda: len(mcu.heard) >= 2, "hello again")
        assert {m.name for m in mcu.heard} == {"hello"}
        with pytest.raises(UsageError, match="the MCU's clock has 16 bits"):
            link.host_time(5)


def test_a_link_that_waits_for_the_clock_can_become_garbage(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its leases end then; an MCU that does not answer must not keep it."""
    monkeypatch.setattr("wirebond.link.services._CLOCK_TIMEOUT", 3600.0)
    mcu = Mcu(NATIVE)
    try:
        link = wirebond.open(NATIVE, mcu.path)
        kept = weakref.ref(link)
        wait_until(lambda: [m for m in mcu.heard if m.name == "clock_request"], "the request")
        del link
        wait_until(lambda: kept() is None, "it is garbage, while the exchange waits for its answer")
    finally:
        mcu.close()


def test_a_port_that_goes_while_its_links_are_followed_costs_the_services_nothing(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Their thread ended there: hello and clock stopped, and the link went on without them."""
    pty = PtyPort()
    name = tmp_path / "tty"
    name.symlink_to(pty.path)
    with wirebond.open(codec("diffdrive"), name) as link:

        def gone(_: str) -> str:
            raise FileNotFoundError(2, "No such file or directory")

        monkeypatch.setattr("os.path.realpath", gone)
        assert byte_seconds(link) == 0.0
        monkeypatch.undo()
    pty.close()
