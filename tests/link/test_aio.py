"""A link within asyncio: what waits does not hold the loop up, and what is cancelled loses nothing."""

from __future__ import annotations

import asyncio
import gc
import logging
import threading
import weakref
from typing import Any

import pytest

import wirebond
from tests.link.mcu import linked
from tests.link.protocol import manipulator, without_deadlines
from tests.link.test_requests import BUS, VALUES, pose
from tests.waiting import PATIENCE, let_pass, wait_until
from wirebond import DeadlineEvent, LinkDownError, Message, RequestTimeoutError
from wirebond.sim.pty_port import PtyPort

pytestmark = [pytest.mark.live, pytest.mark.usefixtures("links")]

ARM = without_deadlines()


def test_messages_come_by_async_for_until_the_link_is_closed() -> None:
    async def program(link: wirebond.Link, send: Any) -> list[int]:
        got: list[int] = []
        async with link.aio:
            send(range(10))
            async for message in link.aio:
                got.append(message["x"])
                if len(got) == 5:
                    break  # the rest is for the next loop
            async for message in link.aio:
                got.append(message["x"])
                if len(got) == 10:
                    asyncio.get_running_loop().call_later(0.02, link.close)
        return got

    with linked(ARM) as (link, mcu):
        got = asyncio.run(program(link, lambda numbers: [mcu.send("pose", x=n) for n in numbers]))
        assert got == list(range(10))
        with pytest.raises(LinkDownError):
            link.receive()


def test_the_loop_runs_while_a_task_waits() -> None:
    async def program(link: wirebond.Link) -> None:
        for waiting in (link.aio.receive(PATIENCE), link.aio.request("query", timeout=PATIENCE)):
            task = asyncio.create_task(waiting)
            for _ in range(20):  # the loop runs
                await asyncio.sleep(0.005)
            assert not task.done()
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
        with pytest.raises(TimeoutError):
            await link.aio.receive(0.3)
        with pytest.raises(RequestTimeoutError, match=r"no pose within 0\.3 s of query\. Nothing at all comes"):
            await link.aio.request("query", timeout=0.3)

    with linked(ARM) as (link, _):
        asyncio.run(program(link))


def test_many_tasks_ask_at_once_and_get_their_own_replies() -> None:
    def answer(message: Message) -> bytes:
        return VALUES.encode("value", index=message["index"], content=message["index"] * 3)

    async def program(link: wirebond.Link) -> list[Message]:
        before = threading.active_count()
        tasks = [asyncio.create_task(link.aio.request("read", index=i, timeout=PATIENCE)) for i in range(200)]
        await asyncio.sleep(0)
        assert threading.active_count() <= before + 1  # the link's thread
        return await asyncio.gather(*tasks)

    with linked(VALUES, answer) as (link, _):
        replies = asyncio.run(program(link))
        assert [(m["index"], m["content"]) for m in replies] == [(i, i * 3) for i in range(200)]
        assert link.receive() == []


def test_each_task_asks_its_own_address() -> None:
    def answer(message: Message) -> bytes:
        servo = message.header["servo"]
        return BUS.encode("state", angle=servo / 10, voltage=0, header={"servo": servo})

    async def program(link: wirebond.Link) -> list[float]:
        asking = (link.aio.request("ask", header={"servo": servo}, timeout=PATIENCE) for servo in range(1, 20))
        return [reply["angle"] for reply in await asyncio.gather(*asking)]

    with linked(BUS, answer) as (link, _):
        assert asyncio.run(program(link)) == [pytest.approx(servo / 10) for servo in range(1, 20)]


def test_a_cancelled_task_loses_no_message() -> None:
    async def program(link: wirebond.Link, send: Any) -> list[int]:
        got: list[int] = []

        async def one() -> None:
            got.append((await link.aio.receive())["x"])

        for n in range(200):
            task = asyncio.create_task(one())
            send(n)
            await asyncio.sleep(0.0005 * (n % 4))
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
        while len(got) < 200:
            got.append((await link.aio.receive(PATIENCE))["x"])
        return got

    with linked(ARM) as (link, mcu):
        assert asyncio.run(program(link, lambda n: mcu.send("pose", x=n))) == list(range(200))


def test_a_cancelled_request_leaves_its_reply_to_others() -> None:
    async def program(link: wirebond.Link, send: Any) -> int:
        task = asyncio.create_task(link.aio.request("query", timeout=PATIENCE))
        while not link.stats.send.sent:  # it waits for its reply
            await asyncio.sleep(0.001)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        send()
        return int((await link.aio.receive(PATIENCE))["x"])

    with linked(ARM) as (link, mcu):
        assert asyncio.run(program(link, lambda: mcu.send("pose", x=5))) == 5


def test_a_reply_that_comes_as_its_request_is_cancelled_is_not_lost() -> None:
    async def program(link: wirebond.Link) -> int:
        task = asyncio.create_task(link.aio.request("query", timeout=PATIENCE))
        await asyncio.sleep(0)
        wait_until(lambda: link.latest("pose"), "the reply is here, and the loop was not told yet")
        let_pass(0.05)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        return int((await link.aio.receive(PATIENCE))["x"])

    with linked(ARM, pose) as (link, _):
        assert asyncio.run(program(link)) == 41


def test_coroutine_handlers_run_in_the_loop_in_order(caplog: pytest.LogCaptureFixture) -> None:
    async def program(link: wirebond.Link, send: Any) -> list[int]:
        seen: list[int] = []
        all_seen = asyncio.Event()

        @link.aio.on("pose")
        async def note(message: Message) -> None:
            assert threading.current_thread() is threading.main_thread()
            await asyncio.sleep(0.002 if message["x"] % 2 else 0)
            seen.append(message["x"])
            if message["x"] == 10:
                raise ValueError("ten")
            if len(seen) == 50:
                all_seen.set()

        async with link.aio, asyncio.timeout(PATIENCE):
            send(range(50))
            await all_seen.wait()
            link.off(note)
        return seen

    with caplog.at_level(logging.ERROR, logger="wirebond"), linked(ARM) as (link, mcu):
        seen = asyncio.run(program(link, lambda numbers: [mcu.send("pose", x=n) for n in numbers]))
        assert seen == list(range(50))
        assert link.stats.handler_errors == 1
        assert "note of" in caplog.text
        assert "raised ValueError; the link goes on" in caplog.text


def test_close_gives_coroutine_handlers_earlier_messages() -> None:
    async def program(link: wirebond.Link, send: Any) -> list[int]:
        seen: list[int] = []

        @link.aio.on()
        async def note(message: Message) -> None:
            await asyncio.sleep(0.002)
            seen.append(message["x"])

        async with link.aio:
            send(range(50))
            await asyncio.to_thread(
                wait_until, lambda: (newest := link.latest("pose")) and newest.message["x"] == 49, "all came"
            )
        return seen

    with linked(ARM) as (link, mcu):
        assert asyncio.run(program(link, lambda ns: [mcu.send("pose", x=n) for n in ns])) == list(range(50))


def test_a_coroutine_handler_can_ask_and_close() -> None:
    async def program(link: wirebond.Link, send: Any) -> list[int]:
        replies: list[int] = []
        closed = asyncio.Event()

        @link.aio.on("pose")
        async def ask(message: Message) -> None:
            if message["x"] == 1:
                replies.append((await link.aio.request("query", timeout=PATIENCE))["x"])
                await link.aio.close()
                closed.set()

        send()
        async with asyncio.timeout(PATIENCE):
            await closed.wait()
        return replies

    with linked(ARM, pose) as (link, mcu):
        assert asyncio.run(program(link, lambda: mcu.send("pose", x=1))) == [41]
        with pytest.raises(LinkDownError):
            link.send("query")


def test_a_deadline_calls_a_coroutine() -> None:
    async def program(link: wirebond.Link) -> DeadlineEvent:
        struck: asyncio.Future[DeadlineEvent] = asyncio.get_running_loop().create_future()

        @link.aio.on_deadline("warn")
        async def note(event: DeadlineEvent) -> None:
            if not struck.done():
                struck.set_result(event)

        return await asyncio.wait_for(struck, PATIENCE)

    with linked(manipulator()) as (link, _):
        event = asyncio.run(program(link))
        assert (event.action, event.struck) == ("warn", True)


def test_a_handler_whose_loop_has_ended_is_counted() -> None:
    async def program(link: wirebond.Link) -> None:
        @link.aio.on("pose")
        async def note(_: Message) -> None: ...

    with linked(ARM) as (link, mcu):
        asyncio.run(program(link))
        mcu.send("pose", x=1)
        wait_until(lambda: link.stats.handler_errors == 1, "the message is counted")


def test_a_request_ends_when_the_link_is_closed() -> None:
    async def program(link: wirebond.Link) -> None:
        task = asyncio.create_task(link.aio.request("query", timeout=PATIENCE))
        while not link.stats.send.sent:  # it waits for its reply
            await asyncio.sleep(0.001)
        link.close()
        with pytest.raises(LinkDownError, match="was closed before the reply to query came"):
            await task

    with linked(ARM) as (link, _):
        asyncio.run(program(link))


def test_typed_requests_and_handlers(diffdrive: Any) -> None:
    status = diffdrive.Status(battery=12.0, errors=diffdrive.StatusErrors(0), state=diffdrive.StatusState(0))

    async def program(link: wirebond.Link) -> None:
        seen: asyncio.Future[Any] = asyncio.get_running_loop().create_future()

        @link.aio.on(diffdrive.Status)
        async def note(received: Any) -> None:
            seen.set_result(received)

        assert await link.aio.request(diffdrive.StatusQuery(), timeout=PATIENCE) == status
        assert await asyncio.wait_for(seen, PATIENCE) == status

    with linked(diffdrive.codec, lambda _: status.encode()) as (link, _):
        asyncio.run(program(link))


def test_a_link_that_coroutines_used_is_collected_all_the_same() -> None:
    async def program(link: wirebond.Link) -> None:
        with pytest.raises(TimeoutError):
            await link.aio.receive(0.01)
        with pytest.raises(RequestTimeoutError):
            await link.aio.request("query", timeout=0.01)

    port = PtyPort()
    link = wirebond.open(ARM, port.path)
    asyncio.run(program(link))
    gone = weakref.ref(link)
    del link
    wait_until(lambda: gc.collect() is not None and gone() is None, "it is collected")
    wirebond.open(ARM, port.path).close()  # the port was given back
    port.close()
