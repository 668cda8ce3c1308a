"""What a link does by itself with the services of its file: it says hello. A thread beside the link, at a low rate.

It holds the link weakly, so that a link can become garbage. What it sends is counted as any frame is.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

from wirebond import _engine
from wirebond.codec import Codec, Message
from wirebond.errors import WirebondError
from wirebond.link.inbox import Inbox
from wirebond.link.peer import HELLO_VERSION, Peer, PeerBook
from wirebond.link.service_values import filled
from wirebond.protocol.model import End
from wirebond.protocol.plan import plan_for

if TYPE_CHECKING:
    from wirebond.link.link import Link
    from wirebond.link.python_link import PythonLink

_LOOK_EVERY = 0.1  # seconds between two looks at the port
_MOST_HEARD = 1024  # messages that wait for the thread; then the oldest are dropped

_log = logging.getLogger("wirebond")


class Services:
    """The services that a link uses by itself. Any thread may ask.

    :param link: held weakly.
    :param says_hello: False: it listens only.
    """

    def __init__(
        self, link: Link, codec: Codec, engine: _engine.Link | PythonLink, inbox: Inbox, *, says_hello: bool
    ) -> None:
        self._link = weakref.ref(link)
        self._codec = codec
        self._engine = engine
        self._place = link.port
        self._says_hello = says_hello
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._book = PeerBook(codec)
        self._heard: deque[tuple[Callable[[Message], None], Message]] = deque(maxlen=_MOST_HEARD)
        self._connections = -1  # none was seen yet
        self._was_stale = False
        if self._book.message is not None:
            inbox.watch(self._book.message, self._later(self._hello))
            inbox.start()
            threading.Thread(target=self._run, name=f"services of {self._place}", daemon=True).start()

    @property
    def peer(self) -> Peer:
        """What is known of the other end."""
        with self._lock:
            return self._book.peer

    def end(self) -> None:
        """The link is closed."""
        self._wake.set()

    def _later(self, function: Callable[[Message], None]) -> Callable[[Message], None]:
        """For the thread that receives, which runs nothing of the program: `function` runs here."""

        def note(message: Message) -> None:
            self._heard.append((function, message))
            self._wake.set()

        return note

    # ---- the thread

    def _run(self) -> None:
        while not self._engine.is_closed():
            link = self._link()
            if link is None:
                return
            self._look(link, time.monotonic())
            del link
            self._wake.wait(_LOOK_EVERY)
            self._wake.clear()

    def _look(self, link: Link, now: float) -> None:
        state = link.state
        if state != "down":
            connections = self._engine.stats()["reconnects"]
            if connections != self._connections:
                self._connections = connections
                with self._lock:
                    self._book.connected(now)
            elif self._was_stale and state == "up":
                with self._lock:
                    self._book.silent(now)
            self._was_stale = state == "stale"
        while self._heard:
            function, message = self._heard.popleft()
            function(message)
        with self._lock:
            is_due = state != "down" and self._says_hello and self._book.is_due(now)
            if is_due:
                self._book.asked(now)
        if is_due:
            self._say_hello(link)

    # ---- hello

    def _hello(self, message: Message) -> None:
        fields = message.fields
        with self._lock:
            is_new = self._book.heard(fields["protocol_hash"], fields["version"], message.t)
            peer = self._book.peer
        if is_new and peer.state == "different":
            _log.warning("%s: %s", self._place, peer.why)

    def _say_hello(self, link: Link) -> None:
        name = self._book.message
        assert name is not None
        values = filled(self._codec.model.message(name), {"protocol_hash": self._codec.hash, "version": HELLO_VERSION})
        with contextlib.suppress(WirebondError):  # the port is away, the queue full: it is said again
            link.send(name, values)


def may_ask(codec: Codec, listens_to_all: bool) -> bool:
    """May a link say something by itself? Not where it only listens, and not to a bus that it watches."""
    model = codec.model
    has_addresses = plan_for(model, End.HOST).address is not None
    return model.fixed != End.BOTH and not (listens_to_all and has_addresses)
