"""Handlers of received messages, the newest message, and deadlines that call."""

from __future__ import annotations

import asyncio
import logging
import threading
from typing import Any

import pytest

import wirebond
from tests.link.mcu import linked
from tests.link.protocol import manipulator, without_deadlines
from tests.shared import ROOT
from tests.waiting import PATIENCE, Stopwatch, let_pass, wait_until
from wirebond import DeadlineEvent, LinkDownError, Message, UsageError
from wirebond.link import ending
from wirebond.protocol import loads

pytestmark = [pytest.mark.live, pytest.mark.usefixtures("links")]

ARM = manipulator()
CALM = without_deadlines()
BUS = wirebond.load(ROOT / "tests" / "formats" / "servo_options.yaml")
TWO = wirebond.Codec(
    loads("""
wirebond: 1
protocol: two
frame: [magic: 0xA5, id: u8, payload: by_id, check: crc-16/modbus]
messages:
  one:   {id: 1, sender: mcu, fields: {n: {type: u16}}}
  other: {id: 2, sender: mcu, fields: {n: {type: u16}}}
""")
)


def all_came(link: wirebond.Link, name: str, last: int) -> None:
    """Here, and not only at the server that an attached link has."""
    wait_until(lambda: (newest := link.latest(name)) and newest.message["n"] == last, "all came")


# ---- the newest


@pytest.mark.parametrize("has_thread", [False, True])
def test_the_newest_message_is_there_and_stays_in_the_loop(has_thread: bool) -> None:
    with linked(TWO) as (link, mcu):
        if has_thread:
            link.on("other")(lambda _: None)
        assert link.latest("one") is None
        watch = Stopwatch()
        mcu.send("one", n=1)
        mcu.send("one", n=2)
        all_came(link, "one", last=2)
        one = link.latest("one")
        assert one is not None
        assert one.t == one.message.t
        assert 0 <= one.age <= watch.seconds
        assert [m["n"] for m in link.receive()] == [1, 2]
        assert (again := link.latest("one")) is not None
        assert again.message["n"] == 2


def test_the_newest_is_known_also_where_a_loop_took_it() -> None:
    with linked(CALM) as (link, mcu):
        mcu.send("pose", x=7)
        assert next(iter(link))["x"] == 7
        assert (pose := link.latest("pose")) is not None
        assert pose.message["x"] == 7


def test_each_sender_has_its_newest() -> None:
    with linked(BUS) as (link, mcu):
        state = BUS.model.message("state")
        values = {f.name: 0 for f in state.fields}
        for servo in (3, 7):
            link.send("ask", header={"servo": servo})
        wait_until(lambda: len(mcu.heard) == 2, "both were asked")
        mcu.send("state", {"servo": 3}, **values)
        mcu.send("state", {"servo": 7}, **values)
        wait_until(lambda: link.latest("state", header={"servo": 7}), "the newest of 7")
        for servo in (3, 7):
            found = link.latest("state", header={"servo": servo})
            assert found is not None
            assert found.message.header["servo"] == servo
        assert (any_one := link.latest("state")) is not None
        assert any_one.message.header["servo"] == 7
        assert link.latest("state", header={"servo": 9}) is None
        with pytest.raises(UsageError, match="give servo"):
            link.latest("state", header={})


def test_the_newest_of_a_message_that_never_comes_is_refused() -> None:
    with linked(ARM) as (link, _):
        with pytest.raises(UsageError, match="drive is sent by the host"):
            link.latest("drive")
        with pytest.raises(UsageError, match="no message 'posse'"):
            link.latest("posse")
        with pytest.raises(UsageError, match="name the sender of the message; leave out header="):
            link.latest("pose", header={})


# ---- handlers


def test_every_handler_of_a_message_is_called_in_order_by_one_thread() -> None:
    calls: list[tuple[str, int, str]] = []
    with linked(TWO) as (link, mcu):

        @link.on("one")
        def first(message: Message) -> None:
            calls.append(("first", message["n"], threading.current_thread().name))

        @link.on()
        def all_of_them(message: Message) -> None:
            calls.append(("all", message["n"], threading.current_thread().name))

        @link.on("one")
        def second(message: Message) -> None:
            calls.append(("second", message["n"], threading.current_thread().name))

        for n in range(100):
            mcu.send("one", n=n)
            mcu.send("other", n=n)
        wait_until(lambda: len(calls) == 400, "all were called")
        expected = [(who, n) for n in range(100) for who in ("first", "all", "second", "all")]
        assert [(who, n) for who, n, _ in calls] == expected
        assert {thread for _, _, thread in calls} == {f"handlers of {link.port}"}
        assert link.receive() == []
        assert link.stats.dropped_messages == 0


def test_while_a_handler_runs_the_link_goes_on() -> None:
    seen: list[int] = []
    begun, may_end = threading.Event(), threading.Event()
    with linked(TWO) as (link, mcu):

        @link.on("one")
        def waits(message: Message) -> None:
            begun.set()
            assert may_end.wait(PATIENCE)
            seen.append(message["n"])

        mcu.send("one", n=0)
        assert begun.wait(PATIENCE)
        for n in range(1, 20):
            mcu.send("one", n=n)
            mcu.send("other", n=n)
        got = [message["n"] for _, message in zip(range(19), link, strict=False)]
        assert got == list(range(1, 20))
        assert (one := link.latest("one")) is not None
        assert one.message["n"] == 19
        assert seen == []
        may_end.set()
        wait_until(lambda: len(seen) == 20, "the handler has had its own")
        assert seen == list(range(20))


def test_handlers_that_are_slow_now_and_then_get_every_message_in_order() -> None:
    """Two threads get messages from the engine in turns then."""
    seen: list[int] = []
    with linked(TWO) as (link, mcu):

        @link.on("one")
        def counts(message: Message) -> None:
            if message["n"] % 7 == 0:
                let_pass(0.003)
            seen.append(message["n"])

        for n in range(300):
            mcu.send("one", n=n)
            if n % 3 == 0:
                let_pass(0.001)
        wait_until(lambda: len(seen) == 300, "all have come")
        assert seen == list(range(300))
        assert link.stats.dropped_messages == 0


def test_a_message_without_a_handler_is_for_the_loop() -> None:
    seen: list[int] = []
    with linked(TWO) as (link, mcu):
        link.on("one")(lambda message: seen.append(message["n"]))
        for n in range(50):
            mcu.send("one", n=n)
            mcu.send("other", n=n)
        got = [message for _, message in zip(range(50), link, strict=False)]
        assert [(m.name, m["n"]) for m in got] == [("other", n) for n in range(50)]
        wait_until(lambda: len(seen) == 50, "the handler has had its own")
        assert seen == list(range(50))


def test_a_loop_that_waits_goes_on_when_handlers_begin() -> None:
    """It took from the engine itself; now the link's thread does, and no message is lost or comes twice between."""
    for _ in range(5):
        seen: list[int] = []
        taken: list[int] = []
        with linked(TWO) as (link, mcu):
            thread = threading.Thread(target=lambda: taken.extend(m["n"] for m in link))  # noqa: B023
            thread.start()
            for n in range(300):
                mcu.send("one", n=n)
                if n == 100:
                    link.on("other")(lambda message: seen.append(message["n"]))  # noqa: B023
                mcu.send("other", n=n)
                if n % 20 == 0:
                    let_pass(0.001)
            all_came(link, "other", 299)
        thread.join()
        assert len(taken) + len(seen) == 600
        assert seen == list(range(300))[-len(seen) :]
        assert [n for n in taken if n >= 150] == list(range(150, 300))


def test_an_exception_of_a_handler_is_reported_and_counted(caplog: pytest.LogCaptureFixture) -> None:
    seen: list[int] = []
    with caplog.at_level(logging.ERROR, logger="wirebond"), linked(TWO) as (link, mcu):

        @link.on("one")
        def breaks(message: Message) -> None:
            if message["n"] == 5:
                raise SystemExit("a handler does not end the program")
            raise ValueError(message["n"])

        link.on("one")(lambda message: seen.append(message["n"]))
        for n in range(20):
            mcu.send("one", n=n)
        wait_until(lambda: len(seen) == 20, "the other handler goes on")
        assert link.stats.handler_errors == 20
        assert len(caplog.records) == 1  # once a second for each handler
        assert "breaks of" in caplog.text
        assert "raised ValueError; the link goes on" in caplog.text


def test_a_removed_handler_is_not_called_and_its_messages_are_for_the_loop() -> None:
    began, go_on = threading.Event(), threading.Event()
    seen: list[int] = []
    with linked(TWO) as (link, mcu):

        @link.on("one")
        def slow(message: Message) -> None:
            seen.append(message["n"])
            began.set()
            go_on.wait()

        for n in range(5):
            mcu.send("one", n=n)
        began.wait()
        link.off(slow)
        go_on.set()
        got: list[int] = []
        wait_until(lambda: got.extend(m["n"] for m in link.receive(0.01)) or len(got) == 4, "the rest")
        assert seen == [0]
        assert sorted(got) == [1, 2, 3, 4]  # those that had waited for it may come behind newer ones
        with pytest.raises(UsageError, match="is not a handler of this link"):
            link.off(slow)


def test_close_gives_handlers_earlier_messages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ending, "HANDLERS_PATIENCE", PATIENCE)
    seen: list[int] = []

    def slow(message: Message) -> None:
        let_pass(0.001)
        seen.append(message["n"])

    with linked(TWO) as (link, mcu):
        link.on("one")(slow)
        for n in range(100):
            mcu.send("one", n=n)
        all_came(link, "one", 99)
        link.close()
        assert seen == list(range(100))


def test_a_handler_that_hangs_does_not_hold_close_up() -> None:
    began, go_on = threading.Event(), threading.Event()
    with linked(TWO) as (link, mcu):
        link.on("one")(lambda _: began.set() or go_on.wait())
        for n in range(10):
            mcu.send("one", n=n)
        assert began.wait(PATIENCE)
        all_came(link, "one", 9)
        link.close()
        assert link.stats.dropped_messages == 9
        go_on.set()


def test_a_handler_can_close_the_link_and_run_ends() -> None:
    seen: list[int] = []
    with linked(TWO) as (link, mcu):

        @link.on("one")
        def until_three(message: Message) -> None:
            seen.append(message["n"])
            if message["n"] == 3:
                link.close()

        assert not link.run(0.01)
        for n in range(4):
            mcu.send("one", n=n)
        assert link.run()
        assert seen == [0, 1, 2, 3]
        with pytest.raises(LinkDownError):
            link.receive()


def test_slow_handlers_drop_the_oldest_and_count_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wirebond.link.handlers.MAX_WAITING", 10)
    began, go_on = threading.Event(), threading.Event()
    seen: list[int] = []
    with linked(TWO) as (link, mcu):

        @link.on("one")
        def slow(message: Message) -> None:
            seen.append(message["n"])
            began.set()
            go_on.wait()

        mcu.send("one", n=0)
        began.wait()
        for n in range(1, 31):
            mcu.send("one", n=n)
        wait_until(lambda: link.stats.dropped_messages == 20, "the oldest are dropped")
        go_on.set()
        wait_until(lambda: len(seen) == 11, "the newest are handled")
        assert seen == [0, *range(21, 31)]


def test_untaken_messages_are_dropped_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wirebond.link.inbox.MAX_WAITING", 10)
    with linked(TWO) as (link, mcu):
        link.on("other")(lambda _: None)
        for n in range(30):
            mcu.send("one", n=n)
        wait_until(lambda: link.stats.dropped_messages == 20, "the oldest are dropped")
        assert [m["n"] for m in link.receive()] == list(range(20, 30))


def test_a_handler_of_nothing_is_refused() -> None:
    async def coroutine(_: Message) -> None: ...

    with linked(ARM) as (link, _):
        for name, sentence in (("drive", "drive is sent by the host"), ("posse", "no message 'posse'")):
            with pytest.raises(UsageError, match=sentence):
                link.on(name)(lambda _: None)
        with pytest.raises(UsageError, match=r"register it with link\.aio\.on"):
            link.on("pose")(coroutine)
        with pytest.raises(UsageError, match=r"write @link\.on\(\) for all"):
            link.on(lambda _: None)  # type: ignore[call-overload]
        with pytest.raises(UsageError, match="int is not a message of a generated module"):
            link.on(int)(lambda _: None)  # type: ignore[type-var]
        with pytest.raises(UsageError, match="running event loop"):
            _ = link.aio
        assert asyncio.run(_aio_refuses(link)) is None


async def _aio_refuses(link: wirebond.Link) -> None:
    with pytest.raises(UsageError, match="is not a coroutine function"):
        link.aio.on("pose")(lambda _: None)  # type: ignore[arg-type, return-value]


# ---- deadlines


def test_a_deadline_calls_when_it_strikes_and_when_it_ends() -> None:
    events: list[tuple[str, bool]] = []
    every: list[tuple[str, bool]] = []

    def note(event: DeadlineEvent) -> None:
        events.append((event.action, event.struck))

    with linked(ARM) as (link, mcu):
        link.on_deadline("warn")(note)
        link.on_deadline()(lambda event: every.append((event.action, event.struck)))
        wait_until(lambda: events, "it strikes")
        mcu.send("pose", x=1)
        wait_until(lambda: len(events) == 2, "it ends")
        assert events == [("warn", True), ("warn", False)]
        wait_until(lambda: ("halt", True) in every, "the other strikes")
        link.recover("halt")
        wait_until(lambda: ("halt", False) in every, "it is ended")
        late: list[Any] = []
        wait_until(lambda: link.deadlines["warn"], "it strikes again")
        link.on_deadline("warn")(late.append)
        wait_until(lambda: late, "a handler that is added later is called at once")
        link.off(note)
        with pytest.raises(UsageError, match="did you mean halt"):
            link.on_deadline("hallt")


def test_a_deadline_that_is_not_there_is_refused() -> None:
    with linked(TWO) as (link, _):
        for action in (None, "warn"):
            with pytest.raises(UsageError, match="nothing that could strike"):
                link.on_deadline(action)(lambda _: None)


# ---- typed


def test_typed_classes_stand_for_names(diffdrive: Any) -> None:
    seen: list[Any] = []
    with linked(diffdrive.codec) as (link, mcu):
        link.on(diffdrive.Status)(seen.append)
        assert link.latest(diffdrive.Status) is None
        mcu.send("status", battery=12.0, errors=["low_battery"], state=0)
        wait_until(lambda: seen, "the handler is called")
        assert seen[0] == diffdrive.Status(
            battery=12.0, errors=diffdrive.StatusErrors.LOW_BATTERY, state=diffdrive.StatusState(0)
        )
        latest = link.latest(diffdrive.Status)
        assert latest.message == seen[0]
        with pytest.raises(UsageError, match="velocity is sent by the host"):
            link.on(diffdrive.Velocity)(seen.append)
