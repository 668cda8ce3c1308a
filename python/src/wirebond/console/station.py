"""The link that the console serves now, with its server and its history. It can be replaced. Any thread."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from wirebond.recording.history.keeper import Keeper

if TYPE_CHECKING:
    from wirebond.link import Link
    from wirebond.recording.history.source import Source
    from wirebond.server import Server


@dataclass(frozen=True)
class Served:
    """A link, the server that serves it, and the history that is kept of it."""

    link: Link
    server: Server
    keeper: Keeper
    close: Callable[[], None] = field(default=lambda: None)

    @property
    def source(self) -> Source:
        """The source of the views."""
        return self.keeper.source


class Station:
    """Empty at first."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._served: Served | None = None
        self.connecting: dict[str, str] | None = None  # the connection attempt, for the view of the link

    @property
    def served(self) -> Served | None:
        """The link that is served now."""
        return self._served

    def put(self, link: Link, server: Server, close: Callable[[], None] = lambda: None) -> None:
        """Serve this link from now on.

        :param close: called when it is no longer served, after the end of its history.
        """
        self.clear()
        with self._lock:
            self._served = Served(link, server, Keeper(link), close)

    def clear(self) -> None:
        """Serve nothing. Without a link nothing happens."""
        with self._lock:
            served, self._served = self._served, None
        if served is not None:
            served.keeper.close()
            served.close()
