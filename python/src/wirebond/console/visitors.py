"""Connections of the console before they have shown the token: how many there are, how long they may do nothing, and
how often a token can be tried. All of it in the thread of the loop."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from starlette.types import Scope
from uvicorn.protocols.http.h11_impl import H11Protocol

from wirebond.console.guard import Guard
from wirebond.server.strangers import WITHIN, Strangers, WrongTokens

_LOOK_EVERY = 0.02  # seconds
_SERVED_WITHIN = 10.0  # seconds that one answer to a stranger may take, such as the page over a slow network
_Key = tuple[str, int]  # address and port of the client


@dataclass(eq=False)
class _Visitor:
    transport: asyncio.Transport
    key: _Key
    since: float  # of its last activity
    serving: int = 0  # requests
    is_known: bool = False  # has shown the token

    @property
    def is_gone(self) -> bool:
        return bool(self.transport.get_extra_info("socket").fileno() < 0)


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
        """A connection was made."""
        peer = transport.get_extra_info("peername")
        if peer is None:  # it is gone already
            transport.abort()
            return
        visitor = _Visitor(transport, (str(peer[0]), int(peer[1])), time.monotonic())
        self._all[visitor.key] = visitor
        self._make_way(visitor)
        self._look(visitor)

    @contextmanager
    def serving(self, scope: Scope) -> Iterator[None]:
        """While a request is answered."""
        visitor = self._of(scope)
        if visitor is None:
            yield
            return
        if not visitor.is_known:
            self._make_way(visitor)
        visitor.serving += 1
        visitor.since = time.monotonic()
        try:
            yield
        finally:
            visitor.serving -= 1
            visitor.since = time.monotonic()

    async def shows_token(self, scope: Scope, given: str) -> bool:
        """Is it the token? After wrong ones the answer comes later, and only where the client still waits."""
        visitor = self._of(scope)
        if visitor is None:
            return False
        is_right = self._guard.is_token(given)
        delay = self._wrong.delay(visitor.key[0], time.monotonic(), is_right=is_right)
        if delay and not visitor.is_known:
            self._strangers.wait(visitor, makes_way=not self._wrong.is_short)
            if not await _stays(visitor.transport, delay):
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
            goes.transport.abort()

    def _look(self, visitor: _Visitor) -> None:
        """Close what does nothing, and forget what is gone."""
        left = visitor.since + (_SERVED_WITHIN if visitor.serving else WITHIN) - time.monotonic()
        if visitor.is_gone or (left <= 0 and not visitor.is_known):
            visitor.transport.abort()
            self._strangers.leave(visitor)
            if self._all.get(visitor.key) is visitor:
                del self._all[visitor.key]
            return
        asyncio.get_running_loop().call_later(WITHIN if visitor.is_known else left, self._look, visitor)


async def _stays(transport: asyncio.Transport, seconds: float) -> bool:
    """Wait. False: the connection has ended; then at once, because the web server takes only so many requests."""
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0 and not transport.is_closing():
        await asyncio.sleep(min(left, _LOOK_EVERY))
    return not transport.is_closing()


def protocol_for(visitors: Visitors) -> type[asyncio.Protocol]:
    """The web server's connections, each of which is a visitor."""

    class Connection(H11Protocol):
        def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
            super().connection_made(transport)
            visitors.enter(transport)

    return Connection
