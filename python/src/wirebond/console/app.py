"""The console as an ASGI application: its paths, and who may use them."""

from __future__ import annotations

import html
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocket

from wirebond.as_json import encode
from wirebond.chinese import with_chinese
from wirebond.console.attach_socket import attach
from wirebond.console.guard import Guard
from wirebond.console.library import Library
from wirebond.console.station import Station
from wirebond.console.views_socket import views
from wirebond.console.visitors import Visitors

_NOT_BUILT = """<!doctype html><meta charset="utf-8"><title>Wirebond</title>
<p>The page was not built: this is a clone of the source, and building it needs Node 20 or newer.
Install Node, run <code>make build/page.stamp</code>, start the server again, and load this address.
Programs can use the console as it is.</p>"""
_NOT_HERE = """<!doctype html><meta charset="utf-8"><title>Wirebond</title>
<p>This console does not answer here: {}.</p>
<p>Through a tunnel, use the same port at both ends: <code>ssh -L 8765:localhost:8765 robot</code>.</p>"""
_HEADERS = (
    (b"content-security-policy", b"default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
     b"font-src 'self' data:; connect-src 'self'; worker-src 'self' blob:; frame-ancestors 'none'; base-uri 'none'"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
)  # fmt: skip


def application(
    guard: Guard, visitors: Visitors, station: Station, library: Library, page: Path, api: list[BaseRoute]
) -> ASGIApp:
    """Return the console's paths, with its rules of access."""

    async def at_attach(socket: WebSocket) -> None:
        await attach(socket, visitors, station)

    async def at_views(socket: WebSocket) -> None:
        await views(socket, visitors, station, library)

    async def not_built(_: Request) -> Response:
        return HTMLResponse(_NOT_BUILT)

    is_built = (page / "index.html").is_file()
    front: BaseRoute = Mount("/", StaticFiles(directory=page, html=True)) if is_built else Route("/", not_built)
    routes: list[BaseRoute] = [
        WebSocketRoute("/attach", at_attach),
        WebSocketRoute("/views", at_views),
        *api,
        front,
    ]
    return Guarded(Starlette(routes=routes), guard, visitors)


class Guarded:
    """Refuses the requests that the guard refuses, before anything else sees them."""

    def __init__(self, app: ASGIApp, guard: Guard, visitors: Visitors) -> None:
        self._app = app
        self._guard = guard
        self._visitors = visitors

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """See ASGI."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        with self._visitors.serving(scope):
            await self._serve(scope, receive, send)

    async def _serve(self, scope: Scope, receive: Receive, send: Send) -> None:
        headers = {name.lower(): value.decode("latin-1") for name, value in scope["headers"]}
        needs_origin = scope["type"] == "websocket" or scope["method"] not in ("GET", "HEAD")
        origin = headers.get(b"origin") if needs_origin else None
        refused = self._guard.refuses(headers.get(b"host", ""), origin)
        if refused is not None:
            if scope["type"] == "http" and "text/html" in headers.get(b"accept", ""):
                await HTMLResponse(_NOT_HERE.format(html.escape(refused)), 403)(scope, receive, send)
            else:
                await _refuse(scope, receive, send, 403, "not_here", refused)
            return
        if scope["type"] == "http" and scope["path"].startswith("/api/"):
            given = headers.get(b"authorization", "").removeprefix("Bearer ")
            if not await self._visitors.shows_token(scope, given):
                text = "the token is missing or wrong; give it as `Authorization: Bearer TOKEN`"
                await _refuse(scope, receive, send, 401, "token", text)
                return
        await self._app(scope, receive, _with_headers(send))


def _with_headers(send: Send) -> Send:
    async def wrapped(message: Any) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message["headers"], *_HEADERS]}
        await send(message)

    return wrapped


async def _refuse(scope: Scope, receive: Receive, send: Send, status: int, error: str, text: str) -> None:
    """Refuse. Before a WebSocket is accepted, its refusal is an HTTP answer, too."""
    response: Callable[[Scope, Receive, Send], Awaitable[None]]
    told = with_chinese({"error": error, "text": text}, "text")
    response = Response(encode(told), status, media_type="application/json")
    if scope["type"] == "websocket" and "websocket.http.response" not in scope.get("extensions", {}):
        await send({"type": "websocket.close", "code": 1008, "reason": error})
        return
    await response(scope, receive, send)
