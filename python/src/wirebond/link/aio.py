"""A link in asyncio: coroutines for the calls that wait. All other calls of a ``Link`` return at once, and are used as
they are."""

from __future__ import annotations

import asyncio
import threading
import weakref
from collections import deque
from collections.abc import Awaitable, Callable, Mapping
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TypeVar, overload

from wirebond.arguments import real, shown
from wirebond.codec import Message
from wirebond.errors import LinkDownError, UsageError
from wirebond.link.handlers import MAX_WAITING, DeadlineEvent
from wirebond.link.log_lines import LogEvent
from wirebond.link.requests import DEFAULT_TIMEOUT, Outcome
from wirebond.typed import TypedMessage, TypedRequest

if TYPE_CHECKING:
    from wirebond.link.receiving import Receiving

_T = TypeVar("_T", bound=TypedMessage)
_Reply = TypeVar("_Reply")
_MessageHandler = TypeVar("_MessageHandler", bound=Callable[[Message], Awaitable[object]])
_LogHandler = TypeVar("_LogHandler", bound=Callable[[LogEvent], Awaitable[object]])
_DeadlineHandler = TypeVar("_DeadlineHandler", bound=Callable[[DeadlineEvent], Awaitable[object]])
_CLOSE_PATIENCE = 1.0  # seconds for coroutines that handle messages from before the end


class Aio:
    """Coroutines for all calls of a link that wait, for one event loop. Get it from ``link.aio``; use it only in the
    loop's thread.

    ``async for message in link.aio`` gives messages as ``for message in link`` does; ``async with link.aio`` closes the
    link at its end. A task that is cancelled while it waits loses no message.

    :param link: the link.
    :param loop: the event loop.
    """

    def __init__(self, link: Receiving, loop: asyncio.AbstractEventLoop) -> None:
        self._link = link
        self._loop = loop
        self._waiters: set[asyncio.Future[None]] = set()  # for messages
        self._calls: deque[tuple[Callable[[Any], Awaitable[object]] | None, object]] = deque()  # None: the end
        self._has_calls = asyncio.Event()
        self._lock = threading.Lock()  # between the loop and the handlers' thread
        self._is_listening = False
        self._task: asyncio.Task[None] | None = None

    # ---- messages

    async def receive(self, timeout: float | None = None) -> Message:
        """Return the next message.

        :param timeout: seconds; None: as long as it takes.
        :returns: the message.
        :raises TimeoutError: none came in time.
        :raises LinkDownError: the link is closed, and all received messages were taken.
        """
        inbox = self._link._inbox
        taken: list[Message] = []
        self._listen()
        try:
            if timeout is not None:
                timeout = real("timeout", timeout, "seconds, such as 0.5, or None for no limit")
            async with asyncio.timeout(timeout):
                while not inbox.take_now(taken):
                    waiter = self._loop.create_future()
                    self._waiters.add(waiter)
                    try:
                        if inbox.take_now(taken):  # one that came before the loop could be notified
                            break
                        await waiter
                    finally:
                        self._waiters.discard(waiter)
            self._link._frames.hear(taken[0])
            return taken[0]
        except BaseException:  # a signal's handler raised
            inbox.give_back(taken)
            raise

    def __aiter__(self) -> Self:
        """Yield messages as they come, until the link is closed, or until a replay has ended."""
        return self

    async def __anext__(self) -> Message:
        while True:
            has_ended = self._link._has_ended()
            try:
                return await self.receive(self._link._longest_wait)
            except TimeoutError:
                if has_ended:
                    raise StopAsyncIteration from None
            except LinkDownError:
                raise StopAsyncIteration from None

    def _listen(self) -> None:
        if self._is_listening:
            return
        self._is_listening = True
        self._link._start_reading()
        this = weakref.ref(self)  # the link's thread must not keep the link

        def messages_wait() -> None:
            aio = this()
            if aio is not None:
                aio._messages_wait()

        self._link._inbox.listen(messages_wait)

    def _messages_wait(self) -> None:
        """Wake the waiting task. In the link's thread."""
        if self._waiters:
            self._soon(self._wake)

    def _wake(self) -> None:
        for waiter in self._waiters:
            if not waiter.done():
                waiter.set_result(None)

    def _soon(self, function: Callable[..., object], *arguments: object) -> bool:
        """Call it in the loop. False: the loop has ended."""
        try:
            self._loop.call_soon_threadsafe(function, *arguments)
        except RuntimeError:
            return False
        return True

    # ---- requests

    @overload
    async def request(
        self,
        message: str,
        values: Mapping[str, Any] | None = None,
        /,
        *,
        timeout: float = DEFAULT_TIMEOUT,
        header: Mapping[str, Any] | None = None,
        **fields: Any,
    ) -> Message: ...
    @overload
    async def request(
        self,
        message: TypedRequest[_Reply],
        /,
        *,
        timeout: float = DEFAULT_TIMEOUT,
        header: Mapping[str, Any] | None = None,
    ) -> _Reply: ...
    async def request(
        self,
        message: str | TypedMessage,
        values: Mapping[str, Any] | None = None,
        /,
        *,
        timeout: float = DEFAULT_TIMEOUT,
        header: Mapping[str, Any] | None = None,
        **fields: Any,
    ) -> Any:
        """Send a request and await its reply, as ``Link.request`` does; other tasks run meanwhile. If the task is
        cancelled, a late reply is delivered like other messages.

        :param message: a message of the host that has a ``reply``, by its name or as an object of a generated module.
        :param values: its fields by name, in SI units.
        :param timeout: seconds.
        :param header: the frame's own named fields, as for ``Link.send``.
        :param fields: its fields as keywords; they override those of ``values``.
        :returns: the reply: a ``Message``, or an object of the generated module.
        :raises RequestTimeoutError: no reply came in time.
        """
        answer: asyncio.Future[Outcome] = self._loop.create_future()
        asked = self._link._ask(
            message, values, timeout, header, fields, lambda outcome: self._answered(answer, outcome)
        )
        try:
            async with asyncio.timeout(timeout):
                outcome = await answer
        except BaseException as error:
            if answer.done() and not answer.cancelled():  # it came in the moment in which the task was cancelled
                self._nobody_waits_for(answer.result())
            if isinstance(error, TimeoutError):
                self._link._inbox.requests.withdraw(asked.question)  # its error describes the message that came instead
                raise asked.timeout_error() from None
            raise
        finally:
            self._link._inbox.requests.withdraw(asked.question)
        return asked.result(outcome)

    def _answered(self, answer: asyncio.Future[Outcome], outcome: Outcome) -> None:
        """Pass the answer to the task. In the link's thread."""
        if not self._soon(self._settle, answer, outcome):
            self._nobody_waits_for(outcome)

    def _settle(self, answer: asyncio.Future[Outcome], outcome: Outcome) -> None:
        if answer.done():
            self._nobody_waits_for(outcome)
        else:
            answer.set_result(outcome)

    def _nobody_waits_for(self, outcome: Outcome) -> None:
        if isinstance(outcome, Message):
            self._link._inbox.give_reply_back(outcome)

    # ---- handlers

    @overload
    def on(
        self, message: type[_T], /
    ) -> Callable[[Callable[[_T], Awaitable[None]]], Callable[[_T], Awaitable[None]]]: ...
    @overload
    def on(self, message: str | None = None, /) -> Callable[[_MessageHandler], _MessageHandler]: ...
    def on(self, message: str | type[TypedMessage] | None = None, /) -> Callable[[Any], Any]:
        """Call a coroutine function for messages, as ``Link.on``: ``@link.aio.on("status")``. One task of this loop
        awaits the calls one after the other, in the order in which the messages came.

        :param message: a message's name or its class; none: every message.
        :returns: the decorator; it gives the function back.
        :raises UsageError: there is no such message, or the function is not a coroutine function.
        """

        def add(function: Callable[[Any], Awaitable[object]]) -> Callable[[Any], Awaitable[object]]:
            self._serve(function)
            self._link._add_handler(message, function, lambda value: self._call(function, value))
            return function

        self._link._check_kind(message)
        return add

    def on_log(self, level: str = "debug", /) -> Callable[[_LogHandler], _LogHandler]:
        """Call a coroutine function for log lines, as ``Link.on_log``.

        :param level: the least one.
        :returns: the decorator; it gives the function back.
        :raises UsageError: there is no such level, or there are no log lines, or the function is not a coroutine
            function.
        """
        self._link._check_log(level)

        def add(function: _LogHandler) -> _LogHandler:
            self._serve(function)
            self._link._add_log_handler(level, function, lambda event: self._call(function, event))
            return function

        return add

    def on_deadline(self, action: str | None = None, /) -> Callable[[_DeadlineHandler], _DeadlineHandler]:
        """Call a coroutine function for deadlines, as ``Link.on_deadline``.

        :param action: the deadline's ``then``; none: every deadline of the host.
        :returns: the decorator; it gives the function back.
        :raises UsageError: there is no such deadline, or the function is not a coroutine function.
        """

        def add(function: _DeadlineHandler) -> _DeadlineHandler:
            self._serve(function)
            self._link._add_deadline_handler(action, function, lambda event: self._call(function, event))
            return function

        self._link._check_strikes(action)
        return add

    def _serve(self, function: Callable[[Any], Awaitable[object]]) -> None:
        if not asyncio.iscoroutinefunction(function):
            raise UsageError(
                f"{shown(function)} is not a coroutine function; register it with link.on, or make it async"
            )
        if self._task is None:
            self._task = self._loop.create_task(self._await_calls())

    def _call(self, function: Callable[[Any], Awaitable[object]], value: object) -> None:
        """Pass a message to the loop. In the handlers' thread."""
        handlers = self._link._inbox.handlers
        with self._lock:
            if len(self._calls) >= MAX_WAITING:
                self._calls.popleft()
                handlers.dropped += 1
            self._calls.append((function, value))
        if not self._soon(self._has_calls.set):
            raise LinkDownError("the event loop of this handler has ended")

    async def _await_calls(self) -> None:
        while True:
            await self._has_calls.wait()
            self._has_calls.clear()
            while self._calls:
                with self._lock:
                    function, value = self._calls.popleft()
                if function is None:
                    return
                try:
                    await function(value)
                except Exception as error:
                    self._link._inbox.handlers.note_error(function, error)

    # ---- the end

    async def close(self) -> None:
        """Close the link, as ``Link.close`` does; other tasks run meanwhile. Coroutine handlers get earlier messages,
        for a second at most."""
        self._link._begin_close()  # leases end now, also when this task is cancelled
        await asyncio.to_thread(self._link.close)
        task, self._task = self._task, None
        if task is None or task is asyncio.current_task():
            return
        with self._lock:
            self._calls.append((None, None))
        self._has_calls.set()
        await asyncio.wait({task}, timeout=_CLOSE_PATIENCE)
        if not task.done():
            self._link._inbox.handlers.dropped += max(len(self._calls) - 1, 0)
            task.cancel()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()
