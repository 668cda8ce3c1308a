"""The work of a server: it passes everything from the link to every attached client, and their messages to the link.

One thread with an event loop has all sockets; the link has threads of its own. Nothing here waits for a client.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import os
import secrets
import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wirebond import _engine
from wirebond.codec import Message
from wirebond.errors import PortError, UsageError, WirebondError
from wirebond.link.attached import words
from wirebond.link.attached.words import StoredRecording
from wirebond.seldom import limit_errors_of
from wirebond.server.client import Client
from wirebond.server.command_log import CommandLog
from wirebond.server.commands import Commands
from wirebond.server.control import ControlBook, Why
from wirebond.server.listening import tcp_socket, unix_socket
from wirebond.server.recordings import Recordings
from wirebond.server.stop import OWNER, StopBook
from wirebond.server.strangers import WITHIN, Strangers, WrongTokens
from wirebond.system import HAS_UNIX_SOCKETS, is_unix_socket

if TYPE_CHECKING:
    from wirebond.link import Link

_LOOK_EVERY = 0.01  # seconds between two checks whether the holder of control is silent
_STALL = 5 * _LOOK_EVERY  # seconds without a check: then bytes from sockets may be old
_GATHER = 0.001  # seconds that received messages may wait for others, so that a client gets them in one piece
MOST_CLIENTS = 256
_BACKLOG = 32  # connections that are accepted before the loop does anything else
_PATIENCE = 5.0  # seconds that the thread has to begin and to end


class Owner:
    """See ``Server``, which is its face. What is not private here is for the other files of this folder, in the loop's
    thread."""

    def __init__(
        self,
        link: Link,
        path: str | os.PathLike[str] | None = None,
        *,
        tcp: tuple[str, int] | None = None,
        token: str | None = None,
        recordings: str | os.PathLike[str] | None = None,
    ) -> None:
        if path is None and tcp is None:
            raise UsageError("a server listens at a path or at TCP; give one")
        if token is not None and (not token.isprintable() or not token.strip()):
            raise UsageError("the token is empty, or has characters that cannot be printed; give letters and digits")
        self.link = link
        self.recordings = Recordings(link, recordings, self._tell_recording)
        self.disk = ThreadPoolExecutor(1, "recordings of a server")  # runs work that waits for the disk
        self.path = None if path is None else os.fspath(path)
        self.token = secrets.token_urlsafe(16) if tcp is not None and token is None else token
        self.book = ControlBook()
        self.commands = Commands(self)
        self.log = CommandLog()
        self.clients: dict[int, Client] = {}
        self.waiting: set[Client] = set()  # connected, and have not said who they are
        self.strangers = {kind: Strangers[Client]() for kind in ("tcp", "unix")}  # those of them who came from outside
        self.wrong_tokens = WrongTokens(self.token)
        self._number = 0
        self._judged = self._next_tick = 0.0  # times of the loop
        self._holder: str | None = None
        self._came: list[Message] = []
        self._answers: list[tuple[Client, int, Message | Exception]] = []
        self._answering: set[int] = set()  # offsets of messages that answer clients' requests and have not come yet
        self._taken: list[int] = []  # offsets of messages that answered requests of the link itself, as for the clock
        self._changes: list[tuple[str, int, int]] = []  # of the port and of deadlines
        self._came_lock = threading.Lock()  # of these five: an answer is there before its message
        self._sockets = self._listen(tcp)
        self.stop = StopBook(link, self.path)  # the path is this server's from here on
        self.loop = asyncio.new_event_loop()
        self._flush: asyncio.TimerHandle | None = None
        self._began = threading.Event()
        self._thread = threading.Thread(target=self._run, name="server of a link", daemon=True)
        self._thread.start()
        self._began.wait(_PATIENCE)
        link.internals.inbox.relay(self._relay)

    @property
    def port(self) -> int | None:
        """The TCP port that it listens at, or None."""
        tcp = [s for s in self._sockets if not is_unix_socket(s)]
        return tcp[0].getsockname()[1] if tcp else None

    @property
    def holder(self) -> str | None:
        """The name of the client in control, or None. Any thread."""
        return self._holder

    @property
    def stopped_by(self) -> str | None:
        """The name of the program whose emergency stop holds, or None. Any thread."""
        return self.stop.name

    @property
    def client_count(self) -> int:
        """The number of attached clients. Any thread."""
        return len(self.clients)

    def connect(self) -> socket.socket:
        """Accept a connection of one more client."""
        ours, theirs = socket.socketpair()
        try:
            asyncio.run_coroutine_threadsafe(self.loop.connect_accepted_socket(self._connected, ours), self.loop)
        except RuntimeError:  # the loop has ended
            ours.close()
            theirs.close()
            raise PortError("the server is closed; nothing can attach to it") from None
        return theirs

    def close(self) -> None:
        """Close every client; the leases of the one in control end with their safe values. A second call does
        nothing."""
        if self.loop.is_closed() or not self._thread.is_alive():
            return
        with contextlib.suppress(RuntimeError):  # it has ended
            self.loop.call_soon_threadsafe(self._end)
        self._thread.join(_PATIENCE)
        self.disk.shutdown(cancel_futures=True)
        self.recordings.close()
        if self.path is not None:
            with contextlib.suppress(OSError):
                Path(self.path).unlink()

    # ---- called by the link, in its thread

    def _relay(self, messages: list[Message], answers: list[Message], changes: list[tuple[str, int, int]]) -> None:
        with self._came_lock:
            is_first = not self._came and not self._answers and not self._changes
            self._came += messages
            self._changes += changes
            offsets = {m.offset for m in answers}
            self._taken += offsets - self._answering
            self._answering -= offsets
        if is_first:
            self._wake()

    def note_answer(self, client: Client, number: int, outcome: Message | Exception) -> None:
        """Note the outcome of this request of a client. Any thread."""
        with self._came_lock:
            is_first = not self._came and not self._answers and not self._changes
            self._answers.append((client, number, outcome))
            if isinstance(outcome, Message):
                self._answering.add(outcome.offset)
        if is_first:
            self._wake()

    def _wake(self) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self.loop.call_soon_threadsafe(self._gather)

    def _tell_recording(self, recording: StoredRecording) -> None:
        """Report the recording to every client. In any thread."""
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self.loop.call_soon_threadsafe(self.tell_all, {"event": "recording", "recording": recording})

    # ---- in the loop's thread

    def tell_all(self, value: dict[str, Any]) -> None:
        """Send an event to every client."""
        data = words.json_message(value)
        for client in list(self.clients.values()):
            client.write(data)

    def end_control(self, why: Why) -> None:
        """End the holder's control: its leases end, and what it moved gets its safe values."""
        was = self.book.give_up(against_its_will=why != "released")
        if was is not None:
            client = self.clients.get(was)  # type: ignore[call-overload]
            if client is not None:
                self.commands.end_motion(client)
            self.tell_control(why)

    def stopped(self) -> None:
        """Note that the robot was stopped: no client is in control, and no command takes control by itself."""
        self.end_control("emergency stop")
        was_free = self.book.released_by is not None
        self.book.all_must_ask()
        if was_free:
            self.tell_control("emergency stop")

    def stop_released(self, name: str, by: int | None = None) -> None:
        """Note that the client with this number released the stop. A program that took control while the stop held
        loses it again."""
        self.end_control("stop released")
        self.book.released(name, by)
        self.tell_control("stop released")

    def follow_stop(self) -> None:
        """Note what the owner of the link stopped or released without the server."""
        if self.stop.look():
            if self.stop.name is None:
                self.stop_released(OWNER)
            else:
                self.stopped()

    def tell_control(self, why: Why) -> None:
        """Report which client is in control now."""
        was, self._holder = self._holder, self.book.name
        if self._holder != was:
            with contextlib.suppress(WirebondError):  # the link is closed, and with it its recordings
                self.link.note("control", holder=self.book.name, why=why)
        for client in list(self.clients.values()):
            client.write(
                words.json_message(
                    {
                        "event": "control",
                        "holder": self.book.name,
                        "yours": self.book.holder == client.number,
                        "released_by": self.book.released_by,
                        "why": why,
                    }
                )
            )

    def attach(self, client: Client, request: words.Attach) -> dict[str, Any]:
        """Attach a client by its first message."""
        if request.version != words.VERSION:
            return _refusal(
                "version",
                f"the server speaks version {words.VERSION} of its protocol, and this client {request.version}; use "
                "the same Wirebond at both",
            )
        if client.is_remote and not self.is_token(request.token):
            return _refusal(
                "token", "the token is missing or wrong; give the one that `wirebond serve` printed, as ?token=TOKEN"
            )
        self.waiting.discard(client)
        self._number += 1
        client.welcome(self._number, request)
        self.clients[client.number] = client
        now = time.monotonic()
        self.book.add(client.number, client.name, request.asks or self.stop.name is not None, now)
        link = self.link
        welcome = words.Welcome(
            version=words.VERSION,
            server="wirebond",
            client=client.number,
            protocol=link.codec.name,
            hash=f"{link.codec.hash:016x}",
            text=link.codec.model.text,
            port=link.port,
            baud=link.baud,
            role=link.role,
            control=words.Control(self.book.name, False, self.book.released_by),
            other_protocols=[codec.model.text for codec in link.other_protocols],
        )
        return {"ok": welcome, "t": now, "tick": self.book.ticks.newest}

    def is_token(self, given: str) -> bool:
        """Compare in a time that does not depend on where they differ. Without a token each is right."""
        return self.token is None or hmac.compare_digest(given.encode(), self.token.encode())

    def detach(self, client: Client) -> None:
        """Detach a client that has said so, or whose connection has ended: safe values are sent for the messages that
        it repeated."""
        self.waiting.discard(client)
        if self.clients.get(client.number) is not client:
            return
        self.commands.withdraw_all(client)
        self.commands.end_motion(client)
        was_in_control = self.book.remove(client.number)
        del self.clients[client.number]
        if was_in_control:
            self.tell_control("gone")

    def _gather(self) -> None:
        if self._flush is None:
            self._flush = self.loop.call_later(_GATHER, self.give)

    def give(self) -> None:
        """Give received messages to the clients that want them."""
        if self._flush is not None:
            self._flush.cancel()
            self._flush = None
        with self._came_lock:
            messages, self._came = self._came, []
            answers, self._answers = self._answers, []
            taken, self._taken = self._taken, []
            changes, self._changes = self._changes, []
        if taken:
            self.tell_all({"event": "taken", "offsets": taken})
        for client, number, outcome in answers:
            self.commands.answered(client, number, outcome)
        self._give_messages(messages)
        for kind, t_us, action in changes:
            self.tell_all({"event": "change", "kind": kind, "t_us": t_us, "action": action})

    def _give_messages(self, messages: list[Message]) -> None:
        if not messages:
            return
        frames: bytes | None = None
        for client in list(self.clients.values()):
            if client.wants == "frames":
                if frames is None:
                    frames = words.framed(words.FRAMES, _engine.pack_messages(messages))
                client.give(frames, messages)
            elif client.wants == "json":
                client.give(self.commands.as_json(messages), messages)

    async def _look(self) -> None:
        while True:
            now = time.monotonic()
            self._judge(now)
            if now >= self._next_tick:
                self._tick(now)
                self.follow_stop()
                for client in self.clients.values():
                    client.tell_lost()
                if self.recordings.has_failed:
                    self.disk.submit(self.recordings.end_failed)
                for client in self.waiting:
                    client.silent_ticks += 1
                for client in [c for c in self.waiting if c.silent_ticks > WITHIN / words.TICK_EVERY]:
                    client.refuse("silent", f"the first message did not come within {WITHIN:g} s")
            await asyncio.sleep(_LOOK_EVERY)

    def catch_up(self) -> None:
        """Call this before anything that a socket brought is acted on. After a stall of this thread or of the whole
        process, the silence of the program in control is judged first: what waits in its socket may be from before the
        stall, and its program may be dead. A release of the stop by the owner of the link is noted first, too: noted
        later, it would end a control that was taken after it."""
        now = time.monotonic()
        if now - self._judged > _STALL:
            self._judge(now)
        self.follow_stop()

    def _judge(self, now: float) -> None:
        self._judged = now
        if self.book.silent(now):
            self.end_control("silent")

    def _tick(self, now: float) -> None:
        self._next_tick = now + words.TICK_EVERY
        self.tell_all({"event": "tick", "tick": self.book.ticks.next(now)})

    def _connected(self) -> Client:
        client = Client(self)
        if len(self.clients) >= MOST_CLIENTS:
            client.is_too_many = True
        else:
            self.waiting.add(client)
        return client

    # ---- begin and end

    def _listen(self, tcp: tuple[str, int] | None) -> list[socket.socket]:
        found: list[socket.socket] = []
        try:
            if self.path is not None and HAS_UNIX_SOCKETS:
                found.append(unix_socket(self.path))
            if tcp is not None:
                found.append(tcp_socket(*tcp))
        except BaseException:
            for each in found:
                each.close()
            raise
        return found

    def _run(self) -> None:
        asyncio.set_event_loop(self.loop)
        limit_errors_of(self.loop)
        try:
            self.loop.run_until_complete(self._serve())
        finally:
            self.loop.close()

    async def _serve(self) -> None:
        self._ended = asyncio.Event()
        servers = []
        for each in self._sockets:
            if is_unix_socket(each):
                servers.append(await self.loop.create_unix_server(self._connected, sock=each, backlog=_BACKLOG))
            else:
                servers.append(await self.loop.create_server(self._connected, sock=each, backlog=_BACKLOG))
        look = self.loop.create_task(self._look())
        self._began.set()
        await self._ended.wait()
        look.cancel()
        for server in servers:
            server.close()
        for client in [*self.clients.values(), *self.waiting]:
            self.detach(client)
            client.end()
        await asyncio.sleep(0)

    def _end(self) -> None:
        self._ended.set()


def _refusal(error: str, text: str) -> dict[str, Any]:
    return {"error": error, "text": text}
