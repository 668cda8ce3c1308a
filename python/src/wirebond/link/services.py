"""The services that a link provides automatically: hello, the MCU's clock, and log lines to `logging`.

A thread beside the link, at a low rate.

It holds the link weakly, so that a link can become garbage. What it sends is counted as any frame is.
"""

from __future__ import annotations

import contextlib
import logging
import math
import os
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Protocol

from wirebond.codec import Codec, Message
from wirebond.errors import PortError, UsageError, WirebondError
from wirebond.link.clock_line import ClockLine, HostTime
from wirebond.link.clock_sync import ClockReading, ClockSync
from wirebond.link.devices.port_name import PortName
from wirebond.link.engine import Engine
from wirebond.link.inbox import Inbox
from wirebond.link.line import Line
from wirebond.link.log_lines import LineLimit, log_names, say_line, say_missed
from wirebond.link.peer import HELLO_VERSION, Peer, PeerBook
from wirebond.link.receiving import Asked
from wirebond.link.requests import Outcome, Question
from wirebond.link.service_values import filled
from wirebond.link.stamps import LiveClock, Stamper, has_stamps
from wirebond.protocol.model import End, Service
from wirebond.protocol.planning import plan_for
from wirebond.seldom import Seldom, and_more


class AskingLink(Protocol):
    """The parts of a link that the services use."""

    codec: Codec
    port: str

    @property
    def state(self) -> str: ...
    @property
    def line(self) -> Line | None: ...
    def send(self, message: str, values: Mapping[str, Any] | None = None, /) -> None: ...
    def ask(
        self, message: str, values: Mapping[str, Any], timeout: float, finish: Callable[[Outcome], None]
    ) -> Asked: ...


_CLOCK_EVERY = 1.0  # seconds between two exchanges of the clock
_CLOCK_SOON = 5  # exchanges at the beginning that follow each other at once
_CLOCK_RETRY = 0.1  # seconds after an exchange that could not begin
_CLOCK_TIMEOUT = 1.0  # seconds for the MCU's answer
_WITHOUT_LINE = ("/pts/", "ttyACM", "ttyGS", "rfcomm")  # ttys whose baud rate is a number without a meaning
_MOST_HEARD = 1024  # messages that wait for the thread; then the oldest are dropped

_log = logging.getLogger("wirebond")


class Services:
    """The services that a link uses by itself. Any thread may ask.

    :param link: held weakly.
    :param end: the one that it plays. The MCU answers each hello, and says none by itself.
    :param says_hello: False: it listens only.
    :param syncs_clock: False: it asks no clock.
    """

    def __init__(
        self,
        link: AskingLink,
        codec: Codec,
        end: End,
        engine: Engine,
        inbox: Inbox,
        *,
        says_hello: bool,
        syncs_clock: bool,
    ) -> None:
        self._wake = threading.Event()
        wake = self._wake
        self._link = weakref.ref(link, lambda _: wake.set())  # the thread ends with the link
        self._codec = codec
        self._engine = engine
        self._place = link.port
        self._says_hello = says_hello and end == End.HOST
        self._answers = says_hello and end == End.MCU
        self._lock = threading.Lock()
        self._book = PeerBook(codec, "MCU" if end == End.HOST else "host")
        self._heard: deque[tuple[Callable[[Message], None], Message]] = deque(maxlen=_MOST_HEARD)
        self._opened: deque[float] = deque()  # when the port was opened, since the last check
        self._clock = _ClockExchanges(codec, inbox) if syncs_clock else None
        self._restarts = 0  # of the peer, that the clock knows of
        if self._clock is not None and self._clock.sync is not None and has_stamps(codec):
            engine.set_stamper(Stamper(codec, LiveClock(self._clock.sync, self._lock)))
        self._limit = LineLimit()
        self._reports = Seldom()  # of hellos: a device may change its own all the time
        names = log_names(codec)
        for name in names:
            inbox.watch(name, self._note_line)
        if self._book.message is not None:
            inbox.watch(self._book.message, self._later(self._hello))
        if names or self._book.message is not None or (self._clock is not None and self._clock.sync is not None):
            inbox.watch_port(self._note_port)
            inbox.start()
            threading.Thread(target=self._run, name=f"services of {self._place}", daemon=True).start()

    @property
    def peer(self) -> Peer:
        """Return whether the other end has the same file."""
        with self._lock:
            return self._book.peer

    @property
    def clock(self) -> ClockReading | None:
        """Return the state of the MCU's clock."""
        with self._lock:
            return None if self._clock is None or self._clock.sync is None else self._clock.sync.reading()

    @property
    def clock_line(self) -> ClockLine | None:
        """Return the same in the form that conversions use."""
        with self._lock:
            return None if self._clock is None or self._clock.sync is None else self._clock.sync.line

    def host_time(self, mcu_us: int, near: float) -> HostTime:
        """See ``Link``."""
        if self._clock is None:
            if self._place.startswith("replay:"):
                raise UsageError(
                    "a replay has no MCU to ask for its clock; message.stamp is known where the recorded link asked"
                )
            raise UsageError("this link does not follow the MCU's clock; open it with clock_sync=True")
        if self._clock.sync is None:
            raise UsageError(self._clock.why)
        with self._lock:
            return self._clock.sync.to_host(mcu_us, near)

    def note_exchange(self, sent: float, reply: Message) -> None:
        """Note an exchange of the clock that the program had; it counts like those of the link."""
        fields = reply.fields
        if self._clock is not None and self._clock.sync is not None:
            with self._lock:
                self._clock.sync.feed(sent, fields["received_us"], fields["sent_us"], reply.t)

    def end(self) -> None:
        """Note that the link is closed."""
        self._wake.set()

    def _later(self, function: Callable[[Message], None]) -> Callable[[Message], None]:
        """Return a function for the receiving thread, which runs no code of the program: `function` runs here."""

        def note(message: Message) -> None:
            self._heard.append((function, message))
            self._wake.set()

        return note

    def _note_line(self, message: Message) -> None:
        """Note log lines, as `_later`; they may come in floods."""
        if self._limit.passes(message.t):
            self._heard.append((self._say_line, message))
            self._wake.set()

    # ---- the thread

    def _run(self) -> None:
        while not self._engine.is_closed():
            link = self._link()
            if link is None:
                return
            due = self._look(link, time.monotonic())
            del link
            self._wake.wait(None if due == math.inf else max(due - time.monotonic(), 0.0))
            self._wake.clear()

    def _note_port(self, is_open: bool, t: float) -> None:
        """Note an event of the port. In the thread that receives."""
        if is_open:
            self._opened.append(t)
        self._wake.set()

    def _look(self, link: AskingLink, now: float) -> float:
        """Do what is due.

        :returns: when to look again where nothing wakes before: inf: never.
        """
        state = link.state
        while self._opened:
            opened = self._opened.popleft()
            with self._lock:
                self._book.connected(opened)
        while self._heard:
            function, message = self._heard.popleft()
            function(message)
        say_missed(self._place, self._limit.take_missed(now))
        with self._lock:
            is_due = state != "down" and self._says_hello and self._book.is_due(now)
            if is_due:
                self._book.asked(now)
        if is_due:
            self._say_hello(link)
        if state != "down" and self._clock is not None:
            self._clock.look(link, now, self._wake.set)
            with self._lock:
                if self._book.restarts != self._restarts:
                    self._restarts = self._book.restarts
                    self._clock.restart()
                self._clock.take()
        due = self._limit.due
        if state != "down":
            due = min(due, self._book.due if self._says_hello else math.inf)
            due = min(due, math.inf if self._clock is None else self._clock.due)
        return due

    # ---- log lines

    def _say_line(self, message: Message) -> None:
        say_line(self._place, self._codec, message)

    # ---- hello

    def _hello(self, message: Message) -> None:
        fields = message.fields
        with self._lock:
            is_new = self._book.heard(fields["protocol_hash"], fields["version"], message.t)
            peer = self._book.peer
        if is_new and peer.state == "different":
            left_out = self._reports.passes(message.t)
            if left_out is not None:
                _log.warning("%s: %s%s", self._place, peer.why, and_more(left_out))
        link = self._link() if self._answers else None
        if link is not None:
            self._say_hello(link)

    def _say_hello(self, link: AskingLink) -> None:
        name = self._book.message
        assert name is not None
        values = filled(self._codec.model.message(name), {"protocol_hash": self._codec.hash, "version": HELLO_VERSION})
        with contextlib.suppress(WirebondError):  # the port is away, the queue full: it is said again
            link.send(name, values)


class _ClockExchanges:
    """The exchanges of a link's clock, one at a time. `take`, `restart` and `sync`: one thread at a time.

    :param inbox: gives an exchange up that is not answered.
    """

    def __init__(self, codec: Codec, inbox: Inbox) -> None:
        self._requests = inbox.requests
        self._service: Service | None = codec.model.service("clock")
        self._asked_at = 0.0
        self._asked: Question | None = None  # no `Asked`, which would keep the link
        self._answers: deque[Message] = deque()  # to `_asked`: one at most
        self._next = 0.0
        self._soon = _CLOCK_SOON
        self._host_us = 0  # as in the last request
        self._request_bytes = 0  # of its frame
        self._byte_seconds = 0.0  # that a byte takes on the line; 0: that is not known
        self.sync: ClockSync | None = None
        self.why = f"{codec.name} maps no `clock` service, so the MCU's clock cannot be known"
        if self._service is None:
            return
        fields = {role: {f.name: f for f in codec.model.message(name).fields} for role, name in self._service.messages}
        self._mask = (1 << fields["request"]["host_us"].width) - 1
        try:
            self.sync = ClockSync(min(fields["reply"][name].width for name in ("received_us", "sent_us")))
        except UsageError as error:
            self.why = str(error)

    def look(self, link: AskingLink, now: float, wake: Callable[[], None]) -> None:
        """Begin an exchange where one is due."""
        if self.sync is None or self._service is None or self._answers:
            return
        if self._asked is not None:
            if now - self._asked_at < _CLOCK_TIMEOUT:
                return
            self._requests.withdraw(self._asked)
            self._asked = None
        if now < self._next:
            return
        request = self._service.message("request")
        assert request is not None
        self._host_us = round(now * 1e6) & self._mask
        values = filled(link.codec.model.message(request), {"host_us": self._host_us})
        self._request_bytes = len(link.codec.encode(request, values))
        self._byte_seconds = byte_seconds(link)

        def answered(outcome: Message | Exception) -> None:  # in the thread that receives
            if isinstance(outcome, Message):
                self._answers.append(outcome)
            wake()

        self._next = now + (0.0 if self._soon > 0 else _CLOCK_EVERY)
        self._soon -= 1
        self._asked_at = now
        try:
            self._asked = link.ask(request, values, _CLOCK_TIMEOUT, answered).question
        except WirebondError:  # the port is away, the queue full: it is asked again
            self._next = max(self._next, now + _CLOCK_RETRY)

    @property
    def due(self) -> float:
        """Return when to call ``take`` next."""
        if self.sync is None:
            return math.inf
        return self._next if self._asked is None else self._asked_at + _CLOCK_TIMEOUT

    def take(self) -> None:
        """Process the answers."""
        while self._answers:
            reply = self._answers.popleft()
            fields = reply.fields
            assert self.sync is not None
            if self._asked is not None and fields["host_us"] == self._host_us:  # else it answers another request
                self.sync.feed(
                    self._asked.since,
                    fields["received_us"],
                    fields["sent_us"],
                    reply.t,
                    self._request_bytes * self._byte_seconds,
                    len(reply.raw) * self._byte_seconds,
                )
            self._asked = None

    def restart(self) -> None:
        """Note that the MCU restarted: its clock begins again."""
        if self.sync is not None:
            self.sync.restart()
        self._next, self._soon = 0.0, _CLOCK_SOON


def may_ask(codec: Codec, listens_to_all: bool) -> bool:
    """Check whether a link may send by itself. Not if it only listens, and not to a bus that it watches."""
    model = codec.model
    has_addresses = plan_for(model, End.HOST).address is not None
    return model.fixed != End.BOTH and not (listens_to_all and has_addresses)


def byte_seconds(link: AskingLink) -> float:
    """Return the transmission time of a byte in seconds; 0 if the port has no line, or one that does not run at its
    baud rate."""
    line = link.line
    if line is None:
        return 0.0
    try:
        device = os.path.realpath(PortName(link.port).path())
    except (PortError, OSError):  # it went away, maybe while its links were followed
        return 0.0
    is_without = any(name in device for name in _WITHOUT_LINE)
    return 0.0 if is_without else link.codec.model.link.bits_per_byte / line.baud
