"""A link knows its peer: it says hello at each connect, notices a restart, and reports another hash once."""

from __future__ import annotations

import logging
from itertools import pairwise
from pathlib import Path

import pytest

import wirebond
from tests.link.mcu import Mcu, linked
from tests.link.protocol import manipulator
from tests.shared import codec
from tests.waiting import Stopwatch, wait_until
from wirebond.link.peer import FIRST_WAIT, LAST_WAIT, PeerBook
from wirebond.protocol import loads

pytestmark = pytest.mark.live

NATIVE = codec("native")
OWN = NATIVE.hash


def hello(protocol_hash: int) -> bytes:
    return NATIVE.encode("hello", protocol_hash=protocol_hash, version=1)


def hellos(mcu: Mcu) -> list[wirebond.Message]:
    return [m for m in mcu.heard if m.name == "hello"]


# ---- over a pty


@pytest.mark.parametrize(("theirs", "state"), [(OWN, "same"), (OWN + 1, "different")])
def test_the_peer_is_asked_and_known(theirs: int, state: str) -> None:
    with linked(NATIVE, lambda m: hello(theirs) if m.name == "hello" else b"") as (link, mcu):
        wait_until(lambda: link.peer.state != "unknown", "the answer to hello")
        assert (link.peer.state, link.peer.hash, link.peer.version) == (state, theirs, 1)
        assert hellos(mcu)[0].fields == {"protocol_hash": OWN, "version": 1}
        link.send("ping", number=1)  # it never refuses to work


def test_another_hash_is_logged_once_with_what_to_do(caplog: pytest.LogCaptureFixture) -> None:
    with linked(NATIVE, lambda m: hello(5) if m.name == "hello" else b"") as (link, mcu):
        wait_until(lambda: caplog.records, "the warning")
        mcu.write(hello(5))  # it restarted, and is asked again
        wait_until(lambda: len(hellos(mcu)) == 2, "the second hello")
        text = caplog.records[0].getMessage()
        assert text.startswith(
            f"{mcu.path}: the MCU was built from another protocol file: its hash is 0000000000000005"
        )
        assert "Compare the two files with `wirebond diff`" in text
        assert [r.levelno for r in caplog.records] == [logging.WARNING]
        assert link.peer.why in text


def test_a_device_that_changes_its_hello_all_the_time_fills_no_log(caplog: pytest.LogCaptureFixture) -> None:
    watch = Stopwatch()
    with linked(NATIVE, hello=False) as (link, mcu):
        for number in range(1, 501):
            mcu.write(hello(OWN + number))
        wait_until(lambda: link.peer.hash == OWN + 500, "the last hello")
    lines = [r.getMessage() for r in caplog.records if r.levelno >= logging.WARNING]
    assert 1 <= len(lines) <= watch.seconds + 2
    assert link.peer.state == "different"


def test_without_hello_the_link_only_listens() -> None:
    with linked(NATIVE, hello=False) as (link, mcu):
        mcu.write(hello(OWN))
        wait_until(lambda: link.peer.state == "same", "the hello")
        assert hellos(mcu) == []


def test_hello_still_comes_to_the_program() -> None:
    with linked(NATIVE, lambda m: hello(OWN) if m.name == "hello" else b"") as (link, _):
        assert next(iter(link)).name == "hello"


def test_a_file_without_hello_says_so_and_sends_nothing() -> None:
    with linked(manipulator()) as (link, mcu):
        assert link.peer.state == "unknown"
        assert "manipulator maps no `hello` service" in link.peer.why
        link.send("lamp", level=1)
        wait_until(lambda: mcu.heard, "the lamp")
        assert [m.name for m in mcu.heard] == ["lamp"]


def test_fields_of_the_authors_are_sent_as_zero() -> None:
    text = """
wirebond: 1
protocol: more
frame: [magic: 0xA5, id: u8, payload: by_id, check: crc-16/modbus]
messages:
  hello:
    id: 1
    sender: both
    fields:
      protocol_hash: {type: u64}
      version: {type: u8}
      board: {type: u8, enum: {small: 3, large: 4}}
      weights: {type: f32, count: 2, range: [0.5, 1.0]}
services: {hello: {message: hello}}
"""
    with linked(wirebond.Codec(loads(text))) as (_, mcu):
        wait_until(lambda: mcu.heard, "hello")
        assert mcu.heard[0]["board"] == "small"
        assert mcu.heard[0]["weights"] == [0.5, 0.5]


# ---- when to ask, without a link


def test_a_peer_that_does_not_answer_is_asked_less_and_less_often() -> None:
    book = PeerBook(NATIVE)
    book.connected(0.0)
    asked = []
    for tenth in range(3000):
        t = tenth / 10
        if book.is_due(t):
            asked.append(t)
            book.asked(t)
    gaps = [b - a for a, b in pairwise(asked)]
    assert gaps[0] == pytest.approx(FIRST_WAIT, abs=0.11)
    assert gaps[-1] == pytest.approx(LAST_WAIT, abs=0.11)


def test_a_hello_that_was_not_asked_for_is_a_restart_and_is_answered_once() -> None:
    book = PeerBook(NATIVE)
    book.connected(0.0)
    book.asked(0.0)
    assert book.heard(OWN, 1, 0.1)
    assert not book.is_due(100.0)
    assert not book.heard(OWN, 1, 100.0)  # told already
    assert (book.restarts, book.peer.since) == (1, 100.0)
    assert book.is_due(100.0)
    book.asked(100.0)
    assert not book.heard(OWN, 1, 100.1)  # the answer
    assert book.restarts == 1
    assert not book.is_due(200.0)


def test_after_a_reconnect_the_peer_is_unknown_until_it_answers() -> None:
    book = PeerBook(NATIVE)
    book.connected(0.0)
    book.asked(0.0)
    book.heard(OWN + 1, 1, 0.1)
    assert book.peer.state == "different"
    book.connected(5.0)
    assert book.peer.state == "unknown"
    assert book.is_due(5.0)
    assert not book.heard(OWN + 1, 1, 4.9)  # came before
    assert book.peer.state == "unknown"
    assert book.heard(OWN, 2, 5.1)
    assert (book.peer.state, book.peer.version, book.peer.since) == ("same", 2, 5.1)


def test_after_a_reconnect_another_peer_is_known(tmp_path: Path) -> None:
    name = tmp_path / "mcu"
    old = Mcu(NATIVE, lambda m: hello(OWN) if m.name == "hello" else b"")
    name.symlink_to(old.path)
    with wirebond.open(NATIVE, name) as link:
        wait_until(lambda: link.peer.state == "same", "the first hello")
        name.unlink()
        old.close()
        wait_until(lambda: link.state == "down", "the end of the port")
        new = Mcu(NATIVE, lambda m: hello(5) if m.name == "hello" else b"")
        name.symlink_to(new.path)
        try:
            wait_until(lambda: link.peer.state == "different", "the hello of the other peer")
        finally:
            new.close()
