"""A link whose port is driven from Python, for ports that the engine does not open itself: threads around a LinkCore.

It has the methods of the engine's own ``Link``, so that ``wirebond.Link`` uses the one as the other. Its threads: the
supervisor writes; a reader, one for each time that the port is open, reads; an opener, one for each try, opens. None of
them holds the lock in that time. One file: its threads share one lock.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import threading
import time
from collections.abc import Callable, Iterable
from typing import Any

from wirebond import _engine
from wirebond.codec import Message
from wirebond.errors import LinkDownError, PortError
from wirebond.link.attention import Attention
from wirebond.link.engine_settings import EngineSettings, SafeValue
from wirebond.link.python_ports import PortOpener, PortThread, PythonPort

# As those of the engine's link: how long after a port went away, or could not be opened, it is tried again.
_FIRST_OPEN_WAIT = 0.02
_LAST_OPEN_WAIT = 1.0
_LAST_WATCHED_WAIT = 0.2  # checking a file costs little, if its appearance should be missed
_LEAST_OPEN_WAIT = 0.005  # however much appears
_SETTLED_AFTER = 1.0  # a port that lasted so long is not a port that fails at once
_DRAIN_ON_CLOSE = 1.0
_LONGEST_SLEEP = 0.5
_LOOK = 0.02  # seconds between two checks for a port that is away


def _now() -> int:
    return time.monotonic_ns() // 1000


class PythonLink:
    """Any thread may call any method. Objects that are collected in the middle of a call may call it, too: so the lock
    can be taken again by its owner, and no one waits for a thread while holding it.

    :param opener: opens the port; here first, before this returns.
    :param waits: a port that cannot be opened is not an error.
    :param clock: microseconds; a replay has one of its own.
    :param waits_for_reader: nothing more is read while messages wait to be taken: for a replay as fast as possible.
    :raises PortError: it cannot be opened.
    """

    def __init__(
        self,
        protocol: _engine.ProtocolTable,
        receive: _engine.FormatTable,
        opener: PortOpener,
        settings: EngineSettings,
        waits: bool,
        clock: Callable[[], int] = _now,
        waits_for_reader: bool = False,
    ) -> None:
        self._clock = clock
        self._waits_for_reader = waits_for_reader
        self._process = os.getpid()
        self._opener = opener
        self._core = _engine.LinkCore(protocol, receive, settings, self._clock())
        self._lock = threading.RLock()
        self._work = threading.Condition(self._lock)  # for the supervisor
        self._taken = threading.Condition(self._lock)  # for a reader that waits until messages are taken
        self._arrived = threading.Condition(self._lock)  # for who takes messages, or waits for the end
        self._attention = Attention(self._arrived, self._core.has_news, lambda: self._is_done)
        self._port: PythonPort | None = None
        self._left: PythonPort | None = None  # went down, to be closed by the supervisor
        self._reader: threading.Thread | None = None
        self._opening: threading.Thread | None = None
        self._line: dict[str, Any] | None = None
        self._why = ""
        self._up_since = 0.0
        self._next_open = 0.0
        self._open_wait = _FIRST_OPEN_WAIT
        self._seen: object = None  # the appearance of the port, from before it was last opened or tried
        self._planned = 0  # when the supervisor wakes by itself
        self._is_closing = False
        self._close_by = 0.0
        self._is_done = False
        self._seen = opener.appearance()
        try:
            self._come_up(opener.open())
        except PortError as error:
            if not waits:
                raise
            self._why = str(error)
            self._look_again(time.monotonic())
        self._supervisor = PortThread(target=self._run, name="port of a link", daemon=True)
        self._supervisor.start()

    # ---- called by programs

    def send(self, message: int, frame: bytes, reply: int, takes_number: bool, address: int) -> int:
        with self._owned():
            answer = self._core.send(message, frame, reply, self._clock(), takes_number, address)
            self._wake_if_late()
            return answer

    def send_all(self, frames: list[tuple[int, bytes]]) -> list[int]:
        with self._owned():
            now = self._clock()
            answers = [self._core.send(message, frame, -1, now) for message, frame in frames]
            self._wake_if_late()
            return answers

    def repeat(self, message: int, frame: bytes, hold: float, reply: int, takes_number: bool, address: int) -> int:
        with self._owned():
            answer = self._core.repeat(message, frame, hold, reply, self._clock(), takes_number, address)
            self._wake_if_late()
            return answer

    def stop_repeating(self, message: int, address: int | None = None) -> None:
        with self._owned():
            self._core.stop_repeating(message, address)

    def note_safe(self, safe: SafeValue) -> bool:
        with self._owned():
            return self._core.note_safe(safe)

    def end_safely(self, message: int, address: int) -> bool:
        with self._owned():
            has_one = self._core.end_safely(message, address)
            self._wake_if_late()
            return has_one

    def end_if_moved(self, message: int, address: int) -> bool:
        with self._owned():
            has_one = self._core.end_if_moved(message, address)
            self._wake_if_late()
            return has_one

    def hand_over(self) -> None:
        with self._owned():
            self._core.hand_over_motion()

    def end_motion(self) -> None:
        with self._owned():
            self._core.end_motion()
            self._wake_if_late()

    def set_address(self, address: int) -> None:
        with self._owned():
            self._core.set_address(address)

    def listen_to_all(self, all: bool) -> None:
        with self._owned():
            self._core.listen_to_all(all)

    def stop(self) -> bool:
        with self._owned():
            if self._is_done or (self._is_closing and self._port is None):
                return False
            self._core.stop(self._clock())
            self._wake_if_late()
            return True

    def release_stop(self) -> None:
        with self._owned():
            self._core.release_stop()

    def is_stopped(self) -> bool:
        with self._owned():
            return self._core.is_stopped()

    def receive(self, timeout: float) -> Iterable[Message]:
        """Wait as the engine's link does. The messages are taken when the result is read, in one call of C: a signal's
        handler that raises can lose none."""
        return self._receive(self._attention.wait, timeout)

    def attend(self, timeout: float) -> Iterable[Message]:
        return self._receive(self._attention.attend, timeout)

    def recall(self) -> None:
        self._owned()  # in a forked child it raises
        self._attention.recall()

    def wait_unattended(self, timeout: float) -> None:
        self._owned()
        self._attention.wait_unattended(timeout)

    def _receive(self, wait: Callable[[float], None], timeout: float) -> Iterable[Message]:
        with self._owned():
            self._taken.notify_all()  # earlier messages were taken
            wait(timeout)
        return itertools.chain.from_iterable(itertools.starmap(self._core.receive, ((),)))

    def changes(self) -> Iterable[tuple[str, int, int]]:
        self._owned()  # in a forked child it raises
        return itertools.chain.from_iterable(itertools.starmap(self._core.changes, ((),)))

    def line(self) -> dict[str, Any] | None:
        with self._owned():
            return None if self._line is None else dict(self._line)

    def set_stamper(self, stamper: Callable[[Message], tuple[float, float] | None] | None) -> None:
        with self._owned():
            self._core.set_stamper(stamper)

    def stats(self) -> dict[str, Any]:
        with self._owned():
            return self._core.stats()

    def recent(self) -> tuple[list[tuple[str, int, bytes]], int]:
        with self._owned():
            return self._core.recent()

    def open_tap(self, capacity: int) -> int:
        with self._owned():
            return self._core.open_tap(capacity, self._clock())

    def take_tap(self, tap: int) -> tuple[list[tuple[str, int, int, bytes]], int, int, int]:
        with self._owned():
            return self._core.take_tap(tap)

    def close_tap(self, tap: int) -> None:
        with self._owned():
            self._core.close_tap(tap)

    def note(self, text: str) -> None:
        with self._owned():
            self._core.note(text, self._clock())

    def state(self) -> str:
        with self._owned():
            return self._core.state(self._clock())

    def why(self) -> str:
        with self._owned():
            return self._why

    def is_closed(self) -> bool:
        with self._owned():
            return self._is_closing

    def struck_deadlines(self) -> list[int]:
        with self._owned():
            return self._core.struck_deadlines()

    def recover_deadline(self, action: int) -> None:
        with self._owned():
            self._core.recover_deadline(action, self._clock())
            self._arrived.notify_all()
            self._wake_if_late()

    def begin_close(self) -> None:
        if os.getpid() != self._process:
            return
        with self._lock:
            if self._is_closing:
                return
            self._is_closing = True
            self._close_by = time.monotonic() + _DRAIN_ON_CLOSE
            self._core.close()
            self._work.notify()

    def close(self) -> None:
        if os.getpid() != self._process:
            return
        self.begin_close()
        if isinstance(threading.current_thread(), PortThread):
            return  # it collects garbage; the link ends after this
        with self._lock:
            while not self._is_done and (left := self._close_by + 0.1 - time.monotonic()) > 0:
                self._arrived.wait(left)
            while not self._is_done:  # the port takes nothing
                if self._port is not None:
                    self._port.cancel()
                self._arrived.wait(0.1)

    def after_fork(self) -> None:
        port, self._port = self._port, None
        if port is not None and os.getpid() != self._process:
            port.leave_to_parent()

    def _owned(self) -> threading.RLock:
        """Return the lock.

        :raises LinkDownError: this is a forked child, which has neither the threads nor the lock.
        """
        if os.getpid() != self._process:
            raise LinkDownError(
                "this link belongs to the process that opened it, and this one is its fork; open the port in the "
                "process that uses it"
            )
        return self._lock

    # ---- with the lock

    def _wake_if_late(self) -> None:
        if self._core.next_due(self._clock()) < self._planned:
            self._planned = 0
            self._work.notify()

    def _come_up(self, port: PythonPort) -> None:
        self._port = port
        self._line = self._opener.line
        self._why = ""
        self._up_since = time.monotonic()
        self._core.port_up(self._clock())
        self._reader = PortThread(target=self._read, args=(port,), name="reader of a link", daemon=True)
        self._reader.start()

    def _go_down(self, port: PythonPort, error: OSError | None) -> None:
        if self._port is not port:
            return
        self._port, self._left = None, port
        self._why = self._opener.why_gone(error)
        self._core.port_down(self._clock(), "" if self._is_closing else self._why)
        now = time.monotonic()
        if now - self._up_since > _SETTLED_AFTER:
            self._open_wait = _FIRST_OPEN_WAIT
        self._look_again(now)
        self._arrived.notify_all()
        self._work.notify()

    def _look_again(self, now: float) -> None:
        """Schedule the next try, and watch for events that bring it forward."""
        self._next_open = now + self._open_wait
        self._open_wait = min(2 * self._open_wait, _LAST_OPEN_WAIT if self._seen is None else _LAST_WATCHED_WAIT)

    # ---- the reader

    def _read(self, port: PythonPort) -> None:
        try:
            while True:
                with self._lock:
                    while self._waits_for_reader and self._core.has_arrivals() and self._port is port:
                        self._taken.wait(_LOOK)
                    if self._port is not port:
                        return
                    self._core.poll(self._clock())
                began = self._clock()
                data, looked = port.read()
                with self._lock:
                    if self._port is not port:
                        return
                    if data:
                        now = self._clock()
                        self._core.received(data, min(round(looked * 1e6), now), now)
                    else:
                        self._core.idle(began if self._clock is _now else round(looked * 1e6))
                    if self._core.has_news():
                        self._arrived.notify_all()
                    self._wake_if_late()
        except OSError as error:
            port.cancel()  # a write that waits
            with self._lock:
                self._go_down(port, error)

    # ---- the supervisor

    def _run(self) -> None:
        while True:
            with self._lock:
                port = self._port
                if self._is_closing and (port is None or self._core.is_empty() or time.monotonic() >= self._close_by):
                    break
                now = self._clock()
                self._core.poll(now)
                if self._core.has_news():
                    self._arrived.notify_all()
                data = b"" if port is None else self._claim(port, now)
                if not data:
                    if port is None and self._left is None:
                        self._open_again()
                    if self._left is None:
                        self._sleep(now)
                    port = None
            if port is not None:
                self._write(port, data)
            self._give_back()
        with self._lock:
            if self._port is not None:
                self._go_down(self._port, None)
        self._give_back()
        with self._lock:
            self._why = ""
            self._core.end(self._clock())
            self._is_done = True
            self._arrived.notify_all()

    def _claim(self, port: PythonPort, now: int) -> bytes:
        """Take bytes for the port. All but the last one count as written: a frame has left when the write has
        returned."""
        with contextlib.suppress(OSError):
            held = port.held()
            if held > 0:
                self._core.driver_holds(held, now)
        return self._core.hand_over(now)

    def _write(self, port: PythonPort, data: bytes) -> None:
        error: OSError | None = None
        try:
            done = port.write(data)
        except OSError as caught:
            done, error = 0, caught
        with self._lock:
            if self._port is not port:
                return
            if done == len(data):
                if len(data) > 1:
                    self._core.written(1, self._clock())
            else:
                self._go_down(port, error)

    def _sleep(self, now: int) -> None:
        due = min(self._core.next_due(now), now + int(_LONGEST_SLEEP * 1e6))
        if self._port is None:
            due = min(due, now + int(_LOOK * 1e6))
        if self._is_closing:
            due = min(due, now + 10_000)
        self._planned = due
        if due > now:
            self._work.wait((due - now) / 1e6)
        self._planned = 0

    def _give_back(self) -> None:
        """Close the port that went down, after its reader."""
        port = self._left
        if port is None:
            return
        port.cancel()
        reader, self._reader = self._reader, None
        if reader is not None:
            reader.join()
        port.close()
        self._left = None

    def _open_again(self) -> None:
        """Open the port again, in a thread of its own: it may take seconds, and leases end in that time."""
        now = time.monotonic()
        if self._opening is not None or self._is_closing:
            return
        if now < self._next_open and (seen := self._opener.appearance()) != self._seen:
            self._seen = seen
            self._open_wait = _FIRST_OPEN_WAIT
            self._next_open = min(self._next_open, now + _LEAST_OPEN_WAIT)
        if now < self._next_open:
            return
        self._seen = self._opener.appearance()  # before the check: a change during it is seen by the next one
        self._opening = PortThread(target=self._open, name="opener of a link", daemon=True)
        self._opening.start()

    def _open(self) -> None:
        port: PythonPort | None = None
        try:
            port = self._opener.open()
        except PortError as error:
            sentence = str(error)
        with self._lock:
            self._opening = None
            if port is None:
                self._why = sentence if not self._is_closing else self._why
                self._look_again(time.monotonic())
            elif not self._is_closing:
                self._come_up(port)
                self._arrived.notify_all()
                port = None
            self._work.notify()
        if port is not None:  # the link ended in the meantime
            port.close()
