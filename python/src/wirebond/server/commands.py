"""Handles the requests of clients: commands under the rules of control, requests, questions.

One file: whatever is asked, the same rules of control come first.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import msgspec

from wirebond import _engine
from wirebond.as_json import plain
from wirebond.chinese import with_chinese
from wirebond.codec import Message
from wirebond.errors import (
    LateCommandError,
    LinkDownError,
    MessageError,
    NotInControlError,
    QueueFullError,
    StoppedByOtherError,
    StoppedError,
    UsageError,
    WirebondError,
)
from wirebond.link.attached import words
from wirebond.link.receiving import Asked
from wirebond.link.requests import MAX_TIMEOUT
from wirebond.link.tap import TAP_BYTES
from wirebond.protocol.controlled import is_controlled
from wirebond.protocol.json_values import from_json_values
from wirebond.protocol.model import End

if TYPE_CHECKING:
    from wirebond.server.client import Client
    from wirebond.server.owner import Owner

_MOST_QUESTIONS = 1024  # of one client that wait for replies
_MOST_FOR_DISK = 16  # of one client that wait for the disk
_MOST_TAPS = 4  # of one client
_MOST_TAP_BYTES = 4 * TAP_BYTES
_MOST_TAP_BYTES_IN_ALL = 64 * TAP_BYTES  # that clients may leave waiting
_ERRORS: list[tuple[type[WirebondError], str]] = [
    (StoppedError, "stopped"),
    (QueueFullError, "full"),
    (LinkDownError, "down"),
    (NotInControlError, "not_in_control"),
    (StoppedByOtherError, "stopped_by_other"),
    (LateCommandError, "late"),
    (MessageError, "message"),
]
_STATS_WAIT, _STATS_TRIES = 0.001, 50  # seconds; messages are that long on their way from the link at most
_OK: dict[str, Any] = {"ok": None}


class Commands:
    """Used only in the loop's thread."""

    def __init__(self, server: Owner) -> None:
        self._server = server
        self._link = link = server.link
        self._end = End(link.role)
        model = link.codec.model
        self._controlled = {m.name for m in model.messages if self._end == End.HOST and is_controlled(model, m)}

    def do(self, client: Client, request: words.Request) -> dict[str, Any]:
        """Do it, and return the answer."""
        try:
            match request:
                case words.Send() | words.Repeat():
                    return self._command(client, request)
                case words.Take():
                    self._must_be_new(request)
                    return self._take(client, request.over)
                case words.Release():
                    if self._server.book.holder == client.number:
                        self._server.end_control("released")
                        self._server.book.may_take_by_command(client.number)
                    return _OK
                case words.Withdraw():
                    self._withdraw(client, request.request)
                    return _OK
                case _:
                    return {"ok": self._ask(client, request)}
        except WirebondError as error:
            word = next((word for kind, word in _ERRORS if isinstance(error, kind)), "refused")
            by = {"by": error.by} if isinstance(error, StoppedByOtherError) else {}
            return {"error": word, "text": str(error), **by}
        except (TypeError, ValueError, OverflowError):  # a number that the engine cannot hold
            return {"error": "refused", "text": f"a value of this request is out of its range: {request!r:.200}"}

    # ---- commands

    def _command(self, client: Client, request: words.Send | words.Repeat) -> dict[str, Any]:
        link = self._link
        frame, header = self._frame(request)
        name = request.message
        key = None
        if name in self._controlled:
            if link.stopped and any(stop.message == name for stop in link.codec.model.emergency_stop):
                raise StoppedError(name, (stop.message for stop in link.codec.model.emergency_stop))
            book = self._server.book
            before = book.holder
            refused = book.refuses(client.number, request.tick, time.monotonic())
            if refused is not None:
                return {"error": refused[0], "text": refused[1]}
            if book.holder != before:
                self._server.tell_control("taken")
            own = link.internals.frames.message(name)
            key = (own.index, link.internals.frames.address_of(own, header))
        if isinstance(request, words.Repeat):
            self._repeat(client, request, frame, header)
        if key is not None:
            client.moved.add(key)
        if isinstance(request, words.Repeat):
            return _OK
        if link.codec.model.message(name).reply is None:
            self._send(request, frame, header)
            return _OK
        self._request(client, request, frame, header)
        return _OK

    def _frame(self, request: words.Send | words.Repeat) -> tuple[bytes, Mapping[str, Any]]:
        """Return the frame to be sent, and its header. A frame that came as bytes must be one of the message that it is
        said to be, because the name decides whether control is needed."""
        codec, link = self._link.codec, self._link
        own = link.internals.frames.message(request.message)
        if request.frame is None:
            header = link.internals.frames.with_own_address(request.header)
            try:
                values = from_json_values(own.model.fields, request.fields or {})
            except ValueError as error:
                raise MessageError(f"{own.model.name}: {error}") from None
            return link.internals.frames.encode(own, values, header), header or {}
        decoder = codec.decoder(self._end)
        found = [*decoder.feed(request.frame), *decoder.finish()]
        if len(found) != 1 or found[0].name != own.model.name or len(found[0].raw) != len(request.frame):
            raise MessageError(f"the frame is not one whole frame of {own.model.name}")
        return request.frame, found[0].header

    def _send(self, request: words.Send, frame: bytes, header: Mapping[str, Any]) -> None:
        link = self._link
        own = link.internals.frames.message(request.message)
        address = link.internals.frames.address_of(own, header)
        link.internals.sender.leave(
            request.message, (own.index, frame, own.reply, self._takes_number(request), address)
        )

    def _takes_number(self, request: words.Send | words.Repeat) -> bool:
        return (
            request.takes_number
            if request.frame is not None
            else self._link.internals.frames.takes_number(request.header)
        )

    def _repeat(self, client: Client, request: words.Repeat, frame: bytes, header: Mapping[str, Any]) -> None:
        from wirebond.link.link import MAX_HOLD  # noqa: PLC0415

        link, name = self._link, request.message
        own = link.internals.frames.message(name)
        if not 0 < request.hold <= MAX_HOLD:
            raise UsageError(f"hold is {request.hold:g} s; expected more than 0 and at most {MAX_HOLD:g} s")
        if own.model.every is None:
            raise UsageError(f"{name} has no `every` in the protocol file; send it")
        address = link.internals.frames.address_of(own, header)
        takes_number = self._takes_number(request)
        answer = link.internals.engine.repeat(own.index, frame, request.hold, own.reply, takes_number, address)
        link.internals.sender.raise_for(name, answer)
        client.leases[own.index, address] = time.monotonic() + request.hold

    def end_motion(self, client: Client) -> None:
        """End its leases, and send the safe values of what it moved and did not hand over. Where a stop has sent them
        already, only leases of other messages are left to end."""
        now = time.monotonic()
        alive = {key for key, until in client.leases.items() if until > now}
        moved = alive | client.moved
        client.leases.clear()
        client.moved.clear()
        self._link.internals.inbox.requests.settle()  # a command of this client must not leave after its safe value
        for key in sorted(moved):
            if not self._link.internals.engine.end_if_moved(*key) and key in alive:
                self._link.internals.engine.stop_repeating(*key)

    def _take(self, client: Client, over: bool | str) -> dict[str, Any]:
        server, now = self._server, time.monotonic()
        # The holder gets the event again: a page that was cut off for a second has assumed that its control ended.
        if server.book.holder not in (None, client.number) and over in (True, server.book.name):
            server.end_control("taken over")
        refused = server.book.take(client.number, over, now)
        if refused is not None:
            return {"error": "not_in_control", "text": refused}
        server.tell_control("taken")
        return _OK

    def _must_be_new(self, request: words.Take | words.ReleaseStop) -> None:
        """Refuse a request from before a stall if it lets the robot move again: its program may have given up or ended,
        and another program may have stopped the robot since.

        :raises LateCommandError: it was under way for too long.
        """
        late = None if request.tick is None else self._server.book.late(request.tick, time.monotonic())
        if late is not None:
            raise LateCommandError(late)

    # ---- requests

    def _request(self, client: Client, request: words.Send, frame: bytes, header: Mapping[str, Any]) -> None:
        requests = self._link.internals.inbox.requests
        waits = request.reply is not None
        if waits and len(client.questions) >= _MOST_QUESTIONS:
            raise QueueFullError(f"{_MOST_QUESTIONS} requests of this client wait for replies; wait for some of them")
        number = request.id
        loop = self._server.loop

        def finish(outcome: Message | Exception) -> None:
            self._server.note_answer(client, number, outcome)

        question = requests.question(request.message, frame, header, finish if waits else None)
        submitted = time.monotonic()

        def leave() -> None:
            if request.message in self._controlled:
                self._may_still_leave(client, submitted)
            self._send(request, frame, header)

        question.leave = leave
        if waits:
            client.questions[number] = question
        try:
            requests.submit(question)
        except BaseException:
            client.questions.pop(number, None)
            raise
        if request.reply is not None and math.isfinite(request.reply):
            timeout = min(max(request.reply, 0.0), MAX_TIMEOUT)
            asked = Asked(self._link, question, header, timeout, None)
            loop.call_later(timeout, self._too_late, client, number, asked)

    def _may_still_leave(self, client: Client, asked: float) -> None:
        """Note that a command that asks for a reply may have waited for the replies to others.

        :raises NotInControlError: its program is not in control any more.
        :raises LateCommandError: it is too old by now.
        """
        if self._server.book.holder != client.number:
            raise NotInControlError("the command waited for the replies to others, and its program has lost control")
        if time.monotonic() - asked > words.OLDEST_COMMAND:
            raise LateCommandError(
                f"the command waited for more than {words.OLDEST_COMMAND:g} s for the replies to others; send it again "
                "if it is still wanted"
            )

    def answered(self, client: Client, number: int, outcome: Message | Exception) -> None:
        """Report the outcome of a client's request. The message itself follows."""
        if client.questions.pop(number, None) is None:
            return
        if isinstance(outcome, Message):
            client.replies.add(outcome.offset)
            client.write(words.json_message({"event": "reply", "request": number, "offset": outcome.offset}))
            if client.wants == "none":
                client.write(self.packed([outcome], "json"))
        else:
            self._tell_no_reply(client, number, str(outcome))

    def _too_late(self, client: Client, number: int, asked: Asked) -> None:
        if client.questions.get(number) is asked.question:
            self._withdraw(client, number)
            self._tell_no_reply(client, number, str(asked.timeout_error()))

    def _tell_no_reply(self, client: Client, number: int, text: str) -> None:
        event = {"event": "no_reply", "request": number, "text": text}
        client.write(words.json_message(with_chinese(event, "text")))

    def _withdraw(self, client: Client, number: int) -> None:
        question = client.questions.pop(number, None)
        if question is not None:
            self._link.internals.inbox.requests.withdraw(question)

    def withdraw_all(self, client: Client) -> None:
        """Withdraw the requests of a client that is gone."""
        for number in list(client.questions):
            self._withdraw(client, number)

    # ---- how the link is

    def _ask(self, client: Client, request: words.Request) -> Any:
        link, engine = self._link, self._link.internals.engine
        match request:
            case words.Ask():
                return self._look(request.what)
            case words.Stop():
                self._server.stop.stop(client)  # first, because it ends the motion
                self._server.stopped()
            case words.ReleaseStop():
                self._must_be_new(request)
                if self._server.stop.release(client, request.over):
                    link.note("stop released", by=client.name, over=request.over)
                    self._server.stop_released(client.name, client.number)
            case words.StopRepeating():
                self._must_hold(client, request.message)
                index = link.internals.frames.message(request.message).index
                engine.stop_repeating(index, request.address)
                for key in [k for k in client.leases if k[0] == index and request.address in (None, k[1])]:
                    del client.leases[key]
            case words.HandOver():
                client.moved.clear()
            case words.EndSafely():
                self._must_hold(client, request.message)
                return engine.end_safely(link.internals.frames.message(request.message).index, request.address)
            case words.About():
                question = client.questions.get(request.request)
                if question is None:
                    return None
                arrived = link.internals.inbox.requests.arrived(question)
                return {
                    "arrived": None if arrived is None else vars(arrived),
                    "carried": None if question.carried is None else plain(question.carried),
                    "others": None if question.others is None else plain(question.others),
                    "was_sent": question.since != 0.0,
                }
            case words.Recover():
                if not 0 <= request.action < len(link.internals.actions):
                    raise UsageError(f"there is no deadline with the number {request.action}")
                engine.recover_deadline(request.action)
            case words.SetAddress():
                engine.set_address(request.address)
            case words.HostTimeOf():
                return link.host_time(request.mcu_us, request.near)
            case words.OpenTap():
                if len(client.taps) >= _MOST_TAPS:
                    raise UsageError(f"a client records at most {_MOST_TAPS} times at once; close a recording")
                if not 1024 <= request.capacity <= _MOST_TAP_BYTES:
                    raise UsageError(f"the capacity is {request.capacity}; expected 1024 to {_MOST_TAP_BYTES} bytes")
                held = sum(sum(each.taps.values()) for each in self._server.clients.values())
                if held + request.capacity > _MOST_TAP_BYTES_IN_ALL:
                    raise UsageError(
                        f"the recordings of all clients already hold {held} of at most {_MOST_TAP_BYTES_IN_ALL} bytes; "
                        "close one of them"
                    )
                tap = engine.open_tap(request.capacity)
                client.taps[tap] = request.capacity
                return tap
            case words.TakeTap():
                return engine.take_tap(self._tap(client, request.tap))
            case words.CloseTap():
                engine.close_tap(self._tap(client, request.tap))
                del client.taps[request.tap]
            case words.Note():
                engine.note(_note(request.text))
            case words.Mark():
                self._server.recordings.mark(request.text, client.name)
            case words.Attach():
                raise UsageError("this client has attached already")
        return None

    def _look(self, what: str) -> Any:
        link = self._link
        match what:
            case "state":
                return link.state
            case "why":
                return link.why
            case "stopped":
                return link.stopped
            case "struck":
                return link.internals.engine.struck_deadlines()
            case "recent":
                return link.internals.engine.recent()
            case "line":
                return link.internals.engine.line()
            case "peer":
                return asdict(link.peer)
            case "recording":
                return self._server.recordings.current
            case "clock_line":
                return link.internals.services.clock_line
            case _:
                reading = link.clock
                return None if reading is None else asdict(reading)

    def answer_stats(self, client: Client, number: int, tries: int = _STATS_TRIES) -> None:
        """Send the account, after every message that it counts: a client that reads of a message can then take it."""
        raw = self._link.internals.engine.stats()
        counted = raw["frames"] - raw["foreign_frames"] - raw["late"] - raw["held_back"] - raw["dropped_messages"]
        if self._link.internals.inbox.relayed < counted and tries > 0:
            self._server.loop.call_later(_STATS_WAIT, self.answer_stats, client, number, tries - 1)
            return
        self._server.give()
        raw["dropped_messages"] = 0  # of this link; each client has its own
        client.answer(number, {"ok": raw})

    def _must_hold(self, client: Client, name: str) -> None:
        holder = self._server.book.holder
        if name in self._controlled and holder is not None and holder != client.number:
            raise NotInControlError(f"{self._server.book.name} is in control of the robot, and only it can end {name}")

    def _tap(self, client: Client, tap: int) -> int:
        if tap not in client.taps:
            raise UsageError(f"this client has no recording with the number {tap}")
        return tap

    def close_taps(self, client: Client) -> None:
        """Close the taps of a client that is gone."""
        for tap in client.taps:
            self._link.internals.engine.close_tap(tap)
        client.taps.clear()

    # ---- recordings of the server

    def answer_later(self, client: Client, request: words.OfRecordings) -> None:
        """Answer when the disk has finished."""
        if client.waiting_for_disk >= _MOST_FOR_DISK:
            text = f"{_MOST_FOR_DISK} requests of this client wait for the disk; wait for some of them"
            client.answer(request.id, {"error": "full", "text": text})
            return
        client.waiting_for_disk += 1
        server = self._server

        def give(answer: dict[str, Any]) -> None:
            client.waiting_for_disk -= 1
            client.answer(request.id, answer)

        def work() -> None:
            try:
                answer = {"ok": self._of_recordings(request)}
            except WirebondError as error:
                answer = {"error": "refused", "text": str(error)}
            with contextlib.suppress(RuntimeError):  # the loop has ended
                server.loop.call_soon_threadsafe(give, answer)

        server.disk.submit(work)

    def _of_recordings(self, request: words.OfRecordings) -> Any:
        recordings = self._server.recordings
        match request:
            case words.RecordStart():
                return recordings.start()
            case words.RecordStop():
                return recordings.stop()
            case words.Annotate():
                return recordings.annotate(request.recording, request.text)
            case words.ListRecordings():
                return recordings.list()

    # ---- received messages

    def packed(self, messages: list[Message], wants: str) -> bytes:
        """Pack messages as this client wants them."""
        if wants == "frames":
            return words.framed(words.FRAMES, _engine.pack_messages(messages))
        return self.as_json(messages)

    def as_json(self, messages: list[Message]) -> bytes:
        """Write one event for each."""
        return b"".join(words.json_message(message_event(m)) for m in messages)


def message_event(message: Message) -> dict[str, Any]:
    """Return a received message as JSON: bytes are hexadecimal, and numbers that JSON does not have are null."""
    out: dict[str, Any] = {
        "event": "message",
        "t": message.t,
        "offset": message.offset,
        "name": message.name,
        "fields": plain(message.fields),
    }
    if message.header:
        out["header"] = plain(message.header)
    if message.violations:
        out["violations"] = message.violations
    if message.name == "unknown":
        out["id"] = message.id
        out["payload"] = message.payload.hex()
    return out


def _note(text: str) -> str:
    try:
        fine = isinstance(msgspec.json.decode(text), dict) and len(text) <= 2 * 4096
    except msgspec.MsgspecError:
        fine = False
    if not fine:
        raise UsageError("an event for a recording is a JSON object of at most 8192 characters")
    return text
