"""Receiving for programs: take messages, read the newest, register handlers, wait for replies.

One file: the same list for received messages; each method is a few lines and its documentation.
"""

from __future__ import annotations

import contextlib
import inspect
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, TypeVar, overload

from wirebond import _engine
from wirebond.arguments import real, shown
from wirebond.codec import Codec, Message, refuse_option_for_field
from wirebond.errors import LinkDownError, RequestTimeoutError, UsageError
from wirebond.link.ends import other
from wirebond.link.handlers import DeadlineEvent
from wirebond.link.inbox import Inbox, Latest
from wirebond.link.log_lines import LogEvent, least_number, log_names, number_of
from wirebond.link.requests import DEFAULT_TIMEOUT, Outcome, Question, check_timeout, timeout_error
from wirebond.protocol.model import End
from wirebond.protocol.planning import plan_for
from wirebond.protocol.problems import nearest, no_message
from wirebond.typed import TypedMessage, TypedRequest, from_message_of, maker_of, message_class, name_and_values

if TYPE_CHECKING:
    from wirebond.link.aio import Aio
    from wirebond.link.engine import Engine
    from wirebond.link.frame_maker import FrameMaker, OwnMessage

_T = TypeVar("_T", bound=TypedMessage)
_Reply = TypeVar("_Reply")
_MessageHandler = TypeVar("_MessageHandler", bound=Callable[[Message], object])
_LogHandler = TypeVar("_LogHandler", bound=Callable[[LogEvent], object])
_DeadlineHandler = TypeVar("_DeadlineHandler", bound=Callable[[DeadlineEvent], object])
_SIGNAL_TURN = 0.25  # seconds
_REPLAY_WAIT = 0.05  # seconds between two checks whether a replay has ended
_ITERATION_WAIT = 60.0  # seconds: how long one wait of an iteration lasts; signals are handled during it
_NO_LIMIT = 1e9  # seconds: longer times mean the same, and threads cannot wait for them
_PATIENCE = 1.0  # seconds that the end of a link waits for handlers


@dataclass(frozen=True)
class Asked:
    """A request that is under way."""

    link: Receiving
    question: Question
    header: Mapping[str, Any]
    timeout: float
    typed: Callable[[Message], Any] | None  # makes the object of the reply; None: a name was asked

    def result(self, outcome: Outcome) -> Any:
        """Return the reply as the caller wants it; or raises what went wrong."""
        if isinstance(outcome, Exception):
            raise outcome
        return outcome if self.typed is None else self.typed(outcome)

    def timeout_error(self) -> RequestTimeoutError:
        """Return the error for a reply that did not come in time."""
        link = self.link
        return timeout_error(link.codec, link._end, self.question, self.header, self.timeout, link.port, link.state)


class Receiving:
    """The receiving half of a ``Link``. What the other half has is declared here."""

    codec: Codec
    port: str
    _engine: Engine
    _inbox: Inbox
    _frames: FrameMaker
    _actions: list[str]
    _end: End
    _aio: Aio | None = None

    # ---- taking messages

    def receive(self, timeout: float = 0.0) -> list[Message]:
        """Return messages since the last call, waiting up to ``timeout`` seconds for the first.

        Signals are heard within a moment: Ctrl-C raises ``KeyboardInterrupt`` here.

        :param timeout: seconds; 0 does not wait.
        :returns: the messages in the order in which they came; none when the time is over.
        :raises LinkDownError: the link is closed, and all that had come was taken.
        :raises UsageError: ``timeout`` is not a number.
        """
        timeout = real("timeout", timeout, "seconds, such as 0.5; for no limit write `for message in link`")
        wait = timeout if 0 <= timeout < _NO_LIMIT else 0.0 if not timeout > 0 else _NO_LIMIT
        messages: list[Message] = []
        try:
            self._inbox.look()
            if self._inbox.take(wait, messages):
                self._inbox.take_rest(messages)
                self._frames.hear(messages[-1])
            return messages
        except BaseException:  # a signal's handler raised
            self._inbox.give_back(messages)
            raise

    def __iter__(self) -> Iterator[Message]:
        """Yield messages as they come, until ``close``, or until a replay has ended. Those that are left when a loop
        ends are for the next one."""
        wait = self._longest_wait or _ITERATION_WAIT
        while True:
            taken: list[Message] = []
            has_ended = self._has_ended()
            try:
                self._inbox.take(wait, taken)
                if taken:
                    self._frames.hear(taken[0])
            except LinkDownError:
                if not self._engine.is_closed():
                    raise
                return
            except BaseException:  # a signal's handler raised
                self._inbox.give_back(taken)
                raise
            if taken:
                yield taken[0]
            elif has_ended:
                return

    @property
    def _longest_wait(self) -> float | None:
        """Seconds for which a loop may wait before it asks `_has_ended`; None: it need not."""
        return _REPLAY_WAIT if self.port.startswith("replay:") else None

    def _has_ended(self) -> bool:
        """Return whether a replay is over: no more messages will come, except those already received."""
        return self._longest_wait is not None and self._engine.state() == "down"

    # ---- the newest

    @overload
    def latest(self, message: type[_T], *, header: Mapping[str, Any] | None = None) -> Latest[_T] | None: ...
    @overload
    def latest(self, message: str, *, header: Mapping[str, Any] | None = None) -> Latest[Message] | None: ...
    def latest(
        self, message: str | type[TypedMessage], *, header: Mapping[str, Any] | None = None
    ) -> Latest[Any] | None:
        """Return the newest message of this name. Takes nothing from a loop, from handlers or from requests. Any
        thread.

        :param message: its name, or its class of a generated module.
        :param header: where frames name their sender: whose message, such as ``{"servo": 3}``. None: anybody's.
        :returns: the message and when it came (``message``, ``t``, ``age``); None before the first one.
        :raises UsageError: the MCU sends no such message; or ``header`` does not name the sender.
        :raises MessageError: ``header`` has a wrong name or value.
        """
        name = self._received_name(message)
        found = self._inbox.newest(name, None if header is None else self._sender_bits(header))
        if found is None:
            return None
        return Latest(found if isinstance(message, str) else maker_of(message)(found), found.t)

    # ---- handlers

    @overload
    def on(self, message: type[_T], /) -> Callable[[Callable[[_T], None]], Callable[[_T], None]]: ...
    @overload
    def on(self, message: str | None = None, /) -> Callable[[_MessageHandler], _MessageHandler]: ...
    def on(self, message: str | type[TypedMessage] | None = None, /) -> Callable[[Any], Any]:
        """Return a decorator: call this function with each message of this name. ``@link.on("status")``,
        ``@link.on()``.

        One thread of the link calls all handlers, one after the other, in the order in which messages came and, for one
        message, in that of registration. What a handler raises is reported to ``logging`` (``"wirebond"``) and counted
        (``stats.handler_errors``); the link continues. A handler may call everything of the link. A message that has a
        handler is not given to a loop or to ``receive``. Any thread.

        :param message: a message of the MCU by its name, or its class of a generated module, whose objects the function
            gets then; none: every message, ``unknown`` ones too.
        :returns: the decorator; it gives the function back.
        :raises UsageError: the MCU sends no such message; or the function is a coroutine function, which belongs to
            ``link.aio.on``.
        """

        def add(function: Callable[[Any], object]) -> Callable[[Any], object]:
            _refuse_coroutine(function, "on")
            self._add_handler(message, function, function)
            return function

        self._check_kind(message)
        return add

    def on_deadline(self, action: str | None = None, /) -> Callable[[_DeadlineHandler], _DeadlineHandler]:
        """Return a decorator: call this function with a ``DeadlineEvent`` when the deadline strikes, and when it ends.

        The handlers' thread looks every 10 ms, between two messages: a deadline that strikes and ends within that time
        is not seen. For one that has struck already, the function is called at once. Any thread.

        :param action: the deadline's ``then``; none: every deadline of the host.
        :returns: the decorator; it gives the function back.
        :raises UsageError: the file has no such deadline at the host; or a coroutine function, which belongs to
            ``link.aio.on_deadline``.
        """

        def add(function: _DeadlineHandler) -> _DeadlineHandler:
            _refuse_coroutine(function, "on_deadline")
            self._add_deadline_handler(action, function, function)
            return function

        self._check_strikes(action)
        return add

    def on_log(self, level: str = "debug", /) -> Callable[[_LogHandler], _LogHandler]:
        """Return a decorator: call this function with a ``LogEvent`` for each log line of the MCU: of messages with
        ``log`` in the file, and of the log service. As for ``on``, such a message is not given to a loop or to
        ``receive``.

        :param level: the least one: ``debug``, ``info``, ``warning`` or ``error``.
        :returns: the decorator; it gives the function back.
        :raises UsageError: there is no such level, or the protocol has no log lines; or a coroutine function, which
            belongs to ``link.aio.on_log``.
        """
        self._check_log(level)

        def add(function: _LogHandler) -> _LogHandler:
            _refuse_coroutine(function, "on_log")
            self._add_log_handler(level, function, function)
            return function

        return add

    def off(self, function: Callable[..., object], /) -> None:
        """Stop calling this handler, for messages and for deadlines. A call that has begun continues. A message that
        waited for it alone goes to a loop or to ``receive``, perhaps after newer ones. Any thread.

        :param function: what ``on``, ``on_log``, ``on_deadline`` or ``aio.on`` got.
        :raises UsageError: it is not a handler of this link.
        """
        if not self._inbox.handlers.remove(function):
            raise UsageError(f"{shown(function)} is not a handler of this link")

    def run(self, timeout: float | None = None) -> bool:
        """Wait while handlers work, until the link is closed. A program with nothing but handlers calls it last.

        Signals are heard: Ctrl-C raises ``KeyboardInterrupt`` here.

        :param timeout: seconds; None: no limit.
        :returns: True: the link was closed, and handlers have had what came. False: the time is over.
        :raises UsageError: it is called in a handler, which would wait for itself; or ``timeout`` is not a number.
        """
        if self._inbox.handlers.is_own_thread():
            raise UsageError(
                "run() was called in a handler, and no handler is called until it returns; call it where the program "
                "waits, or link.close() to end"
            )
        if timeout is not None:
            timeout = min(real("timeout", timeout, "seconds, such as 0.5, or None for no limit"), _NO_LIMIT)
        self._start_reading()
        if not self._inbox.ended.wait(timeout):
            return False
        self._inbox.leave(_PATIENCE)
        return True

    # ---- requests

    @overload
    def request(
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
    def request(
        self,
        message: TypedRequest[_Reply],
        /,
        *,
        timeout: float = DEFAULT_TIMEOUT,
        header: Mapping[str, Any] | None = None,
    ) -> _Reply: ...
    def request(
        self,
        message: str | TypedMessage,
        values: Mapping[str, Any] | None = None,
        /,
        *,
        timeout: float = DEFAULT_TIMEOUT,
        header: Mapping[str, Any] | None = None,
        **fields: Any,
    ) -> Any:
        """Send a message that has a ``reply``, and wait for that reply. Any thread, also in a handler.

        A reply belongs to the first request of its kind that waits: of the same address, where the MCU names its own,
        and, where request and reply share fields of one name and type, with the same values. The caller gets it, and
        handlers of that message do; a loop and ``receive`` do not.

        :param message: a message of the host that has a ``reply``, by its name or as an object of a generated module.
        :param values: its fields by name, in SI units.
        :param timeout: seconds, more than 0 and at most 3600.
        :param header: the frame's own named fields, as for ``send``: whom to ask.
        :param fields: its fields as keywords; they go before those of ``values``.
        :returns: the reply: a ``Message``, or an object of the generated module.
        :raises RequestTimeoutError: no reply came in time.
        :raises UsageError: the message has no ``reply``, or ``timeout`` is out of its range; or the message has a field
            with the name of an option, which belongs in ``values``.
        :raises MessageError: a value is wrong, or the message is the MCU's to send.
        :raises StoppedError: an emergency stop holds the message.
        :raises LinkDownError: the port is away at the moment, or the link is closed.
        :raises QueueFullError: 64 KiB wait already.
        """
        answer: SimpleQueue[Outcome] = SimpleQueue()
        return self._answer_to(self._ask(message, values, timeout, header, fields, answer.put), answer)

    @property
    def aio(self) -> Aio:
        """Coroutines for everything that waits: ``async for message in link.aio``, ``await link.aio.request(...)``. In
        a running event loop.

        :raises UsageError: no event loop runs in this thread.
        """
        import asyncio  # noqa: PLC0415 programs without it begin sooner

        from wirebond.link.aio import Aio  # noqa: PLC0415

        try:
            loop = asyncio.get_running_loop()
        except RuntimeError:
            raise UsageError("link.aio belongs to a running event loop; use it within a coroutine") from None
        if self._aio is None or self._aio._loop is not loop:
            self._aio = Aio(self, loop)
        return self._aio

    # ---- for the parts of a link

    def _ask(
        self,
        message: str | TypedMessage,
        values: Mapping[str, Any] | None,
        timeout: float,
        header: Mapping[str, Any] | None,
        fields: dict[str, Any],
        finish: Callable[[Outcome], None],
    ) -> Asked:
        """Send a request; ``finish`` gets its outcome."""
        check_timeout(timeout)
        name, given = name_and_values(message, values, fields)
        own = self._frames.message(name)
        options = {"timeout": None if timeout == DEFAULT_TIMEOUT else timeout, "header": header}
        refuse_option_for_field("request", own.model, options, given)
        self._start_reading()
        question = self._question(own, given, header, finish)
        typed = None if isinstance(message, str) else getattr(message, "reply_of", from_message_of(type(message)))
        self._inbox.requests.submit(question)
        return Asked(self, question, header or {}, timeout, typed)

    def ask(
        self,
        message: str,
        values: Mapping[str, Any],
        timeout: float,
        finish: Callable[[Outcome], None],
        header: Mapping[str, Any] | None = None,
    ) -> Asked:
        """Send a request without waiting. Any thread.

        :param message: a message of this end with a ``reply``, by its name.
        :param values: its fields by name, in SI units.
        :param timeout: seconds, for the sentence that no reply came.
        :param finish: gets the reply, or the exception, in the thread that receives. It must not wait.
        :param header: the frame's own named fields, as for ``send``.
        :returns: the request; withdraw its ``question`` from ``internals.inbox.requests`` to give it up.
        """
        return self._ask(message, values, timeout, header, {}, finish)

    def _answer_to(self, asked: Asked, answer: SimpleQueue[Outcome]) -> Any:
        """Wait for what ``answer`` gets of this request, and withdraw it."""
        outcome: Outcome | None = None
        try:
            try:
                outcome = _get(answer, asked.timeout)
            except Empty:
                self._inbox.requests.withdraw(asked.question)
                try:
                    outcome = answer.get_nowait()  # it came in the meantime
                except Empty:
                    raise asked.timeout_error() from None
            return asked.result(outcome)
        finally:
            self._inbox.requests.withdraw(asked.question)
            if outcome is None and not answer.empty() and isinstance(left := answer.get_nowait(), Message):
                self._inbox.give_reply_back(left)  # a signal ended the wait

    def begin_request(self, message: str, values: Mapping[str, Any], timeout: float) -> Callable[[], Message]:
        """Send a request now, and wait for its reply later. Any thread.

        :param message: a message of this end with a ``reply``, by its name.
        :param values: its fields by name, in SI units.
        :param timeout: seconds to wait, from the call of the result on.
        :returns: a function that waits for the reply, returns it, and raises as ``request`` does. Call it once.
        """
        answer: SimpleQueue[Outcome] = SimpleQueue()
        asked = self._ask(message, values, timeout, None, {}, answer.put)
        return lambda: self._answer_to(asked, answer)

    def _start_reading(self) -> None:
        self._inbox.start()

    def _add_handler(
        self,
        message: str | type[TypedMessage] | None,
        function: Callable[..., object],
        call: Callable[[Any], object],
    ) -> None:
        name = None if message is None else self._received_name(message)
        if isinstance(message, type):
            typed, plain = maker_of(message), call
            call = lambda received: plain(typed(received))  # noqa: E731
        if self._frames.follows_host:
            heard, hear = call, self._frames.hear
            call = lambda received: (hear(received), heard(received))  # noqa: E731
        self._inbox.handlers.add(function, name, call)
        self._start_reading()
        self._inbox.handlers.start()

    def _check_log(self, level: str) -> None:
        least_number(level)
        if not log_names(self.codec):
            raise UsageError(f"{self.codec.name} has no log lines: no message with `log`, and no log service")

    def _add_log_handler(self, level: str, function: Callable[..., object], call: Callable[[LogEvent], object]) -> None:
        codec, least = self.codec, least_number(level)

        def call_with_line(message: Message) -> None:
            line = codec.log_line(message)
            if line is not None and number_of(line) >= least:
                call(LogEvent(line, message))

        for name in log_names(codec):
            self._add_handler(name, function, call_with_line)

    def _add_deadline_handler(
        self, action: str | None, function: Callable[..., object], call: Callable[[Any], object]
    ) -> None:
        self._inbox.handlers.add_deadline(function, action, call)
        self._start_reading()
        self._inbox.handlers.start()

    def _check_kind(self, message: object) -> None:
        """Check the argument of a handler's registration: nothing, a name, or a class."""
        if message is not None and not isinstance(message, str | type):
            raise UsageError(f"on() takes a message's name or class, not {shown(message)}; write @link.on() for all")
        if message is not None:
            self._received_name(message)

    def _check_strikes(self, action: object) -> None:
        if action is not None or not self._actions:
            self._check_action(action, "that could strike")

    def _check_action(self, action: object, nothing: str) -> None:
        if action not in self._actions:
            raise UsageError(_no_action(self.codec, self._end, action, self._actions, nothing))

    def _received_name(self, message: str | type[TypedMessage]) -> str:
        """Return the name of a message that can be received.

        :raises UsageError: none may.
        """
        name = message if isinstance(message, str) else message_class(message).NAME
        known = {m.name: m for m in self.codec.model.messages}
        if name not in known and name != "unknown":
            raise UsageError(no_message(self.codec.name, name, known))
        if name in known and not known[name].sent_by(other(self._end)):
            raise UsageError(f"{name} is sent by the {self._end}; it is never received here")
        return name

    def _sender_bits(self, header: Mapping[str, Any]) -> int:
        """Return the address in this header, of a frame of the other end."""
        plan = plan_for(self.codec.model, other(self._end))
        sender = None if plan.peer is None else plan.header[plan.peer].name
        if plan.peer is None or sender not in header:
            advice = "leave out header=" if sender is None else f"give {sender}"
            raise UsageError(
                f"header is {shown(dict(header))}, which does not name the sender of the message; {advice}"
            )
        return _engine.header_bits(self.codec.tables.format_for(other(self._end)), dict(header))[plan.peer]

    def _question(
        self,
        own: OwnMessage,
        values: dict[str, Any],
        header: Mapping[str, Any] | None,
        finish: Callable[[Outcome], None] | None,
    ) -> Question:
        raise NotImplementedError

    def _begin_close(self) -> None:
        raise NotImplementedError

    def close(self) -> None:
        """See ``Link``."""
        raise NotImplementedError

    @property
    def state(self) -> str:
        """See ``Link``."""
        raise NotImplementedError


def _get(answer: SimpleQueue[Outcome], timeout: float) -> Outcome:
    """Wait in short turns: Python can miss a signal that comes just before a wait, until the wait is over.

    :raises Empty: nothing came in time.
    """
    until = time.monotonic() + timeout
    while (left := until - time.monotonic()) > _SIGNAL_TURN:
        with contextlib.suppress(Empty):
            return answer.get(timeout=_SIGNAL_TURN)
    return answer.get(timeout=max(left, 0.0))


def _refuse_coroutine(function: object, where: str) -> None:
    if inspect.iscoroutinefunction(function):
        raise UsageError(f"{shown(function)} is a coroutine function; register it with link.aio.{where}")


def _no_action(codec: Codec, end: End, wanted: object, actions: list[str], nothing: str) -> str:
    """Return the sentence that no deadline at this end has this action; it names the nearest, and all that there
    are."""
    name = codec.name
    if not actions:
        return f"{name} has no deadline at the {end}, so that there is nothing {nothing}; see `deadlines` in its file"
    listing = f"it has {', '.join(actions)}"
    if not isinstance(wanted, str):
        return f"{shown(wanted)} is not an action of a deadline; {listing}"
    own = [d.then for d in codec.model.deadlines if d.at == end and d.message == wanted]
    near = own[0] if own else nearest(wanted, actions)
    hint = f"did you mean {near}? " if near else ""
    return f"{name} has no deadline {shown(wanted)} at the {end}; {hint}{listing}"
