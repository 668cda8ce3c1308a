"""Routes each received message: to its handlers, to the request that it answers, or to a program that takes messages.

Until handlers, requests or coroutines are used, whoever takes messages gets them from the engine itself. From then on a
thread of the link does so for all. It runs nothing of the program: neither handlers nor signals. Where there are
handlers, their thread does it while no handler runs, so that a message wakes one thread and not two; the link's thread
replaces it until then.

A program's signal handler may raise after every call that Python makes in the main thread. So a message moves from one
place to the next in one call of C, what is done before that may be done twice, and who takes messages gives them back
where it does not return.
"""

from __future__ import annotations

import contextlib
import itertools
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from functools import partial
from itertools import repeat, takewhile
from operator import attrgetter, call, is_not
from queue import Empty, SimpleQueue
from typing import Any, Generic, NamedTuple, TypeVar

from wirebond.codec import Codec, Message
from wirebond.errors import LinkDownError
from wirebond.link.ends import other
from wirebond.link.engine import Engine
from wirebond.link.handlers import Handlers, move
from wirebond.link.requests import RequestBook
from wirebond.protocol.model import End
from wirebond.protocol.planning import plan_for

MAX_WAITING = 65536  # messages that wait to be taken; then the oldest are dropped, counted
MAX_SENDERS = 4096  # addresses whose newest message is kept, of each message
_NAME = attrgetter("name")
_WAIT = 60.0  # seconds that the thread waits at once
_CLOSING = 2.0  # seconds: longer than a link takes to close
_LOOK = 0.01  # seconds between two checks for handlers, if another thread receives or the link closes
_TURN = 0.25  # seconds that a caller waits in the engine before it checks whether the thread has begun

_T_co = TypeVar("_T_co", covariant=True)


class Latest(NamedTuple, Generic[_T_co]):
    """The newest message of its kind.

    :ivar message: a ``Message``, or an object of a generated module.
    :ivar t: when it came, on ``time.monotonic()``.
    """

    message: _T_co
    t: float

    @property
    def age(self) -> float:
        """Seconds since it came."""
        return time.monotonic() - self.t


class Inbox:
    """The received messages of a link that are not taken yet. Any thread may call it. It knows no ``Link``, so that a
    link can become garbage while the thread runs.

    :param place: the port, for sentences.
    :param end: the one that the link plays.
    :param actions: of its deadlines, as the engine numbers them.
    """

    def __init__(self, codec: Codec, end: End, engine: Engine, place: str, actions: list[str]) -> None:
        self._engine = engine
        self._place = place
        self._lock = threading.RLock()  # a garbage collection within may take messages
        self._arrived: deque[Message] = deque()  # from the engine, not routed yet
        self._changed: deque[tuple[str, int, int]] = deque()  # the same; of deadlines and of the port
        self._is_routing = False
        self._turn = threading.Lock()  # of the two threads that get messages from the engine, and route them
        self._queue: SimpleQueue[Message | None] = SimpleQueue()  # to be taken; None after the last one
        self._given_back: deque[Message] = deque()  # to be taken before those
        self._dropped = 0
        self._newest: dict[str, Message] = {}
        self._newest_of: dict[str, dict[int, Message]] = {}  # by message and sender's address
        plan = plan_for(codec.model, other(end))
        self._sender = None if plan.peer is None else plan.header[plan.peer]
        self._actions = actions
        self._thread: threading.Thread | None = None
        self._callers: set[object] = set()  # that take from the engine themselves
        self._listeners: tuple[Callable[[], None], ...] = ()
        self._watchers: dict[str, Callable[[Message], None]] = {}
        self._port_watchers: tuple[Callable[[bool, float], None], ...] = ()
        self.ended = threading.Event()  # no message will come any more
        self.requests = RequestBook(codec, end, engine.stats)
        self._relay: Callable[[list[Message], list[Message], list[tuple[str, int, int]]], None] | None = None
        self.relayed = 0  # messages that came, since the link was opened, and went where they belong
        self.handlers = Handlers(place, self.struck, self.give, self._attend, self._engine.recall)

    # ---- taking

    def take(self, timeout: float, taken: list[Message]) -> bool:
        """Append the next message; False: the time is over. Who does not hand it on calls ``give_back``.

        :raises LinkDownError: the link is closed, and all that had come was taken.
        """
        until = time.monotonic() + timeout
        while True:
            is_closed = self._engine.is_closed()  # before anything else: in a forked child it raises
            if self.take_now(taken):
                return True
            remaining = max(until - time.monotonic(), 0.0)
            if not self._pull(min(remaining, _CLOSING if is_closed else _TURN)):
                if self._wait(min(remaining, _TURN), taken):
                    return True
                if remaining <= _TURN:
                    return False
                continue
            if self.take_now(taken):
                return True
            if is_closed:
                raise self._closed()
            if remaining == 0.0:
                return False

    def look(self) -> None:
        """Fetch new messages if messages wait to be taken, so that ``take_rest`` returns them, too."""
        if self._given_back or not self._queue.empty():
            self._pull(0.0)

    def take_now(self, taken: list[Message]) -> bool:
        """Append the next message that waits here; False: there is none.

        :raises LinkDownError: there will be none any more.
        """
        return self._wait(0.0, taken)

    def take_rest(self, taken: list[Message]) -> None:
        """Append all that wait here. That there will be none any more, the next call says."""
        with contextlib.suppress(LinkDownError):
            while self._given_back and self._wait(0.0, taken):
                pass
        with contextlib.suppress(Empty):  # of the last call
            get: Callable[[], Any] = self._queue.get_nowait
            taken.extend(takewhile(partial(is_not, None), map(call, repeat(get))))
            self._queue.put(None)  # that there will be none is for the next caller

    def give_back(self, messages: list[Message]) -> None:
        """Give back messages that were taken last and not used: the next caller takes them."""
        self._given_back.extendleft(reversed(messages))

    def _wait(self, timeout: float, taken: list[Message]) -> bool:
        if self._given_back:
            with contextlib.suppress(IndexError):
                taken.extend(map(call, (self._given_back.popleft,)))
                return True
        if timeout <= 0 and self._queue.empty() and not self.ended.is_set():
            return False  # an exception for it would cost more than a message
        found: list[Message | None] = []
        try:
            if timeout > 0:
                found.extend(map(self._queue.get, (True,), (timeout,)))
            else:
                found.extend(map(call, (self._queue.get_nowait,)))
            if found[0] is None:
                raise self._closed()
            taken.append(found[0])
        except Empty:
            if self.ended.is_set() and self._queue.empty():
                raise self._closed() from None
            return False
        except BaseException:
            for message in found:
                if message is None:
                    self._queue.put(None)  # for the next caller
                elif not taken or taken[-1] is not message:
                    self.give_back([message])
            raise
        return True

    def _closed(self) -> LinkDownError:
        return LinkDownError(f"the link to {self._place} is closed; no message will come")

    def listen(self, listener: Callable[[], None]) -> None:
        """Call it whenever messages wait to be taken, or none will come any more. In any thread."""
        with self._lock:
            self._listeners += (listener,)

    def watch(self, name: str, watcher: Callable[[Message], None]) -> None:
        """Call it with each message of this name, which it does not take. It runs nothing of the program."""
        self._watchers[name] = watcher

    def watch_port(self, watcher: Callable[[bool, float], None]) -> None:
        """Call it when the port was opened (True) or went away (False), with the time. It runs nothing of the
        program."""
        self._port_watchers += (watcher,)

    def relay(self, relay: Callable[[list[Message], list[Message], list[tuple[str, int, int]]], None]) -> None:
        """Call it with all that comes, those of them that answered requests, which have had them, and the changes of
        port and deadlines. In the thread that receives. Nothing waits to be taken any more. It runs nothing of the
        program."""
        self._relay = relay
        self.start()

    # ---- the newest

    def newest(self, name: str, sender: int | None) -> Message | None:
        """Return the newest message of this name; of this sender's address, by its bits, unless that is None."""
        self._pull(0.0)
        return self._newest.get(name) if sender is None else self._newest_of.get(name, {}).get(sender)

    def _note(self, message: Message) -> None:
        name = message.name
        self._newest[name] = message
        if self._sender is None:
            return
        address = message.header.get(self._sender.name)
        if address is None:
            return
        of_senders = self._newest_of.setdefault(name, {})
        bits = self._sender.value.wire_bits(address)
        if bits in of_senders or len(of_senders) < MAX_SENDERS:
            of_senders[bits] = message

    # ---- from the engine

    def start(self) -> None:
        """Start the thread, once."""
        self._engine.is_closed()  # in a forked child it raises
        with self._lock:
            if self._thread is None and not self.ended.is_set():
                self._turn.acquire()  # until those who take from the engine themselves have looked
                self._thread = threading.Thread(target=self._run, name=f"messages of {self._place}", daemon=True)
                self._thread.start()

    @property
    def dropped(self) -> int:
        """Return how many messages were dropped because they were not taken in time."""
        return self._dropped + self.handlers.dropped

    def struck(self) -> set[str]:
        """Return the actions of the own end's deadlines that have struck and not ended."""
        return {self._actions[index] for index in self._engine.struck_deadlines()}

    def give(self, message: Message) -> None:
        """Give messages to those who take them."""
        if self._relay is not None:
            return
        with self._lock:
            self._queue.put(message)
            self._drop_oldest()
        self._tell()

    def _drop_oldest(self) -> None:
        if self._queue.qsize() <= MAX_WAITING:
            return
        with contextlib.suppress(Empty):
            while self._queue.qsize() > MAX_WAITING:
                self._dropped += self._queue.get_nowait() is not None

    def give_reply_back(self, reply: Message) -> None:
        """Note that the request that took this reply no longer waits for it. Handlers have had it, if there are any."""
        if not self.handlers.want(reply.name):
            self.give(reply)

    def end(self) -> None:
        """End: no message will come any more."""
        if self.ended.is_set():
            return
        self.ended.set()
        self._queue.put(None)
        self.requests.end(
            lambda name: LinkDownError(f"the link to {self._place} was closed before the reply to {name} came")
        )
        self.handlers.end()
        self._tell()

    def give_up(self) -> None:
        """Give up the thread, which does not return because the interpreter ends: only messages that are already here
        can be taken."""
        if self._thread is not None:
            self.end()

    def leave(self, patience: float) -> None:
        """Close the link: wait until all received messages are delivered, also to handlers."""
        thread = self._thread
        if thread is not None and thread is not threading.current_thread():
            thread.join(patience)
        self.handlers.leave(patience)

    def _pull(self, timeout: float) -> bool:
        """Get from the engine what came. False: the thread does that."""
        self._engine.is_closed()  # in a forked child it raises: its locks may be held for ever
        caller = object()
        try:
            with self._lock:
                if self._thread is not None or self.ended.is_set():
                    return False
                self._callers.add(caller)
            self._receive(self._engine.receive, timeout)
        finally:
            self._callers.discard(caller)
        return True

    def _run(self) -> None:
        until = time.monotonic() + 2 * _TURN
        while self._callers and time.monotonic() < until:  # they pass messages on until they check here
            time.sleep(0.001)
        self._turn.release()
        try:
            while True:
                is_closed = self._engine.is_closed()
                self._engine.wait_unattended(_WAIT)
                with self._turn:
                    if not self._receive(self._engine.receive, 0.0) and is_closed:
                        break
        finally:
            self.end()

    def _attend(self) -> None:
        """Let the handlers' idle thread take the messages, until something waits for it."""
        if not self._turn.acquire(timeout=_LOOK):
            return
        try:
            has_come = self._receive(self._engine.attend, _WAIT)
        finally:
            self._turn.release()
        if not has_come and self._engine.is_closed():
            self.ended.wait(_LOOK)

    def _receive(self, get: Callable[[float], Iterable[Message]], timeout: float) -> bool:
        """Wait for what comes, and route it. False: nothing came in time, or nothing will come.

        :param get: of the engine.
        """
        wait = 0.0 if self._arrived or self._changed else timeout
        self._arrived.extend(itertools.chain.from_iterable(map(get, (wait,))))
        self._changed.extend(itertools.chain.from_iterable(itertools.starmap(self._engine.changes, ((),))))
        has_come = bool(self._arrived or self._changed)
        with self._lock:
            if self._is_routing:  # called by a garbage collection or a signal within: the outer call goes on
                return has_come
            try:
                self._is_routing = True
                came: list[Message] = []
                taken: list[Message] = []
                changes: list[tuple[str, int, int]] = []
                self._route_together()
                while self._arrived or self._changed:
                    if self._changed and not (self._arrived and self._arrived[0].t <= self._changed[0][1] / 1e6):
                        changes.append(self._changed[0])
                        self._route_change(*changes[-1])
                        continue
                    message = self._arrived[0]
                    came.append(message)
                    if self._route(message):
                        taken.append(message)
                if self._relay is not None and (came or changes):
                    self._relay(came, taken, changes)
                self.relayed += len(came)
            finally:
                self._is_routing = False
        return has_come

    def _route_together(self) -> None:
        """Move all new messages in a few calls of C if they all go to the same place. Otherwise route them one by
        one."""
        count = len(self._arrived)
        if count == 0 or self._changed or self._relay is not None or self._sender is not None:
            return
        names = set(map(_NAME, self._arrived))
        wanted = set(map(self.handlers.want, names))
        watched = self._watchers.keys() & names
        if len(wanted) > 1 or watched or self.requests.may_take(self._arrived):
            return
        self._newest.update(zip(map(_NAME, self._arrived), self._arrived, strict=True))
        if wanted.pop():
            self.handlers.move_from(self._arrived, count)
        else:
            move(self._arrived, self._queue, count)
            self._drop_oldest()
            self._tell()
        self.relayed += count

    def _route(self, message: Message) -> bool:
        """Deliver the message that arrived first. True: it answered a request."""
        self._note(message)
        watcher = self._watchers.get(message.name)
        if watcher is not None:
            watcher(message)
        is_taken = self.requests.take(message)
        if self.handlers.want(message.name):
            self.handlers.move_from(self._arrived, 1)
        elif is_taken or self._relay is not None:
            self._arrived.popleft()
        else:
            move(self._arrived, self._queue, 1)
            self._drop_oldest()
            self._tell()
        return is_taken

    def _route_change(self, kind: str, t_us: int, action: int) -> None:
        t = t_us / 1e6
        if kind in ("struck", "ended"):
            self.handlers.put_change(self._actions[action], kind == "struck", t, self._changed.popleft)
            return
        for watcher in self._port_watchers:
            watcher(kind == "port_up", t)
        self._changed.popleft()

    def _tell(self) -> None:
        for listener in self._listeners:
            listener()
