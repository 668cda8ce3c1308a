"""The console as programs use it: a web server in a thread of its own."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import re
import secrets
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Self

import uvicorn

from wirebond.console.api import routes
from wirebond.console.app import application
from wirebond.console.connector import Connector, Options
from wirebond.console.guard import Guard
from wirebond.console.jobs import Worker
from wirebond.console.library import Library
from wirebond.console.station import Station
from wirebond.console.visitors import Visitors, protocols_for
from wirebond.errors import UsageError
from wirebond.paths import PAGE
from wirebond.seldom import SeldomFilter, limit_errors_of
from wirebond.server.listening import tcp_socket

if TYPE_CHECKING:
    from wirebond.link import Link
    from wirebond.server import Server

DEFAULT_PORT = 8765
_MOST_MESSAGE = 1 << 20  # bytes of one message of a client
_MOST_CONNECTIONS = 256  # that show the token, about; more get HTTP's 503. Each takes up to three file descriptors
_BACKLOG = 32  # connections that are accepted before the loop does anything else
_NO_NEWS = ("ASGI callable returned without completing handshake.",)  # uvicorn, of each WebSocket that is refused
_TOKEN = re.compile(r"[A-Za-z0-9._~-]+")
_PATIENCE = 5.0  # seconds that the thread has to begin and to end


class Console:
    """Serves the page, and what it shows. Starts at once; ends with ``close``, or a ``with`` block. It closes the links
    that it opened itself, and no other.

    :param host: address to listen at.
    :param port: 0: any that is free.
    :param token: what clients must say. None: one is made. Loopback needs it too: every user of a computer reaches it.
    :param page: the folder of the built page.
    :param options: how links are opened that the page asks for; None: it may ask for none.
    :raises PortError: it cannot listen there.
    :raises UsageError: no such host; or the token has other characters than letters, digits, and ``-._~``.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = DEFAULT_PORT,
        *,
        token: str | None = None,
        page: Path = PAGE,
        options: Options | None = None,
    ) -> None:
        if token is not None and not _TOKEN.fullmatch(token):
            raise UsageError(
                "the console's token is part of an address and of a header; use only letters, digits, '-', '_', '.' "
                "and '~'"
            )
        self._socket = tcp_socket(host, port)
        self._host = host
        self._is_closing = False
        self._guard = Guard(self._socket.getsockname()[1], token or secrets.token_urlsafe(16))
        self.station = Station()
        self.page_is_built = (page / "index.html").is_file()
        options = options or Options()
        connector = Connector(self.station, options)
        library = Library(self.station, options.recordings)
        self._worker = Worker()
        api = routes(self.station, library, connector, self._worker)
        visitors = Visitors(self._guard)
        app = application(self._guard, visitors, self.station, library, page, api)
        http, websocket = protocols_for(visitors)
        config = uvicorn.Config(
            app,
            log_config=None,
            access_log=False,
            lifespan="off",
            backlog=_BACKLOG,
            proxy_headers=False,  # a client could choose its own address
            http=http,
            ws=websocket,
            ws_max_size=_MOST_MESSAGE,
            ws_per_message_deflate=False,
            ws_ping_interval=None,  # control has a heartbeat of its own, and views need none
            server_header=False,
            limit_concurrency=_MOST_CONNECTIONS,
            timeout_graceful_shutdown=1,
        )
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(target=self._run, name="console", daemon=True)
        self._thread.start()

    @property
    def port(self) -> int:
        """The port that it listens at."""
        return self._guard.port

    @property
    def token(self) -> str:
        """The token that clients must send."""
        return self._guard.token

    @property
    def address(self) -> str:
        """The address for a browser on this computer, with the token after ``#``."""
        host = self._host
        if host in ("", "0.0.0.0"):  # noqa: S104 it is compared
            host = "127.0.0.1"
        elif host == "::":
            host = "::1"
        shown = f"[{host}]" if ":" in host else host
        return f"http://{shown}:{self.port}/#token={self.token}"

    def show(self, link: Link, server: Server) -> None:
        """Show this link, which the server serves, from now on. Where the page connects another one, both are closed.

        :param link: the link.
        :param server: its server.
        """

        def close() -> None:
            if not self._is_closing:
                server.close()
                link.close()

        self.station.put(link, server, close)

    def close(self) -> None:
        """End every connection. A second call does nothing."""
        self._is_closing = True
        self._server.should_exit = True
        self._worker.close()
        self._thread.join(_PATIENCE)
        self.station.clear()

    def _run(self) -> None:
        with contextlib.suppress(SystemExit):
            asyncio.run(self._serve())

    async def _serve(self) -> None:
        limit_errors_of(asyncio.get_running_loop())
        with _few_records():
            await self._server.serve([self._socket])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@contextlib.contextmanager
def _few_records() -> Iterator[None]:
    """Limit the web server's log: any client can make it write, for example with bytes that are not HTTP."""
    logger, limit = logging.getLogger("uvicorn.error"), SeldomFilter(threading.current_thread(), _NO_NEWS)
    logger.addFilter(limit)
    try:
        yield
    finally:
        logger.removeFilter(limit)
