"""The services of an attached link: the server says hello and follows the MCU's clock, and is asked what it knows. Log
lines go to `logging` here as well."""

from __future__ import annotations

import contextlib
import threading
import time
from queue import Empty, SimpleQueue

import msgspec

from wirebond.codec import Codec, Message
from wirebond.link.attached.attached_link import AttachedLink
from wirebond.link.clock_line import HostTime
from wirebond.link.clock_sync import ClockReading
from wirebond.link.inbox import Inbox
from wirebond.link.log_lines import LineLimit, log_names, say_line, say_missed
from wirebond.link.peer import Peer
from wirebond.link.stamps import ServersClock, Stamper, has_stamps


class AttachedServices:
    """The services of a link, over a server. Any thread may ask."""

    def __init__(self, codec: Codec, engine: AttachedLink, inbox: Inbox, place: str) -> None:
        self._codec = codec
        self._engine = engine
        self._place = place
        self._limit = LineLimit()
        if has_stamps(codec):
            engine.set_stamper(Stamper(codec, ServersClock(engine.clock_line)))
        self._heard: SimpleQueue[Message | None] = SimpleQueue()
        names = log_names(codec)
        for name in names:
            inbox.watch(name, self._note_line)
        if names:
            inbox.start()
            threading.Thread(target=self._run, name=f"log lines of {place}", daemon=True).start()

    @property
    def peer(self) -> Peer:
        """Return the facts about the other end."""
        found = self._engine.peer()
        if found is None:
            return Peer("unknown", why=f"{self._place} is away: {self._engine.why()}")
        return msgspec.convert(found, Peer)

    @property
    def clock(self) -> ClockReading | None:
        """Return the state of the MCU's clock, or None."""
        found = self._engine.clock()
        return None if found is None else msgspec.convert(found, ClockReading)

    @property
    def clock_line(self) -> None:
        """Return None: the server knows it."""

    def host_time(self, mcu_us: int, near: float) -> HostTime:
        """See ``Link``."""
        return HostTime(*self._engine.host_time(mcu_us, near))

    def note_exchange(self, sent: float, reply: Message) -> None:
        """Note an exchange of the clock that the program had. The server's link does not learn of it."""

    def end(self) -> None:
        """Note that the link is closed."""
        self._heard.put(None)

    def _note_line(self, message: Message) -> None:
        if self._limit.passes(message.t):
            self._heard.put(message)

    def _run(self) -> None:
        while not self._engine.is_closed():
            with contextlib.suppress(Empty):
                message = self._heard.get(timeout=1.0)
                if message is None:
                    break
                say_line(self._place, self._codec, message)
            say_missed(self._place, self._limit.take_missed(time.monotonic()))
