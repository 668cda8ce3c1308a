"""A client of a server: its connection, what it may have waiting, and its first message."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import msgspec

from wirebond.chinese import with_chinese
from wirebond.codec import Message
from wirebond.errors import WirebondError
from wirebond.link.attached import words
from wirebond.server.strangers import Strangers

if TYPE_CHECKING:
    from wirebond.server.owner import Owner

MOST_WAITING = 2 << 20  # bytes for a client that does not read; then received messages are dropped for it, counted
_MOST_IN_ALL = 8 << 20  # bytes; a client is closed if this much waits of messages that must not be dropped
_NAME_CHARACTERS = 80


class Client(asyncio.Protocol):
    """Used only in the loop's thread."""

    def __init__(self, server: Owner) -> None:
        self._server = server
        self._splitter = words.Splitter(words.MOST_FIRST)  # a stranger cannot make the server keep much
        self._transport: asyncio.Transport | None = None
        self.number = 0  # 0: it has not said who it is
        self.name = ""
        self.wants = "none"
        self.silent_ticks = 0  # of the server, before it has said who it is; a stall of the server is one of them
        self.is_remote = False  # connected by TCP
        self.is_too_many = False
        self.is_gone = False  # it has said so
        self.lost = 0  # messages that it did not get, not reported to it yet
        self.replies: set[int] = set()  # offsets of messages that answer its requests, and are on their way to it
        self.leases: dict[tuple[int, int], float] = {}  # until when, by message and address
        self.moved: set[tuple[int, int]] = set()  # messages and addresses that its commands moved
        self.questions: dict[int, Any] = {}  # by the number of the request
        self.taps: dict[int, int] = {}  # by number, how many bytes may wait in each
        self.waiting_for_disk = 0  # requests
        self._address = ""  # of the computer at the other end, with TCP
        self._strangers: Strangers[Client] | None = None  # among which it is until it says who it is
        self._later: list[bytes] | None = None  # requests that wait until its token is compared

    def welcome(self, number: int, request: words.Attach) -> None:
        """Welcome a client that has identified itself."""
        if self._strangers is not None:
            self._strangers.leave(self)
        self.number = number
        self._splitter.most = words.MOST_TO_SERVER
        name = "".join(c if c.isprintable() else "?" for c in request.name[:_NAME_CHARACTERS]).strip()
        self.name = name or f"client {number}"
        self.wants = request.messages

    # ---- to it

    def write(self, data: bytes) -> None:
        """Write bytes that the client must get; if far too much waits, it is disconnected."""
        transport = self._transport
        if transport is None or transport.is_closing():
            return
        if transport.get_write_buffer_size() > _MOST_IN_ALL:
            transport.abort()
            return
        transport.write(data)

    def give(self, data: bytes, messages: list[Message]) -> None:
        """Give it received messages. If it does not read, it gets only replies to its own requests."""
        transport = self._transport
        if transport is None or transport.is_closing():
            return
        if transport.get_write_buffer_size() <= MOST_WAITING:
            self.tell_lost()
            transport.write(data)
            self.replies.clear()
            return
        mine = [m for m in messages if m.offset in self.replies]
        self.lost += len(messages) - len(mine)
        self.replies.clear()
        if mine:
            self.write(self._server.commands.packed(mine, self.wants))

    def tell_lost(self) -> None:
        """Report how many messages it did not get, once it reads again."""
        transport = self._transport
        if self.lost and transport is not None and transport.get_write_buffer_size() <= MOST_WAITING:
            transport.write(words.json_message({"event": "lost", "messages": self.lost}))
            self.lost = 0

    def answer(self, number: int, value: dict[str, Any]) -> None:
        """Answer its request with this number. A refusal is in Chinese, too."""
        told = with_chinese(value, "text") if "error" in value else value
        self.write(words.json_message({"re": number, **told}))

    def refuse(self, error: str, text: str) -> None:
        """Say why, and end the connection."""
        self.answer(1, {"error": error, "text": text})
        self.end()

    def end(self) -> None:
        """Close it when all is written."""
        if self._transport is not None:
            self._transport.close()

    # ---- asyncio

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """See ``asyncio.Protocol``."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        place = transport.get_extra_info("sockname")
        self.is_remote = not isinstance(place, str)
        if self.is_too_many:
            self.refuse("too_many", "the server has as many clients as it takes; end some of them")
            return
        if self.is_remote:
            self._address = (transport.get_extra_info("peername") or ("",))[0]
        if place != "":  # that of a client within this process
            self._strangers = self._server.strangers["tcp" if self.is_remote else "unix"]
            goes = self._strangers.enter(self)
            if goes is not None:
                goes.make_way()

    def make_way(self) -> None:
        """Close it: too many connections have not identified themselves, and this is the oldest."""
        self.refuse("too_many", "too many connections have not identified themselves; attach again")
        if self._transport is not None:
            self._transport.abort()  # also where it does not read

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002
        """See ``asyncio.Protocol``."""
        if self._strangers is not None:
            self._strangers.leave(self)
        self._server.detach(self)
        self._server.commands.close_taps(self)

    def data_received(self, data: bytes) -> None:
        """See ``asyncio.Protocol``."""
        self._take_all(self._splitter.feed(data))

    def _take_all(self, messages: Iterable[tuple[int, bytes]]) -> None:
        try:
            for kind, body in messages:
                self._server.catch_up()
                if self._transport is None or self._transport.is_closing():
                    return
                if kind != words.JSON:
                    raise words.WrongStreamError("records of frames, which only a server sends")
                if self._later is not None:
                    self._later.append(body)
                else:
                    self._take(words.read_request(body))
        except (msgspec.MsgspecError, RecursionError) as error:
            self.refuse("not_understood", f"this is not a request that the server knows: {error}; see docs/server.md")
        except (words.WrongStreamError, UnicodeDecodeError) as error:
            self.refuse("not_understood", f"this is not a client of a Wirebond server: it sent {error}")

    def _take(self, request: words.Request) -> None:
        if self.number == 0:
            if not isinstance(request, words.Attach):
                self.refuse("attach_first", 'the first message must be {"do": "attach"}')
                return
            delay = self._delay(request)
            if delay:
                self._wait_to_attach(request, delay)
            else:
                self._attach(request)
            return
        if self.is_gone and not isinstance(request, words.Ask | words.TakeTap):
            return
        if isinstance(request, words.Beat):
            self._server.book.beat(self.number, request.tick, time.monotonic())
            return
        if isinstance(request, words.Leave):
            self.is_gone = True
            self._server.detach(self)
            self.answer(request.id, {"ok": "left"})
            return
        if isinstance(request, words.Ask) and request.what == "stats":
            self._server.commands.answer_stats(self, request.id)
            return
        if isinstance(request, words.OfRecordings):
            self._server.commands.answer_later(self, request)
            return
        try:
            answer = self._server.commands.do(self, request)
        except WirebondError as error:
            answer = {"error": "refused", "text": str(error)}
        self._server.log.note(self.number, self.name, request, answer.get("error", ""), time.monotonic())
        self.answer(request.id, answer)

    def _delay(self, request: words.Attach) -> float:
        """Return how many seconds its token waits for the answer."""
        if not self.is_remote:
            return 0.0
        is_right = self._server.is_token(request.token)
        return self._server.wrong_tokens.delay(self._address, time.monotonic(), is_right=is_right)

    def _wait_to_attach(self, request: words.Attach, delay: float) -> None:
        assert self._transport is not None
        assert self._strangers is not None
        self._strangers.wait(self, makes_way=not self._server.wrong_tokens.is_short)
        self._transport.pause_reading()
        self._later = []
        self.silent_ticks = 0
        self._server.loop.call_later(delay, self._attach_now, request)

    def _attach_now(self, request: words.Attach) -> None:
        transport, later = self._transport, self._later or []
        self._later = None
        if transport is None or transport.is_closing():
            return
        self._attach(request)
        transport.resume_reading()
        self._take_all((words.JSON, body) for body in later)

    def _attach(self, request: words.Attach) -> None:
        answer = self._server.attach(self, request)
        self.answer(request.id, answer)
        if "error" in answer:
            if answer["error"] == "token":
                self._server.wrong_tokens.note(self._address, time.monotonic())
            self.end()
