"""A link that a server owns: every call is a message to the server, and received messages come from it.

It has the methods of the engine's own ``Link``, so that ``wirebond.Link`` uses the one as the other. One thread: it
connects, reads, and tells the server ten times a second that the program runs. One file: its calls, its connection and
its thread share one lock.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import msgspec

from wirebond import _engine
from wirebond.codec import Codec, Message
from wirebond.errors import (
    LateCommandError,
    LinkDownError,
    NotInControlError,
    PortError,
    StoppedByOtherError,
    UsageError,
    WirebondError,
)
from wirebond.link.attached import words
from wirebond.link.attached.address import ServerAddress
from wirebond.link.attached.attached_requests import TAKEN, AttachedRequests
from wirebond.link.attached.attaching import LOOKS, LOOPBACK, PATIENCE, attach, comes, name_of_program
from wirebond.link.attached.words import Control, Welcome
from wirebond.link.attention import Attention
from wirebond.link.clock_line import ClockLine
from wirebond.link.ends import other
from wirebond.link.engine_settings import SafeValue
from wirebond.protocol.model import End

_DISK_PATIENCE = 30.0  # the same, where it waits for its disk
_FIRST_WAIT, _LAST_WAIT = 0.02, 1.0  # seconds before it is tried again to connect
_MOST_WAITING = 65536  # messages that the program has not taken; then the oldest are dropped, counted
_DOWN, _FULL, _STOPPED = 1, 2, 3  # answers of the engine
# What bytes raise that are not a message of a server.
_NOT_OF_A_SERVER = (msgspec.MsgspecError, ValueError, KeyError, TypeError, AttributeError, RecursionError)
_REFUSALS = {"down": _DOWN, "full": _FULL, "stopped": _STOPPED}


class _Call:
    def __init__(self) -> None:
        self.done = threading.Event()
        self.answer: dict[str, Any] = {}


class AttachedLink:
    """Any thread may call any method.

    :param end: the one that the program wants to play.
    :param waits: a server that is not there is no error.
    :raises PortError: it cannot be reached, or refuses.
    :raises UsageError: it owns a link of another protocol, or plays the other end.
    """

    def __init__(self, codec: Codec, end: End, address: ServerAddress, waits: bool) -> None:
        self._process = os.getpid()
        self._codec = codec
        self._end = end
        self._format = codec.tables.format_for(other(end))
        self._address = address
        self._name = name_of_program()
        self._lock = threading.RLock()
        self._arrived = threading.Condition(self._lock)
        self._attention = Attention(self._arrived, lambda: bool(self._messages or self._changes), lambda: self._is_done)
        self._write_lock = threading.RLock()
        self._calls: dict[int, _Call] = {}
        self._number = 0
        self._asking = threading.local()
        self._messages: deque[Message | None] = deque()  # None: a reader takes the messages before it
        self._changes: deque[tuple[str, int, int] | None] = deque()  # likewise
        self._questions: dict[int, int] = {}  # by the offset of the reply
        self._dropped = 0
        self._taps: set[int] = set()  # that are open
        self._last_stats: dict[str, Any] | None = None  # of a link that is closed
        self._last_taken: dict[int, Any] = {}  # the same of its taps
        self._tick = 0
        self._shift = 0.0  # seconds from the server's clock to this one
        self._stamper: Callable[[Message], tuple[float, float] | None] | None = None
        self._control = Control()
        self._socket: socket.socket | None = None
        self._why = ""
        self.welcome: Welcome | None = None  # of the newest connection
        self._is_closing = False
        self._is_done = False
        self._leaves = threading.Event()
        self._wake = threading.Event()  # ends a wait for the server
        self.answers: AttachedRequests | None = None  # until the link has its requests, no program waits for replies
        try:
            self._connect()
        except PortError as error:
            if not waits:
                raise
            self._why = str(error)
        self._thread = threading.Thread(target=self._run, name=f"attached to {address.text}", daemon=True)
        self._thread.start()

    # ---- sending

    def send(self, message: int, frame: bytes, reply: int, takes_number: bool, address: int) -> int:  # noqa: ARG002
        name = self._codec.model.messages[message].name
        number = getattr(self._asking, "number", 0)
        request = words.Send(
            message=name, frame=frame, takes_number=takes_number, reply=3600.0 if number and reply >= 0 else None
        )
        return self._command(request, number)

    def send_all(self, frames: list[tuple[int, bytes]]) -> list[int | WirebondError]:
        """Send all requests before the first answer is awaited."""
        messages = self._codec.model.messages
        return self._commands([words.Send(message=messages[index].name, frame=frame) for index, frame in frames])

    def repeat(self, message: int, frame: bytes, hold: float, reply: int, takes_number: bool, address: int) -> int:  # noqa: ARG002
        name = self._codec.model.messages[message].name
        return self._command(words.Repeat(message=name, frame=frame, hold=hold, takes_number=takes_number), 0)

    def stop_repeating(self, message: int, address: int | None = None) -> None:
        self._call(words.StopRepeating(message=self._codec.model.messages[message].name, address=address))

    def note_safe(self, safe: SafeValue) -> bool:  # noqa: ARG002
        return True  # the server knows the file's stop, and where frames went

    def end_safely(self, message: int, address: int) -> bool:
        name = self._codec.model.messages[message].name
        return bool(self._call(words.EndSafely(message=name, address=address)))

    def end_if_moved(self, message: int, address: int) -> bool:
        return self.end_safely(message, address)  # the server does not report what moved

    def hand_over(self) -> None:
        self._call(words.HandOver())

    def set_address(self, address: int) -> None:
        self._call(words.SetAddress(address=address))

    def listen_to_all(self, all: bool) -> None:
        """Do nothing: the server decides this for all."""

    def stop(self) -> bool:
        if self._is_closing:
            return False
        self._call(words.Stop())
        return True

    def release_stop(self, over: bool | str = False) -> None:
        answer = self._exchange_now(words.ReleaseStop(over=over))
        if answer.get("error") == "stopped_by_other":
            raise StoppedByOtherError(answer["text"], answer["by"])
        if answer.get("error") == "late":
            raise LateCommandError(answer["text"])
        if "error" in answer:
            raise UsageError(answer["text"])

    def is_stopped(self) -> bool:
        return bool(self._ask("stopped", False))

    # ---- control

    def take_control(self, over: bool | str) -> None:
        answer = self._exchange_now(words.Take(over=over))
        if answer.get("error") == "late":
            raise LateCommandError(answer["text"])
        if "error" in answer:
            raise NotInControlError(answer["text"])

    def release_control(self) -> None:
        self._call(words.Release())

    def control(self) -> Control:
        with self._owned():
            return self._control

    # ---- requests

    def next_number(self) -> int:
        """Return the number for the next call."""
        with self._owned():
            self._number += 1
            return self._number

    @contextlib.contextmanager
    def asking(self, number: int) -> Iterator[None]:
        """Send everything of this thread as the request with this number."""
        self._asking.number = number
        try:
            yield
        finally:
            self._asking.number = 0

    def withdraw(self, number: int) -> None:
        with contextlib.suppress(WirebondError):
            self._call(words.Withdraw(request=number))

    def about(self, number: int) -> dict[str, Any] | None:
        """Return the server's facts about a request without a reply, or None."""
        try:
            found: dict[str, Any] | None = self._call(words.About(request=number))
        except WirebondError:
            return None
        return found

    def question_of(self, message: Message) -> int:
        """Return the number of the request that this message answers; 0: of none; ``TAKEN``: one of the server's
        own."""
        with self._lock:
            return self._questions.pop(message.offset, 0)

    def know_question_of(self, messages: Sequence[Message]) -> bool:
        """Return False if ``question_of`` is 0 for each of these."""
        return bool(self._questions) and any(message.offset in self._questions for message in messages)

    # ---- receiving

    def receive(self, timeout: float) -> Iterable[Message]:
        """Wait as the engine's link does. The messages are taken when the result is read, without a step of Python: a
        signal's handler that raises can lose none."""
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
            wait(timeout)
            self._messages.append(None)
        return iter(self._messages.popleft, None)

    def changes(self) -> Iterable[tuple[str, int, int]]:
        with self._owned():
            self._changes.append(None)
        return iter(self._changes.popleft, None)

    # ---- how it is

    def stats(self) -> dict[str, Any]:
        with self._owned():
            last = self._last_stats
        raw = self._call(words.Ask(what="stats")) if last is None else last
        return {**raw, "dropped_messages": raw["dropped_messages"] + self._dropped}

    def recent(self) -> tuple[list[tuple[str, int, bytes]], int]:
        pieces, dropped = self._call(words.Ask(what="recent"))
        shift = round(self._shift * 1e6)
        return [(kind, t + shift, msgspec.convert(data, bytes, strict=False)) for kind, t, data in pieces], dropped

    def state(self) -> str:
        return str(self._ask("state", "down"))

    def why(self) -> str:
        with self._owned():
            if self._socket is None:
                return self._why
        return str(self._ask("why", self._why))

    def line(self) -> dict[str, Any] | None:
        found: dict[str, Any] | None = self._ask("line", None)
        return found

    @property
    def is_on_this_computer(self) -> bool:
        """Is it reached by a Unix socket?"""
        return bool(self._address.path)

    def is_closed(self) -> bool:
        with self._owned():
            return self._is_closing

    def struck_deadlines(self) -> list[int]:
        return list(self._ask("struck", []))

    def recover_deadline(self, action: int) -> None:
        self._call(words.Recover(action=action))

    def peer(self) -> dict[str, Any] | None:
        """Return the peer as JSON; None: the server is away."""
        found = self._ask("peer", None)
        return found if found is None or found["since"] is None else {**found, "since": found["since"] + self._shift}

    def clock(self) -> dict[str, Any] | None:
        """Return the clock as JSON; None: it is not known."""
        found: dict[str, Any] | None = self._ask("clock", None)
        return found

    def set_stamper(self, stamper: Callable[[Message], tuple[float, float] | None] | None) -> None:
        self._stamper = stamper

    def clock_line(self) -> tuple[ClockLine | None, float]:
        """Return the server's knowledge of the clock, and the seconds from its clock to this one."""
        found = self._ask("clock_line", None)
        return None if found is None else msgspec.convert(found, ClockLine), self._shift

    def host_time(self, mcu_us: int, near: float) -> tuple[float, float]:
        answer = self._exchange(words.HostTimeOf(mcu_us=mcu_us, near=near - self._shift))
        if "error" in answer:
            raise UsageError(answer["text"])
        t, error = answer["ok"]
        return t + self._shift, error

    # ---- recordings

    def open_tap(self, capacity: int) -> int:
        tap = int(self._call(words.OpenTap(capacity=capacity)))
        with self._lock:
            self._taps.add(tap)
        return tap

    def take_tap(self, tap: int) -> tuple[list[tuple[str, int, int, bytes]], int, int, int]:
        with self._owned():
            last = self._last_taken.pop(tap, None) if self._is_closing else None
            if last is None and self._is_done:
                return [], 0, 0, 0
        pieces, *lost = self._call(words.TakeTap(tap=tap)) if last is None else last
        shift = round(self._shift * 1e6)
        taken = [
            (kind, t + shift, before + shift, msgspec.convert(data, bytes, strict=False))
            for kind, t, before, data in pieces
        ]
        return taken, *lost

    def close_tap(self, tap: int) -> None:
        with self._owned():
            self._taps.discard(tap)
            self._last_taken.pop(tap, None)
        with contextlib.suppress(LinkDownError):
            self._call(words.CloseTap(tap=tap))

    def note(self, text: str) -> None:
        self._call(words.Note(text=text))

    def of_recordings(self, request: words.OfRecordings | words.Mark | words.Ask) -> Any:
        """Return an answer of the server about its recordings, for which it waits for its disk.

        :raises UsageError: it refuses.
        :raises LinkDownError: it is away.
        """
        answer = self._exchange(request, patience=_DISK_PATIENCE)
        if "error" in answer:
            raise UsageError(answer["text"])
        return answer["ok"]

    # ---- the end

    def begin_close(self) -> None:
        if os.getpid() != self._process:
            return
        with self._lock:
            if self._is_closing:
                return
            self._is_closing = True
        self._wake.set()
        with contextlib.suppress(OSError, WirebondError):
            self._write(words.Leave(id=self.next_number()))

    def close(self) -> None:
        if os.getpid() != self._process:
            return
        self.begin_close()
        if threading.current_thread() is not self._thread and self._socket is not None:
            comes(self._leaves, PATIENCE)
            with contextlib.suppress(WirebondError):
                self._last_stats = self._call(words.Ask(what="stats"))
                self._last_taken = {tap: self._call(words.TakeTap(tap=tap)) for tap in self._taps}
        self._end_thread()

    def after_fork(self) -> None:
        found, self._socket = self._socket, None
        if found is not None and os.getpid() != self._process:
            os.close(found.detach())

    def _end_thread(self) -> None:
        self._disconnect("")
        with self._lock:
            self._is_done = True
            self._arrived.notify_all()

    # ---- calls

    def _owned(self) -> threading.RLock:
        """Return the lock.

        :raises LinkDownError: this is a forked child.
        """
        if os.getpid() != self._process:
            raise LinkDownError(
                "this link belongs to the process that opened it, and this one is its fork; attach in the process that "
                "uses it"
            )
        return self._lock

    def _command(self, request: words.Send | words.Repeat, number: int) -> int:
        if self.is_closed() or self._socket is None:
            return _DOWN
        request.tick = self._tick
        try:
            answer = self._exchange(request, number)
        except LinkDownError:
            return _DOWN
        return self._result(answer)

    def _commands(self, requests: list[words.Send]) -> list[int | WirebondError]:
        if self.is_closed() or self._socket is None:
            return [_DOWN] * len(requests)
        calls = []
        with self._owned():
            for request in requests:
                self._number += 1
                request.id, request.tick = self._number, self._tick
                calls.append(_Call())
                self._calls[request.id] = calls[-1]
        try:
            self._write_all(requests)
            looks = LOOKS
            for call in calls:
                while looks and not call.done.wait(PATIENCE / LOOKS):
                    looks -= 1
        except LinkDownError:
            pass  # calls without an answer say so
        finally:
            with self._lock:
                for request in requests:
                    self._calls.pop(request.id, None)
        results: list[int | WirebondError] = []
        for call in calls:
            try:
                results.append(self._result(call.answer) if call.answer else _DOWN)
            except WirebondError as error:
                results.append(error)
        return results

    def _result(self, answer: dict[str, Any]) -> int:
        """Return an answer as the engine does; errors that the engine does not have are raised."""
        error = answer.get("error")
        if error is None:
            return 0
        if error == "not_in_control":
            raise NotInControlError(answer["text"])
        if error == "late":
            raise LateCommandError(answer["text"])
        if error in _REFUSALS:
            return _REFUSALS[error]
        raise UsageError(answer["text"])

    def _ask(self, what: Any, away: Any) -> Any:
        """Ask the server. Return its answer; ``away`` if there is no server."""
        self.is_closed()  # in a forked child it raises
        try:
            return self._call(words.Ask(what=what))
        except LinkDownError:
            return away

    def _call(self, request: words._Request) -> Any:
        answer = self._exchange(request)
        if "error" in answer:
            raise UsageError(answer["text"])
        return answer["ok"]

    def _exchange(self, request: words._Request, number: int = 0, patience: float = PATIENCE) -> dict[str, Any]:
        call = _Call()
        request.id = number or self.next_number()
        with self._owned():
            self._calls[request.id] = call
        try:
            self._write(request)
            if not comes(call.done, patience):
                raise LinkDownError(f"{self._address.text} did not answer within {patience:g} s; check the server")
        finally:
            with self._lock:
                self._calls.pop(request.id, None)
        if not call.answer:
            raise LinkDownError(self._why or f"the connection to {self._address.text} is closed")
        return call.answer

    def _exchange_now(self, request: words.Take | words.ReleaseStop) -> dict[str, Any]:
        """Exchange a request that must not act once the caller has given up. While the caller waits, one that came too
        late is sent again."""
        until = time.monotonic() + PATIENCE
        while True:
            request.tick = self._tick
            answer = self._exchange(request)
            if answer.get("error") != "late" or time.monotonic() > until:
                return answer
            time.sleep(words.TICK_EVERY)

    def _write(self, request: words._Request) -> None:
        self._write_all([request])

    def _write_all(self, requests: Sequence[words._Request]) -> None:
        data = b"".join(map(words.json_message, requests))
        with self._write_lock:
            found = self._socket
            if found is None:
                raise LinkDownError(self._why or f"the link to {self._address.text} is closed")
            try:
                found.sendall(data)
            except OSError as error:
                self._disconnect(self._gone(error))
                raise LinkDownError(self._why) from None

    # ---- the connection

    def _gone(self, error: OSError | None = None) -> str:
        reason = "" if error is None else f" ({error.strerror or error})"
        return f"the server at {self._address.text} is gone{reason}; start it again with `wirebond serve`"

    def _connect(self) -> None:
        """Connect to the server.

        :raises PortError: there is no server, or it refuses.
        """
        address = self._address
        began = time.monotonic()
        # After a lost connection no program drives before take_control().
        found, accepted, splitter, rest = attach(address, "frames", asks=self.welcome is not None, name=self._name)
        welcome = accepted.ok
        ended = time.monotonic()
        try:
            self._validate(welcome)
        except UsageError:
            found.close()
            raise
        with self._lock:
            if self._is_closing:  # since a moment ago: the connection would stay open
                found.close()
                return
            self.welcome = welcome
            # On one computer both read the same clock; else the server's time was taken between these two.
            self._shift = 0.0 if address.path or address.host in LOOPBACK else (began + ended) / 2 - accepted.t
            self._tick = accepted.tick
            self._control = welcome.control
            self._splitter = splitter
            self._socket = found
            self._why = ""
        self._take_all(rest)

    def _validate(self, welcome: Welcome) -> None:
        if welcome.hash != f"{self._codec.hash:016x}":
            raise UsageError(
                f"{self._address.text} has a link of {welcome.protocol} with the hash {welcome.hash}, and this is "
                f"{self._codec.name} with {self._codec.hash:016x}; attach with the file that the server was given, or "
                "without a file"
            )
        if welcome.role != self._end:
            raise UsageError(f"{self._address.text} is the {welcome.role}, not the {self._end}; leave out role=")

    def _disconnect(self, why: str) -> None:
        with self._lock:
            found, self._socket = self._socket, None
            if found is None:
                return
            self._why = why
            self._control = Control()
            self._taps.clear()
            calls = list(self._calls.values())
            self._arrived.notify_all()
        with contextlib.suppress(OSError):
            found.shutdown(socket.SHUT_RDWR)
        found.close()
        for call in calls:
            call.done.set()
        self._leaves.set()
        if self.answers is not None and not self._is_closing:  # else the inbox ends them
            self.answers.fail_all(lambda name: LinkDownError(f"the reply to {name} will not come: {why}"))

    # ---- the thread

    def _run(self) -> None:
        wait = _FIRST_WAIT
        next_beat = 0.0
        while not self._is_done:
            found = self._socket
            if found is None:
                if self._is_closing:
                    self._leaves.set()
                    break
                self._wake.wait(wait)
                wait = min(2 * wait, _LAST_WAIT)
                try:
                    self._connect()
                except (PortError, UsageError) as error:
                    self._why = str(error)
                else:
                    wait = _FIRST_WAIT
                continue
            try:
                now = time.monotonic()
                if now >= next_beat:
                    next_beat = now + words.BEAT_EVERY
                    self._write(words.Beat(tick=self._tick))
                if not _is_readable(found, max(next_beat - now, 0.0)):
                    continue
                data = found.recv(1 << 18)
                if not data:
                    self._disconnect(self._gone())
                self._take_all(self._splitter.feed(data))
            except LinkDownError:
                continue
            except OSError as error:
                self._disconnect(self._gone(error))
        with self._lock:
            self._is_done = True
            self._arrived.notify_all()

    def _take_all(self, messages: Iterable[tuple[int, bytes]]) -> None:
        try:
            for kind, body in messages:
                self._take(kind, body)
        except _NOT_OF_A_SERVER:
            self._disconnect(
                f"{self._address.text} sent bytes that no Wirebond server sends; check which program runs there"
            )

    def _take(self, kind: int, body: bytes) -> None:
        if kind == words.FRAMES:
            messages = _engine.unpack_messages(
                self._codec.tables.protocol, self._format, body, self._shift, self._stamper
            )
            with self._lock:
                self._messages.extend(messages)
                while len(self._messages) > _MOST_WAITING:
                    self._messages.popleft()
                    self._dropped += 1
                self._arrived.notify_all()
            return
        said = msgspec.json.decode(body)
        if "re" in said:
            self._answered(said)
            return
        match said.get("event"):
            case "tick":
                self._tick = said["tick"]
            case "reply":
                with self._lock:
                    self._questions[said["offset"]] = said["request"]
            case "taken":
                with self._lock:
                    self._questions.update(dict.fromkeys(said["offsets"], TAKEN))
            case "change":
                with self._lock:
                    shift = round(self._shift * 1e6)
                    self._changes.append((said["kind"], said["t_us"] + shift, said["action"]))
                    self._arrived.notify_all()
            case "no_reply":
                if self.answers is not None:
                    self.answers.fail(said["request"], LinkDownError(said["text"]))
            case "control":
                self._control = Control(said["holder"], said["yours"], said.get("released_by"))
            case "lost":
                self._dropped += said["messages"]

    def _answered(self, said: dict[str, Any]) -> None:
        with self._lock:
            call = self._calls.get(said["re"])
        if call is not None:
            call.answer = said
            call.done.set()
        if said.get("ok") == "left":
            self._leaves.set()


def _is_readable(connection: socket.socket, seconds: float) -> bool:
    """Wait so long until a read would return at once, also with an error."""
    try:
        if sys.platform == "win32":  # its select has no limit for the number of a descriptor, and it has no poll
            return bool(select.select([connection], [], [], seconds)[0])
        poll = select.poll()
        poll.register(connection, select.POLLIN)
    except ValueError:  # another thread, which could not write to it, has just closed it
        return True
    return bool(poll.poll(seconds * 1e3))
