"""``/attach``: the protocol of docs/server.md over a WebSocket. It hands messages on; it reads only the first one."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Any

import msgspec
from starlette.websockets import WebSocket, WebSocketDisconnect

from wirebond.chinese import with_chinese
from wirebond.console.station import Station
from wirebond.console.visitors import Visitors
from wirebond.link.attached import words
from wirebond.server.strangers import LOOKS, WITHIN

_READ_BYTES = 1 << 18
NO_OBJECT = "the first message is not a JSON object; see docs/console-api.md"
REFUSED, RESTARTED = 1008, 1012  # close codes of RFC 6455: policy; the link was replaced, so attach again


async def attach(socket: WebSocket, visitors: Visitors, station: Station) -> None:
    """Serve one program, from its first message to its end."""
    await socket.accept()
    first = await first_message(socket)
    if first is None:
        return
    number, token = first.get("id", 1), first.get("token")
    if not await visitors.shows_token(socket.scope, token if isinstance(token, str) else ""):
        await refuse(socket, "token", "the token is missing or wrong; it is in the address that was printed", number)
        return
    try:
        hello = msgspec.json.encode({**first, "token": ""})
    except RecursionError:  # decoding it just fitted on the stack
        await refuse(socket, "not_understood", NO_OBJECT, number)
        return
    served = station.served
    if served is None:
        await refuse(socket, "no_link", "the console has no port yet; connect it first", number)
        return
    try:
        reader, writer = await asyncio.open_connection(sock=served.server.connect())
    except (OSError, RuntimeError):  # it is closed at this moment
        await refuse(socket, "no_link", "the link is just being replaced; attach again", number)
        return
    writer.write(words.framed(words.JSON, hello))
    inward = asyncio.create_task(_inward(socket, writer))
    outward = asyncio.create_task(_outward(reader, socket))
    try:
        await asyncio.wait((inward, outward), return_when=asyncio.FIRST_COMPLETED)
    finally:
        inward.cancel()
        outward.cancel()
        writer.close()
        code = outward.result() if outward.done() and not outward.cancelled() and not outward.exception() else 1000
        with contextlib.suppress(RuntimeError, WebSocketDisconnect, OSError):  # it is gone already
            await socket.close(code)


async def first_message(socket: WebSocket) -> dict[str, Any] | None:
    """Return the object that identifies a client; None: it did not come, and the client has been informed."""
    coming = asyncio.ensure_future(socket.receive())
    try:
        for _ in range(LOOKS):
            if coming.done():
                break
            await asyncio.wait({coming}, timeout=WITHIN / LOOKS)
        if not coming.done():
            await refuse(socket, "silent", f"the first message did not come within {WITHIN:g} s")
            return None
        said = coming.result()
    finally:
        coming.cancel()
    if said["type"] != "websocket.receive":
        return None
    try:
        first = msgspec.json.decode(said.get("text") or "")
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        first = None
    if not isinstance(first, dict):
        await refuse(socket, "not_understood", NO_OBJECT)
        return None
    return first


async def refuse(socket: WebSocket, error: str, text: str, number: Any = 1) -> None:
    """Say why, and end the connection."""
    with contextlib.suppress(RuntimeError, WebSocketDisconnect, OSError):
        told = with_chinese({"re": number, "error": error, "text": text}, "text")
        await socket.send_text(msgspec.json.encode(told).decode())
        await socket.close(REFUSED)


async def _inward(socket: WebSocket, writer: asyncio.StreamWriter) -> None:
    while True:
        said = await socket.receive()
        if said["type"] != "websocket.receive":
            return
        text = said.get("text")
        kind, body = (words.JSON, text.encode()) if text is not None else (words.FRAMES, said.get("bytes") or b"")
        writer.write(words.framed(kind, body))
        await writer.drain()


async def _outward(reader: asyncio.StreamReader, socket: WebSocket) -> int:
    """Return the code to close with."""
    splitter = words.Splitter(words.MOST_TO_CLIENT)
    code = RESTARTED
    with contextlib.suppress(ConnectionError, WebSocketDisconnect, RuntimeError):
        while data := await reader.read(_READ_BYTES):
            for kind, body in splitter.feed(data):
                if kind == words.FRAMES:
                    await socket.send_bytes(body)
                else:
                    code = REFUSED if body.startswith(b'{"re":1,"error":') else RESTARTED
                    await socket.send_text(body.decode())
    return code
