"""A request without a reply says what arrived instead: on a link of one's own, attached, and to clients in JSON."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import pytest

import wirebond
from tests.server.conftest import Served
from tests.server.test_clients import json_client
from tests.waiting import wait_until
from wirebond import RequestTimeoutError
from wirebond.chinese import chinese
from wirebond.link.arrivals import Arrivals

pytestmark = pytest.mark.live

NEVER = 3600.0  # seconds: the test ends the wait itself
CAME = "3 other messages arrived: odometry 3; 11 bytes were discarded: check_mismatch"


def chatter(served: Served) -> None:
    """Three messages that are not a reply, and a damaged one."""
    odometry = served.codec.encode("odometry", left_ticks=1, right_ticks=2)
    damaged = odometry[:-2] + bytes([odometry[-2] ^ 1]) + odometry[-1:]
    served.pty.write(odometry + damaged + odometry * 2)


def timed_out(link: wirebond.Link, meanwhile: Callable[[], None]) -> str:
    """The sentence of a request that is given up behind what happens meanwhile."""
    asked = link._ask("status_query", None, NEVER, None, {}, lambda _: None)
    meanwhile()
    link.internals.inbox.requests.withdraw(asked.question)
    return str(asked.timeout_error())


def settled(served: Served, frames: int) -> None:
    wait_until(lambda: served.link.stats.receive.frames >= frames and not served.link.stats.receive.pending_bytes)


@pytest.mark.parametrize("is_attached", [False, True])
def test_it_says_which_messages_came_and_what_was_discarded(served: Served, is_attached: bool) -> None:
    link = served.attach() if is_attached else served.link
    chatter(served)  # before the request: not counted
    settled(served, 3)

    def meanwhile() -> None:
        chatter(served)
        settled(served, 6)

    assert timed_out(link, meanwhile) == (
        f"no status within 3600 s of status_query; meanwhile {CAME}. Check that the MCU answers status_query"
    )
    assert timed_out(link, lambda: None) == (
        "no status within 3600 s of status_query; nothing arrived in that time. Give it more time, or check that the "
        "MCU answers status_query"
    )
    if is_attached:
        link.close()


@pytest.mark.parametrize("is_attached", [False, True])
def test_bytes_that_are_no_frame_point_to_the_line(served: Served, is_attached: bool) -> None:
    link = served.attach() if is_attached else served.link

    def meanwhile() -> None:
        served.pty.write(b"\x01\x02\x03\x04")
        wait_until(lambda: served.link.stats.receive.discarded_bytes["no_start"] == 4)

    assert timed_out(link, meanwhile) == (
        "no status within 3600 s of status_query; meanwhile 4 bytes were discarded: no_start. Check the baud rate, and "
        "that both ends use the same protocol file"
    )
    if is_attached:
        link.close()


@pytest.mark.parametrize("is_attached", [False, True])
def test_a_coroutine_gets_the_same_sentence(served: Served, is_attached: bool) -> None:
    """The time that the other messages take is not known, so that it asks until they came in time."""
    link = served.attach() if is_attached else served.link

    async def ask(timeout: float) -> str:
        task = asyncio.create_task(link.aio.request("status_query", timeout=timeout))
        await asyncio.sleep(0)
        chatter(served)
        with pytest.raises(RequestTimeoutError) as raised:
            await task
        return str(raised.value)

    sentences = (asyncio.run(ask(0.1 * 2**n)) for n in range(8))
    assert any(CAME in sentence for sentence in sentences)
    if is_attached:
        link.close()


def test_a_client_in_json_gets_it_in_both_languages(served: Served) -> None:
    with json_client(served) as client:
        for n in range(8):
            client.send({"do": "send", "id": 5 + n, "message": "status_query", "fields": {}, "reply": 0.1 * 2**n})
            client.next(lambda said, number=5 + n: said.get("re") == number)  # type: ignore[misc]
            chatter(served)
            event = client.next(lambda said: said.get("event") == "no_reply")
            if CAME in event["text"]:
                break
        assert event["text"] == (
            f"no status within {0.1 * 2**n:g} s of status_query; meanwhile {CAME}. Check that the MCU answers "
            "status_query"
        )
        assert event["text_zh"] == (
            f"status_query 之后 {0.1 * 2**n:g} s 内没有收到 status；期间收到其他消息 3 条：odometry 3；"  # noqa: RUF001
            "丢弃 11 个字节：check_mismatch。请检查下位机是否应答 status_query"  # noqa: RUF001
        )


def test_many_kinds_are_listed_with_the_most_frequent_first() -> None:
    counts = {"a": 1, "b": 5, "c": 2, "d": 2, "e": 1, "f": 1}
    arrived = Arrivals.between(
        {"messages": {"a": 1}, "unknown_frames": 1, "foreign_frames": 0, "discarded_bytes": {}},
        {
            "messages": {**counts, "a": 2},
            "unknown_frames": 2,
            "foreign_frames": 2,
            "discarded_bytes": {"no_start": 1, "check_mismatch": 0},
        },
    )
    assert arrived.text == (
        "12 other messages arrived: b 5, c 2, d 2, a 1 and 2 more kinds; 1 frame of unknown messages arrived; "
        "2 frames of other addresses arrived; 1 byte was discarded: no_start"
    )
    assert chinese(arrived.text) == (
        "收到其他消息 12 条：b 5, c 2, d 2, a 1，以及另外 2 种；"  # noqa: RUF001
        "收到未知消息的帧 1 个；收到其他地址的帧 2 个；丢弃 1 个字节：no_start"  # noqa: RUF001
    )
    assert Arrivals({}, 0, 0, {}).text == ""
