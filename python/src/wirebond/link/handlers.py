"""Functions that a link calls with messages, and when a deadline strikes or ends. One thread calls all of them."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from itertools import repeat
from operator import call
from queue import Empty, SimpleQueue
from typing import Any

from wirebond.codec import Message

MAX_WAITING = 65536  # messages that wait for slow handlers; then the oldest are dropped, counted
_REPORT_EVERY = 1.0  # seconds between two reports of one handler's errors

_log = logging.getLogger("wirebond")


@dataclass(frozen=True)
class DeadlineEvent:
    """A deadline of the host has struck, or has ended.

    :ivar action: the deadline's ``then``.
    :ivar struck: True: it has struck; False: it has ended.
    :ivar t: when the link's thread saw it, on ``time.monotonic()``. For one that had struck before the function was
        registered: when the function is called.
    """

    action: str
    struck: bool
    t: float


@dataclass(eq=False)
class _Handler:
    function: Callable[..., object]  # given by the program
    call: Callable[[Any], object]  # called with a message or an event
    name: str | None  # of the message or the action; None: all
    told: set[str] = field(default_factory=set)  # actions that it knows as struck
    since: float = 0.0  # when it was registered
    is_new: bool = True  # it does not know yet which deadlines had struck before
    is_removed: bool = False
    reported: float = -_REPORT_EVERY
    unreported: int = 0


def move(source: deque[Any], target: SimpleQueue[Any], count: int) -> None:
    """Move the first ``count``, in one call of C: no signal comes between."""
    deque(map(target.put, map(call, repeat(source.popleft, count))), maxlen=0)


class Handlers:
    """The functions, and the thread that calls them. Any thread may add and remove.

    :param place: for the thread's name and for reports.
    :param struck: the actions that have struck and not ended.
    :param give_back: takes a message whose handlers were removed while it waited.
    :param attend: what the thread does while no handler has anything to do: it waits, and may route what comes.
    :param recall: ends that wait, of this time or of the next one.
    """

    def __init__(
        self,
        place: str,
        struck: Callable[[], set[str]],
        give_back: Callable[[Message], None],
        attend: Callable[[], None],
        recall: Callable[[], None],
    ) -> None:
        self._place = place
        self._struck = struck
        self._give_back = give_back
        self._attend = attend
        self._recall = recall
        self._lock = threading.RLock()
        self._of_messages: tuple[_Handler, ...] = ()
        self._of_deadlines: tuple[_Handler, ...] = ()
        self._queue: SimpleQueue[Message | DeadlineEvent] = SimpleQueue()
        self._thread: threading.Thread | None = None
        self._has_ended = False
        self._is_left = False  # nothing more is called
        self._is_calling = False
        self.errors = 0  # handlers that raised
        self.dropped = 0  # messages that waited too long

    # ---- called by programs

    def add(self, function: Callable[..., object], name: str | None, call: Callable[[Any], object]) -> None:
        """Call ``call`` with each message of this name; ``function`` is what ``remove`` knows it by."""
        with self._lock:
            self._of_messages += (_Handler(function, call, name),)

    def add_deadline(self, function: Callable[..., object], action: str | None, call: Callable[[Any], object]) -> None:
        """Call ``call`` when this deadline strikes and ends; at once where it has struck."""
        with self._lock:
            self._of_deadlines += (_Handler(function, call, action, since=time.monotonic()),)
        self._recall()

    def remove(self, function: Callable[..., object]) -> bool:
        """Stop calling it. False: it was not registered."""
        with self._lock:
            removed = [h for h in (*self._of_messages, *self._of_deadlines) if h.function == function]
            for handler in removed:
                handler.is_removed = True
            self._of_messages = tuple(h for h in self._of_messages if not h.is_removed)
            self._of_deadlines = tuple(h for h in self._of_deadlines if not h.is_removed)
            return bool(removed)

    # ---- called by the link

    def start(self) -> None:
        """Start the thread, once."""
        with self._lock:
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name=f"handlers of {self._place}", daemon=True)
                self._thread.start()

    def want(self, name: str) -> bool:
        """Check whether there is a handler for messages of this name."""
        handlers = self._of_messages
        return bool(handlers) and any(h.name is None or h.name == name for h in handlers)

    def move_from(self, messages: deque[Message], count: int) -> None:
        """Queue the first ``count`` of these. One thread at a time."""
        move(messages, self._queue, count)
        while self._queue.qsize() > MAX_WAITING and self._drop_oldest():
            pass
        self._rouse()

    def put_change(self, action: str, struck: bool, t: float, remove: Callable[[], object]) -> None:
        """Note that a deadline has struck or ended. ``remove``, of C, removes it at its source. One thread at a
        time."""
        steps: list[Callable[[], object]] = [remove]
        if self._of_deadlines:
            steps.append(partial(self._queue.put, DeadlineEvent(action, struck, t)))
        deque(map(call, steps), maxlen=0)  # in one call of C
        self._rouse()

    def end(self) -> None:
        """End the thread after the waiting messages: no more will come."""
        self._has_ended = True
        self._recall()

    def is_own_thread(self) -> bool:
        """Check whether the caller is a handler."""
        return self._thread is threading.current_thread()

    def leave(self, patience: float) -> None:
        """Wait until the thread has called all that waits and has ended; after ``patience`` seconds it calls nothing
        more, and what is left is dropped. In a handler this returns at once."""
        thread = self._thread
        if thread is None or thread is threading.current_thread():
            return
        thread.join(patience)
        if thread.is_alive():
            self._is_left = True
            while self._drop_oldest():
                pass

    def stop(self, patience: float) -> None:
        """Begin no further call, and wait for one that has begun, because the interpreter ends."""
        self._is_left = True
        self._recall()
        until = time.monotonic() + patience
        while self._is_calling and time.monotonic() < until and self._thread is not threading.current_thread():
            time.sleep(0.001)

    def note_error(self, function: Callable[..., object], error: BaseException) -> None:
        """Count an exception of a handler, and report it to ``logging``, each handler once a second at most."""
        with self._lock:
            self.errors += 1
            handlers = (*self._of_messages, *self._of_deadlines)
            handler = next((h for h in handlers if h.function == function), None)
            more = ""
            if handler is not None:
                handler.unreported += 1
                now = time.monotonic()
                if now - handler.reported < _REPORT_EVERY:
                    return
                if handler.unreported > 1:
                    more = f" ({handler.unreported} times since the last report)"
                handler.reported, handler.unreported = now, 0
        name = getattr(function, "__qualname__", repr(function))
        _log.error("handler %s of %s raised %s%s; the link goes on", name, self._place, type(error).__name__, more,
                   exc_info=error)  # fmt: skip

    def _rouse(self) -> None:
        """Wake the thread."""
        if self._thread is not threading.current_thread():
            self._recall()

    # ---- the thread

    def _run(self) -> None:
        looked: tuple[_Handler, ...] = ()  # handlers of deadlines that know which ones had struck before they came
        while not self._is_left:
            has_ended = self._has_ended  # before the check of the queue
            if self._of_deadlines is not looked:
                looked = self._of_deadlines
                self._tell_what_has_struck(looked)
            try:
                item = self._queue.get_nowait()
            except Empty:
                if has_ended:
                    return
                self._attend()
                continue
            if isinstance(item, DeadlineEvent):
                self._call_for_change(item)
            else:
                self._call_for(item)

    def _call_for(self, message: Message) -> None:
        called = False
        name = message.name
        for handler in self._of_messages:
            if handler.name is None or handler.name == name:
                called = self._call(handler, message) or called
        if not called:
            self._give_back(message)

    def _tell_what_has_struck(self, handlers: tuple[_Handler, ...]) -> None:
        """Call new handlers with the deadlines that have struck."""
        struck = self._struck()
        for handler in handlers:
            is_new, handler.is_new = handler.is_new, False
            for action in sorted(struck) if is_new else ():
                if handler.name is None or handler.name == action:
                    handler.told.add(action)
                    self._call(handler, DeadlineEvent(action, True, time.monotonic()))

    def _call_for_change(self, event: DeadlineEvent) -> None:
        for handler in self._of_deadlines:
            knows = event.action in handler.told
            if handler.name not in (None, event.action) or knows == event.struck or event.t < handler.since:
                continue
            handler.told ^= {event.action}
            self._call(handler, event)

    def _call(self, handler: _Handler, value: object) -> bool:
        """Call a handler. False: it was removed before."""
        self._is_calling = True
        try:
            if self._is_left or handler.is_removed:
                return False
            handler.call(value)
        except BaseException as error:
            self.note_error(handler.function, error)
        finally:
            self._is_calling = False
        return True

    def _drop_oldest(self) -> bool:
        try:
            self.dropped += isinstance(self._queue.get_nowait(), Message)
        except Empty:
            return False
        return True
