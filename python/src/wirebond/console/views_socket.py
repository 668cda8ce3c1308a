"""``/views``: rounds of a viewer over a WebSocket, as fast as the client takes them."""

from __future__ import annotations

import asyncio
import contextlib
import time

from starlette.websockets import WebSocket, WebSocketDisconnect

from wirebond.as_json import encode
from wirebond.chinese import with_chinese
from wirebond.console.attach_socket import NO_OBJECT, first_message, refuse
from wirebond.console.library import Library
from wirebond.console.station import Station
from wirebond.console.viewer import ROUND_EVERY, Viewer
from wirebond.console.visitors import Visitors
from wirebond.console.wants import Said, Views, read
from wirebond.errors import UsageError

VERSION = 1
BEAT_EVERY = 0.25  # seconds: a client that hears nothing for longer knows that its network or this server stalls
_MOST_UNSEEN = 2  # rounds in flight to a client that acknowledges the rounds it has drawn


async def views(socket: WebSocket, visitors: Visitors, station: Station, library: Library) -> None:
    """Serve one client, from its first message to its end."""
    await socket.accept()
    first = await first_message(socket)
    if first is None:
        return
    try:
        said = read(encode(first))
    except UsageError as error:
        await refuse(socket, "not_understood", str(error))
        return
    except RecursionError:  # decoding it just fitted on the stack
        await refuse(socket, "not_understood", NO_OBJECT)
        return
    if not await visitors.shows_token(socket.scope, said.token):
        await refuse(socket, "token", "the token is missing or wrong; it is in the address that was printed")
        return
    served = station.served
    hello = {
        "view": "hello",
        "version": VERSION,
        "t": time.monotonic(),
        "wall": time.time(),
        "link": None if served is None else served.link.codec.name,
    }
    await socket.send_text(encode(hello).decode())
    await _Views(socket, Viewer(station, library)).run(said)


class _Views:
    """Used in the loop's thread, except for the rounds."""

    def __init__(self, socket: WebSocket, viewer: Viewer) -> None:
        self._socket = socket
        self._viewer = viewer
        self._wanted: Views | None = None  # not handled by a round yet
        self._acks = False  # the client acknowledges the rounds it has drawn
        self._rounds = 0  # that were sent
        self._seen = 0
        self._sent = time.monotonic()  # when the client was last sent anything
        self._has_said = asyncio.Event()
        self._wants_else = asyncio.Event()

    async def run(self, first: Said) -> None:
        """Run until the client leaves."""
        self._hear(first)
        tasks = [asyncio.create_task(each) for each in (self._listen(), self._show(), self._beat())]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            for task in tasks:
                with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError, OSError):
                    await task
            with contextlib.suppress(RuntimeError, WebSocketDisconnect, OSError):
                await self._socket.close()

    def _hear(self, said: Said) -> None:
        if said.views is not None:
            self._wanted = said.views
            self._wants_else.set()
        if said.acks is not None:
            self._acks = said.acks
        if said.seen is not None:
            self._seen = min(max(said.seen, self._seen), self._rounds)
        self._has_said.set()

    async def _listen(self) -> None:
        while True:
            message = await self._socket.receive()
            if message["type"] != "websocket.receive":
                return
            try:
                self._hear(read(message.get("text") or ""))
            except UsageError as error:
                told = {"view": "error", "error": "not_understood", "text": str(error)}
                await self._send(encode(with_chinese(told, "text")).decode())

    async def _show(self) -> None:
        while True:
            begun = time.monotonic()
            wanted, self._wanted = self._wanted, None
            self._wants_else.clear()
            out = await asyncio.to_thread(self._round, wanted)
            if out and self._acks:
                self._rounds += 1
                out.append(encode({"view": "end", "round": self._rounds}).decode())
            for message in out:
                await self._send(message)
            with contextlib.suppress(TimeoutError):  # who wants something else does not wait for it
                await asyncio.wait_for(self._wants_else.wait(), max(begun + ROUND_EVERY - time.monotonic(), 0.0))
            while self._acks and self._rounds - self._seen >= _MOST_UNSEEN:
                self._has_said.clear()
                await self._has_said.wait()

    async def _beat(self) -> None:
        """Show that the connection and this server are alive: rounds may be far apart, or take long to make."""
        while True:
            now = time.monotonic()
            if now - self._sent >= BEAT_EVERY:
                await self._send(encode({"view": "beat", "t": now}).decode())
            await asyncio.sleep(max(self._sent + BEAT_EVERY - now, 0.0))

    def _round(self, wanted: Views | None) -> list[str | bytes]:
        if wanted is not None:
            self._viewer.want(wanted)
        return self._viewer.round()

    async def _send(self, message: str | bytes) -> None:
        self._sent = time.monotonic()
        if isinstance(message, bytes):
            await self._socket.send_bytes(message)
        else:
            await self._socket.send_text(message)
