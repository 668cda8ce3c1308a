"""The other side of `serial_double.js`: serves a page's folder, and joins the port of the double to a tty."""

from __future__ import annotations

import asyncio
import contextlib
import os
import termios
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

BITS_PER_BYTE = 10
DOUBLE = Path(__file__).with_name("serial_double.js")


class Wire:
    """Any thread may plug and unplug.

    :ivar written: all that the page wrote, as it left.
    :ivar writes: the same, each with its time on `time.monotonic`.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.device = ""  # the tty
        self.written = bytearray()
        self.writes: list[tuple[float, bytes]] = []
        self.before = ""  # a script that runs first
        self.port = 0
        self._is_in = True
        self._is_granted = False  # a person has chosen the port
        self._sockets: set[WebSocket] = set()
        self._watching: set[WebSocket] = set()
        (worker,) = folder.glob("assets/worker-*.js")
        self._worker = worker.read_text(encoding="utf-8")
        routes = [
            WebSocketRoute("/wire", self._wire),
            WebSocketRoute("/plug", self._plug),
            Route("/granted", self._granted, methods=["GET", "POST"]),
            Route(f"/assets/{worker.name}", self._with_double),
            Mount("/", StaticFiles(directory=folder, html=True)),
        ]
        self._app = Starlette(routes=routes)
        self._loop: asyncio.AbstractEventLoop | None = None

    @property
    def script(self) -> str:
        """Runs before the page's window and its worker: it stands for Web Serial."""
        return self.before + DOUBLE.read_text(encoding="utf-8").replace("@PORT@", str(self.port))

    def plug(self, is_in: bool) -> None:
        assert self._loop is not None
        asyncio.run_coroutine_threadsafe(self._set(is_in), self._loop).result(60)

    async def _granted(self, request: Request) -> Response:
        self._is_granted = self._is_granted or request.method == "POST"
        return JSONResponse(self._is_granted)

    async def _with_double(self, _: Request) -> Response:
        """The page's worker, in which the double is there first. (A browser does not let a script that a test put in
        the place of another one connect to this computer.)"""
        return Response(f"{self.script}\n{self._worker}", media_type="text/javascript")

    async def _set(self, is_in: bool) -> None:
        self._is_in = is_in
        for socket in list(self._watching):
            await socket.send_text("in" if is_in else "out")
        if not is_in:
            for socket in list(self._sockets):
                with contextlib.suppress(RuntimeError):
                    await socket.close()

    async def _plug(self, socket: WebSocket) -> None:
        await socket.accept()
        self._watching.add(socket)
        await socket.send_text("in" if self._is_in else "out")
        with contextlib.suppress(WebSocketDisconnect):
            await socket.receive_text()
        self._watching.discard(socket)

    async def _wire(self, socket: WebSocket) -> None:
        if not self._is_in:
            await socket.close()
            return
        await socket.accept()
        self._sockets.add(socket)
        baud = int(socket.query_params["baud"])
        device = os.open(self.device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(device, termios.TCSANOW)
        loop = asyncio.get_running_loop()
        arrived: asyncio.Queue[bytes] = asyncio.Queue()
        loop.add_reader(device, lambda: arrived.put_nowait(_read(device)))
        sending = asyncio.create_task(_send(socket, arrived))
        try:
            while True:
                data = await socket.receive_bytes()
                self.written += data
                self.writes.append((time.monotonic(), data))
                at = 0
                while at < len(data):
                    with contextlib.suppress(BlockingIOError):
                        at += os.write(device, data[at:])
                await asyncio.sleep(len(data) * BITS_PER_BYTE / baud)
                await socket.send_text("written")
        except (WebSocketDisconnect, RuntimeError, KeyError):
            pass
        finally:
            self._sockets.discard(socket)
            loop.remove_reader(device)
            sending.cancel()
            os.close(device)

    @contextmanager
    def served(self) -> Iterator[Wire]:
        server = uvicorn.Server(uvicorn.Config(self._app, host="127.0.0.1", port=0, log_level="error", lifespan="off"))
        began = threading.Event()

        async def serve() -> None:
            self._loop = asyncio.get_running_loop()
            task = asyncio.create_task(server.serve())
            while not server.started:
                await asyncio.sleep(0.005)
            self.port = server.servers[0].sockets[0].getsockname()[1]
            began.set()
            await task

        thread = threading.Thread(target=lambda: asyncio.run(serve()), daemon=True)
        thread.start()
        assert began.wait(60)
        try:
            yield self
        finally:
            server.should_exit = True
            thread.join(60)


def _read(device: int) -> bytes:
    with contextlib.suppress(OSError):
        return os.read(device, 65536)
    return b""


async def _send(socket: WebSocket, arrived: asyncio.Queue[bytes]) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        while True:
            data = await arrived.get()
            if data:
                await socket.send_bytes(data)
            else:
                await asyncio.sleep(0.01)
