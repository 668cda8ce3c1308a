"""Connections of the console before they have shown the token: how many there are, how long they may do nothing, and
how often a token can be tried. All of it in the thread of the loop."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Any

from starlette.types import Scope
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from wirebond.console.guard import Guard
from wirebond.server.strangers import LOOKS, WITHIN, Strangers, WrongTokens

_SERVED_LOOKS = 5 * LOOKS  # that one answer to a stranger may take, such as the page over a slow network
_Key = tuple[str, int]  # address and port of the client


@dataclass(eq=False)
class _Visitor:
    transport: asyncio.Transport
    key: _Key
    looks: int = 0  # at it since its last activity
    serving: int = 0  # requests
    is_known: bool = False  # has shown the token
    ended: asyncio.Event = field(default_factory=asyncio.Event)

    @property
    def is_gone(self) -> bool:
        return bool(self.transport.get_extra_info("socket").fileno() < 0)

    def end(self) -> None:
        """Close the connection, and the requests that wait with it."""
        self.transport.abort()
        self.ended.set()


class Visitors:
    """:param guard: knows the token."""

    def __init__(self, guard: Guard) -> None:
        self._guard = guard
        self._all: dict[_Key, _Visitor] = {}
        self._strangers: Strangers[_Visitor] = Strangers()
        self._wrong = WrongTokens(guard.token)

    @property
    def stranger_count(self) -> int:
        """Connections that have not shown the token. Any thread."""
        return len(self._strangers)

    def enter(self, transport: asyncio.Transport) -> None:
        """Note that a connection was made."""
        peer = transport.get_extra_info("peername")
        if peer is None:  # it is gone already
            transport.abort()
            return
        visitor = _Visitor(transport, (str(peer[0]), int(peer[1])))
        self._all[visitor.key] = visitor
        self._make_way(visitor)
        self._look(visitor)

    def leave(self, transport: asyncio.Transport) -> None:
        """Note that a connection has ended."""
        peer = transport.get_extra_info("peername")
        visitor = None if peer is None else self._all.get((str(peer[0]), int(peer[1])))
        if visitor is not None and visitor.transport is transport:
            visitor.ended.set()

    @contextmanager
    def serving(self, scope: Scope) -> Iterator[None]:
        """Count a request while it is answered."""
        visitor = self._of(scope)
        if visitor is None:
            yield
            return
        if not visitor.is_known:
            self._make_way(visitor)
        visitor.serving += 1
        visitor.looks = 0
        try:
            yield
        finally:
            visitor.serving -= 1
            visitor.looks = 0

    async def shows_token(self, scope: Scope, given: str) -> bool:
        """Check the token. After wrong ones the answer comes later, and only if the client still waits."""
        visitor = self._of(scope)
        if visitor is None:
            return False
        is_right = self._guard.is_token(given)
        delay = self._wrong.delay(visitor.key[0], time.monotonic(), is_right=is_right)
        if delay and not visitor.is_known:
            self._strangers.wait(visitor, makes_way=not self._wrong.is_short)
            with suppress(TimeoutError):  # who has left gives up a place among the requests that the web server takes
                await asyncio.wait_for(visitor.ended.wait(), delay)
                return False
        if not is_right:
            self._wrong.note(visitor.key[0], time.monotonic())
            return False
        visitor.is_known = True
        self._strangers.leave(visitor)
        return True

    def _of(self, scope: Scope) -> _Visitor | None:
        client: Any = scope["client"]
        return None if client is None else self._all.get((client[0], client[1]))

    def _make_way(self, visitor: _Visitor) -> None:
        goes = self._strangers.enter(visitor)
        if goes is not None:
            goes.end()

    def _look(self, visitor: _Visitor) -> None:
        """Close what does nothing, and forget what is gone. What came while this loop stood still is read first."""
        most = _SERVED_LOOKS if visitor.serving else LOOKS
        if visitor.is_gone or (visitor.looks >= most and not visitor.is_known):
            visitor.end()
            self._strangers.leave(visitor)
            if self._all.get(visitor.key) is visitor:
                del self._all[visitor.key]
            return
        visitor.looks += 1
        asyncio.get_running_loop().call_later(WITHIN / LOOKS, self._look, visitor)


def protocols_for(visitors: Visitors) -> tuple[type[asyncio.Protocol], type[asyncio.Protocol]]:
    """Return the web server's connections, each of which is a visitor: of HTTP, and what they become as WebSockets."""

    class Connection(H11Protocol):
        def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
            super().connection_made(transport)
            visitors.enter(transport)

        def connection_lost(self, exc: Exception | None) -> None:
            super().connection_lost(exc)
            visitors.leave(self.transport)

    class WebSocket(WebSocketsSansIOProtocol):
        def connection_lost(self, exc: Exception | None) -> None:
            super().connection_lost(exc)
            visitors.leave(self.transport)

    return Connection, WebSocket
