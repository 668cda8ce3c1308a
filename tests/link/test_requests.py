"""A request gets its reply: by its address, by the fields that the reply carries back, and by order."""

from __future__ import annotations

import os
import queue
import signal
import threading
import time
from collections.abc import Callable
from typing import Any

import pytest

import wirebond
from tests.link.mcu import linked
from tests.link.protocol import without_deadlines
from tests.shared import ROOT
from tests.waiting import PATIENCE, let_pass, moments, wait_until
from wirebond import LinkDownError, Message, RequestTimeoutError, UsageError
from wirebond.link.requests import Question, RequestBook
from wirebond.protocol import loads

pytestmark = [pytest.mark.live, pytest.mark.usefixtures("links")]

ARM = without_deadlines()
BUS = wirebond.load(ROOT / "tests" / "formats" / "servo_options.yaml")
BY_REQUEST = wirebond.load(ROOT / "tests" / "formats" / "by_request.yaml")
VALUES = wirebond.Codec(
    loads("""
wirebond: 1
protocol: values
frame: [magic: 0xA5, id: u8, payload: by_id, check: crc-16/modbus]
messages:
  read:  {id: 1, sender: host, reply: value, fields: {index: {type: u8}}}
  value: {id: 2, sender: mcu, fields: {index: {type: u8}, content: {type: u16}}}
""")
)

SET_POINTS = wirebond.Codec(
    loads("""
wirebond: 1
protocol: set_points
frame: [magic: 0xA5, id: u8, payload: by_id, check: crc-16/modbus]
messages:
  set: {id: 1, sender: host, reply: now, fields: {joint: {type: u8}, angle: {type: i16, scale: 0.001}}}
  now: {id: 2, sender: mcu, fields: {joint: {type: u8}, angle: {type: i16, scale: 0.001}}}
""")
)


def pose(message: Message) -> bytes:
    return ARM.encode("pose", x=41) if message.name == "query" else b""


# ---- over a pty


def test_a_request_returns_its_reply() -> None:
    with linked(ARM, pose) as (link, _):
        reply = link.request("query")
        assert (reply.name, reply["x"]) == ("pose", 41)
        assert link.receive() == []  # it was taken


def test_a_typed_request_returns_a_typed_reply(diffdrive: Any) -> None:
    status = diffdrive.Status(battery=12.0, errors=diffdrive.StatusErrors(0), state=diffdrive.StatusState(0))
    with linked(diffdrive.codec, lambda _: status.encode()) as (link, _):
        assert link.request(diffdrive.StatusQuery()) == status
        assert link.request("status_query")["battery"] == 12.0


def test_handlers_see_a_reply_as_well() -> None:
    seen: list[int] = []
    with linked(ARM, pose) as (link, _):
        link.on("pose")(lambda message: seen.append(message["x"]))
        assert link.request("query")["x"] == 41
        wait_until(lambda: seen == [41], "the handler is called")
        assert link.receive() == []


def test_a_handler_can_ask() -> None:
    replies: list[int] = []
    with linked(VALUES, lambda m: VALUES.encode("value", index=m["index"], content=9)) as (link, mcu):

        @link.on("value")
        def ask(message: Message) -> None:
            if message["index"] == 200:
                replies.append(link.request("read", index=1)["index"])

        mcu.send("value", index=200, content=0)
        wait_until(lambda: replies, "the handler has its reply")
        assert replies == [1]


def test_threads_that_ask_the_same_at_once_get_their_own_replies() -> None:
    """While another thread iterates, and handlers are called."""
    wrong: list[str] = []
    taken: list[Message] = []
    seen: list[int] = []

    def answer(message: Message) -> bytes:
        return VALUES.encode("value", index=message["index"], content=message["index"] * 3)

    with linked(VALUES, answer) as (link, _):
        link.on("unknown")(lambda _: None)
        loop = threading.Thread(target=lambda: taken.extend(link))
        loop.start()

        def ask(number: int) -> None:
            for turn in range(60):
                index = (number * 60 + turn) % 256
                reply = link.request("read", index=index, timeout=PATIENCE)
                seen.append(1)
                if (reply["index"], reply["content"]) != (index, index * 3):
                    wrong.append(f"{index}: {reply.fields}")

        threads = [threading.Thread(target=ask, args=(number,)) for number in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        link.close()
        loop.join()
        assert len(seen) == 240
        assert wrong == []
        assert taken == []


def test_each_address_gives_its_own_reply() -> None:
    """The servos answer in the reverse order."""
    waiting: list[bytes] = []

    def answer(message: Message) -> bytes:
        servo = message.header["servo"]
        waiting.insert(0, BUS.encode("state", angle=servo / 10, voltage=0, header={"servo": servo}))
        return b"".join(waiting) if len(waiting) == 3 else b""

    replies: dict[int, float] = {}
    with linked(BUS, answer) as (link, _):

        def ask(servo: int) -> None:
            replies[servo] = link.request("ask", header={"servo": servo}, timeout=PATIENCE)["angle"]

        threads = [threading.Thread(target=ask, args=(servo,)) for servo in (3, 4, 5)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert replies == {3: 0.3, 4: 0.4, 5: 0.5}


def test_the_reply_to_a_plain_send_is_not_taken() -> None:
    number = iter(range(100))
    with linked(ARM, lambda _: ARM.encode("pose", x=next(number))) as (link, _):
        link.send("query")
        assert link.request("query", timeout=PATIENCE)["x"] == 1
        assert [m["x"] for m in link.receive(PATIENCE)] == [0]


def test_a_message_before_a_request_is_not_its_reply() -> None:
    with linked(ARM, pose) as (link, mcu):
        mcu.send("pose", x=1)
        wait_until(lambda: link.stats.receive.frames == 1, "it came")
        let_pass(0.1)
        assert link.request("query", timeout=PATIENCE)["x"] == 41
        assert [m["x"] for m in link.receive(PATIENCE)] == [1]


def test_if_only_the_request_identifies_a_reply_one_is_under_way_at_a_time() -> None:
    under_way: list[str] = []

    def answer(message: Message) -> bytes:
        under_way.append(message.name)
        let_pass(0.005)
        if message.name == "read_speed":
            return BY_REQUEST.encode("speed", speed=0.5)
        state = {f.name: 0 for f in BY_REQUEST.model.message("state").fields}
        return BY_REQUEST.encode("state", state)

    wrong: list[str] = []
    with linked(BY_REQUEST, answer) as (link, _):

        def ask(request: str, reply: str) -> None:
            for _ in range(10):
                found = link.request(request, timeout=PATIENCE).name
                if found != reply:
                    wrong.append(found)

        threads = [
            threading.Thread(target=ask, args=pair) for pair in (("read_speed", "speed"), ("read_state", "state"))
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert wrong == []
    assert len(under_way) == 20


# ---- no reply


def test_a_request_without_a_reply_says_what_to_look_at() -> None:
    with linked(BUS) as (link, mcu):
        with pytest.raises(RequestTimeoutError) as raised:
            link.request("ask", header={"servo": 3}, timeout=0.05)
        assert str(raised.value) == (
            "no state from servo 3 within 0.05 s of ask. "
            "Nothing at all comes; check the cable, the baud rate, and that the MCU runs"
        )
        assert isinstance(raised.value, TimeoutError)
        assert (raised.value.message, raised.value.reply, raised.value.timeout) == ("ask", "state", 0.05)
        for _ in moments("a request while the other servo is heard"):
            mcu.send("state", {"servo": 4}, angle=0, voltage=0)
            wait_until(lambda: link.state == "up", "the other servo is heard")
            with pytest.raises(RequestTimeoutError) as raised:
                link.request("ask", header={"servo": 3}, timeout=0.05)
            if "Nothing at all comes" not in str(raised.value):  # as behind a pause
                break
        raised.match(r"nothing arrived in that time\. .* answers ask, and the address$")


def test_a_late_reply_goes_to_the_loop_and_not_to_the_next_request() -> None:
    asked: list[Message] = []
    with linked(VALUES, lambda m: asked.append(m) or b"") as (link, mcu):
        with pytest.raises(RequestTimeoutError):
            link.request("read", index=1, timeout=0.05)
        replies: queue.SimpleQueue[Message] = queue.SimpleQueue()
        thread = threading.Thread(target=lambda: replies.put(link.request("read", index=2, timeout=PATIENCE)))
        thread.start()
        wait_until(lambda: len(asked) == 2, "the second is under way")
        mcu.send("value", index=1, content=1)
        mcu.send("value", index=2, content=2)
        assert replies.get()["content"] == 2
        thread.join()
        assert [m["content"] for m in link.receive(PATIENCE)] == [1]


def once_it_is_asked(link: wirebond.Link, act: Callable[[], object]) -> threading.Thread:
    """A thread that does this when a request has left."""

    def run() -> None:
        wait_until(lambda: link.stats.send.sent, "the request leaves")
        act()

    thread = threading.Thread(target=run)
    thread.start()
    return thread


def test_a_request_ends_when_the_link_is_closed() -> None:
    with linked(ARM) as (link, _):
        thread = once_it_is_asked(link, link.close)
        with pytest.raises(LinkDownError, match="was closed before the reply to query came"):
            link.request("query", timeout=PATIENCE)
        thread.join()
        with pytest.raises(LinkDownError, match="is closed; query was not sent"):
            link.request("query")


def test_a_signal_ends_a_request() -> None:
    class AlarmError(Exception):
        pass

    def ring(*_: object) -> None:
        raise AlarmError

    before = signal.signal(signal.SIGALRM, ring)
    try:
        with linked(ARM) as (link, mcu):
            thread = once_it_is_asked(link, lambda: os.kill(os.getpid(), signal.SIGALRM))
            with pytest.raises(AlarmError):
                link.request("query", timeout=PATIENCE)
            thread.join()
            mcu.send("pose", x=3)
            assert [m["x"] for m in link.receive(PATIENCE)] == [3]  # no request waits for it any more
    finally:
        signal.signal(signal.SIGALRM, before)


def test_a_signal_handler_can_ask_while_the_program_waits() -> None:
    replies: list[int] = []
    with linked(ARM, pose) as (link, _):
        before = signal.signal(signal.SIGALRM, lambda *_: replies.append(link.request("query", timeout=PATIENCE)["x"]))
        try:
            signal.setitimer(signal.ITIMER_REAL, 0.05)
            assert link.receive(1) == []
        finally:
            signal.signal(signal.SIGALRM, before)
        assert replies == [41]


def test_impossible_requests_are_refused() -> None:
    with linked(ARM) as (link, _):
        with pytest.raises(UsageError, match=r"lamp has no `reply` in manipulator; messages that have one: query"):
            link.request("lamp", level=1)
        for timeout in (0, -1, float("nan"), 1e9):
            with pytest.raises(UsageError, match="expected more than 0 and at most 3600 s"):
                link.request("query", timeout=timeout)
        assert link.stats.send.offered == 0


# ---- the book alone


class Told:
    """Questions of one kind, and what became of each."""

    def __init__(self, codec: wirebond.Codec, request: str) -> None:
        self.codec = codec
        self.book = RequestBook(codec)
        self.request = request
        self._decoder = codec.decoder("mcu")
        self.replies: dict[int, Any] = {}
        self._count = 0

    def ask(self, *, waits: bool = True, header: dict[str, Any] | None = None, **values: Any) -> Question:
        number = self._count
        self._count += 1
        frame = self.codec.encode(self.request, values, header=header)
        finish: Callable[[Any], None] | None = (lambda got: self.replies.update({number: got})) if waits else None
        question = self.book.question(self.request, frame, header or {}, finish)
        self.book.submit(question)
        return question

    def hear(self, name: str, header: dict[str, Any] | None = None, **values: Any) -> bool:
        (message,) = self._decoder.feed(self.codec.encode(name, values, header=header, sender="mcu"), time.monotonic())
        return self.book.take(message)


def test_replies_go_in_the_order_of_the_requests() -> None:
    told = Told(ARM, "query")
    told.ask()
    told.ask(waits=False)
    told.ask()
    assert told.hear("pose", x=0)
    assert not told.hear("pose", x=1)
    assert told.hear("pose", x=2)
    assert not told.hear("pose", x=3)
    assert {number: reply["x"] for number, reply in told.replies.items()} == {0: 0, 2: 2}


def test_a_reply_that_carries_values_back_skips_a_request_whose_reply_is_lost() -> None:
    told = Told(VALUES, "read")
    told.ask(index=1)
    told.ask(index=2)
    assert told.hear("value", index=2, content=0)
    assert list(told.replies) == [1]
    assert told.hear("value", index=1, content=0)


def test_a_reply_to_what_was_not_asked_completes_no_request() -> None:
    told = Told(VALUES, "read")
    told.ask(index=1)
    told.ask(index=2)
    assert not told.hear("value", index=77, content=0)
    assert told.hear("value", index=1, content=0)
    assert list(told.replies) == [0]


def test_a_request_whose_peer_answers_another_one_says_so() -> None:
    with linked(VALUES, lambda _: VALUES.encode("value", index=77, content=0)) as (link, _):
        for _ in moments("an answer within the time of its request"):
            with pytest.raises(RequestTimeoutError) as raised:
                link.request("read", index=1, timeout=0.1)
            if "A value came with index 77, but index 1 was asked for" in str(raised.value):
                break
        assert {m["index"] for m in link.receive(PATIENCE)} == {77}


def test_a_measure_may_come_back_as_another_one() -> None:
    """A set point that the peer clamped."""
    told = Told(SET_POINTS, "set")
    told.ask(joint=1, angle=9.0)
    told.ask(joint=2, angle=9.0)
    assert told.hear("now", joint=2, angle=1.5)
    assert told.hear("now", joint=1, angle=1.5)
    assert list(told.replies) == [1, 0]


def test_a_request_to_all_takes_the_first_reply_of_anybody() -> None:
    told = Told(BUS, "ask")
    told.ask(header={"servo": 0xFE})
    assert told.hear("state", {"servo": 7}, angle=0, voltage=0)
    told.ask(header={"servo": 3})
    assert not told.hear("state", {"servo": 7}, angle=0, voltage=0)
    assert told.hear("state", {"servo": 3}, angle=0, voltage=0)


def test_a_given_up_request_takes_no_reply_that_may_be_anothers() -> None:
    told = Told(ARM, "query")
    first = told.ask()
    told.book.withdraw(first)
    told.ask()
    assert told.hear("pose", x=1)
    assert list(told.replies) == [1]


def test_plain_sends_are_forgotten() -> None:
    told = Told(ARM, "query")
    for _ in range(3000):
        told.ask(waits=False)
    assert len(told.book._asked["pose"]) <= 1024
    for question in told.book._asked["pose"]:
        question.until = 0.0  # their time is over
    told.ask()
    assert told.hear("pose", x=1)
    assert list(told.replies) == [3000]


def test_a_send_that_is_refused_is_not_waited_for() -> None:
    told = Told(ARM, "query")

    def refuse() -> None:
        raise LinkDownError("away")

    question = told.book.question("query", b"", {}, None)
    question.leave = refuse
    with pytest.raises(LinkDownError):
        told.book.submit(question)
    told.ask()
    assert told.hear("pose", x=1)
