"""A link: one port, opened and supervised by a native thread; messages come out, frames go in."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

from wirebond import _engine
from wirebond.codec import Codec, Message, Stats, load
from wirebond.errors import LinkDownError, MessageError, QueueFullError, UsageError
from wirebond.protocol.model import End, Recover
from wirebond.protocol.problems import no_message
from wirebond.typed import TypedMessage, name_and_values

DEFAULT_HOLD = 0.2  # seconds that a repeated value lives after it was last set
MAX_HOLD = 60.0  # seconds: a longer lease would be none
ADAPTER_LATENCY = 0.016  # seconds: what a USB adapter may hold bytes back (the FTDI default)


@dataclass(frozen=True)
class SendStats:
    """``offered == accepted + refused_down + refused_full``;
    ``accepted == sent + queued + replaced + expired + aborted``."""

    offered: int
    accepted: int
    refused_down: int
    refused_full: int
    sent: int
    sent_bytes: int
    queued: int
    replaced: int
    expired: int
    aborted: int


@dataclass(frozen=True)
class LinkStats:
    receive: Stats
    send: SendStats
    dropped_messages: int  # came in, were not taken by the program, and made room for newer ones
    reconnects: int


class Link:
    """The host's end. It reconnects by itself; frames that were queued when the port went away expire, counted.

    Any thread may call any method. Iterating gives messages until ``close``; one thread should iterate.
    """

    def __init__(self, codec: Codec, port: str | os.PathLike[str], baud: int | None = None) -> None:
        model = codec.model
        settings = model.link
        speed = settings.baud if baud is None else baud
        if not 1 <= speed <= 100_000_000:
            raise UsageError(f"baud is {speed}; expected 1 to 100000000 bits per second")
        if settings.stop_bits not in (1, 2):
            raise UsageError(f"a Linux tty has 1 or 2 stop bits, and {model.name} asks for {settings.stop_bits:g}")
        self.codec = codec
        self.port = _port_name(port)
        self.baud = speed
        self._actions = list(dict.fromkeys(d.then for d in model.deadlines if d.at == End.HOST))
        deadlines = [
            (
                codec._index_of(d.message),
                round(d.after * 1e6),
                self._actions.index(d.then),
                d.recover == Recover.EXPLICIT,
            )
            for d in model.deadlines
            if d.at == End.HOST
        ]
        self._engine = _engine.Link(
            codec._table,
            codec._format_for(End.MCU),
            self.port,
            speed,
            settings.data_bits,
            settings.parity,
            round(settings.stop_bits),
            model.idle_seconds + ADAPTER_LATENCY,
            deadlines,
        )
        self._closed = False

    # ---- sending

    def send(self, message: str | TypedMessage, values: Mapping[str, Any] | None = None, /, **fields: Any) -> None:
        """Send one frame whole: a message by its name, or one of a generated module. Returns when it is queued or
        written; never waits for the line.

        :raises MessageError: nothing was sent: a value is wrong, or the message is the MCU's to send.
        :raises LinkDownError: the port is gone at the moment; the link is looking for it.
        :raises QueueFullError: the line does not keep up.
        """
        name, given = name_and_values(message, values, fields)
        self._check_sender(name)
        self._send(name, self.codec.encode(name, given), urgent=False)

    def repeat(
        self,
        message: str | TypedMessage,
        values: Mapping[str, Any] | None = None,
        /,
        *,
        hold: float = DEFAULT_HOLD,
        **fields: Any,
    ) -> None:
        """Repeat this value at the rhythm of the message's ``every``, for ``hold`` seconds after this call.

        A program that goes on calls it again in time. When it does not, the message's safe value (that of
        ``emergency_stop``) is sent once, or nothing more if it has none: a program that hangs cannot keep a robot
        driving.
        """
        if not 0 < hold <= MAX_HOLD:
            raise UsageError(
                f"hold is {hold:g} s; expected more than 0 and at most {MAX_HOLD:g} s: call repeat() again in time"
            )
        name, given = name_and_values(message, values, fields)
        self._check_sender(name)
        frame = self.codec.encode(name, given)
        period = self.codec.model.message(name).every
        if period is None:
            raise UsageError(f"{name} has no `every` in the protocol file; use send()")
        stop = self.codec.model.emergency_stop
        safe = b""
        if stop is not None and stop.message == name:
            safe = self.codec.encode(name, dict(stop.values))
        self._engine.repeat(self.codec._index_of(name), frame, safe, period, hold, self._reply_index(name))

    def stop_repeating(self, message: str) -> None:
        """Stop repeating, without a last value.

        :raises MessageError: the protocol has no such message.
        """
        self._check_sender(message)
        self._engine.stop_repeating(self.codec._index_of(message))

    def emergency_stop(self) -> None:
        """Send the file's ``emergency_stop`` before all that waits to be sent, and stop repeating that message.

        :raises UsageError: the protocol has none.
        :raises LinkDownError: the port is gone at the moment.
        """
        stop = self.codec.model.emergency_stop
        if stop is None:
            raise UsageError(f"{self.codec.name} has no emergency_stop")
        self.stop_repeating(stop.message)
        self._send(stop.message, self.codec.encode(stop.message, dict(stop.values)), urgent=True)

    # ---- receiving

    def receive(self, timeout: float = 0.0) -> list[Message]:
        """Messages since the last call, waiting up to ``timeout`` seconds for the first."""
        return self._engine.receive(timeout)

    def __iter__(self) -> Iterator[Message]:
        while not self._closed:
            yield from self._engine.receive(0.1)  # short, so that Ctrl-C is heard

    # ---- supervision

    @property
    def state(self) -> str:
        """``down``: the port is gone; ``stale``: no frame for a second; ``up``."""
        return self._engine.state()

    @property
    def deadlines(self) -> dict[str, bool]:
        """The host's deadlines: has this action struck, and not ended yet?"""
        struck = set(self._engine.struck_deadlines())
        return {name: index in struck for index, name in enumerate(self._actions)}

    def recover(self, action: str) -> None:
        """End a deadline with ``recover: explicit``."""
        if action not in self._actions:
            raise UsageError(
                f"{self.codec.name} has no deadline {action!r} at the host; it has {', '.join(self._actions)}"
            )
        self._engine.recover_deadline(self._actions.index(action))

    @property
    def stats(self) -> LinkStats:
        raw = self._engine.stats()
        send = SendStats(**raw.pop("send"))
        dropped, reconnects = raw.pop("dropped_messages"), raw.pop("reconnects")
        return LinkStats(Stats(**raw), send, dropped, reconnects)

    def close(self) -> None:
        """Send what is queued (a second at most) and give the port back."""
        self._closed = True
        self._engine.close()

    def __repr__(self) -> str:
        return f"<wirebond.Link {self.codec.name} on {self.port}: {'closed' if self._closed else self.state}>"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _send(self, message: str, frame: bytes, urgent: bool) -> None:
        answer = self._engine.send(frame, urgent, self._reply_index(message))
        if answer == 1:
            raise LinkDownError(f"{self.port} is not connected; {message} was not sent")
        if answer == 2:
            raise QueueFullError(f"the send queue of {self.port} is full; {message} was not sent. Send less often")

    def _reply_index(self, message: str) -> int:
        reply = self.codec.model.message(message).reply
        return -1 if reply is None else self.codec._index_of(reply)

    def _check_sender(self, message: str) -> None:
        known = {m.name: m for m in self.codec.model.messages}
        if message not in known:
            raise MessageError(no_message(self.codec.name, message, known))
        if not known[message].sent_by(End.HOST):
            raise MessageError(f"{message} is sent by the mcu, not by the host")


def _port_name(port: str | os.PathLike[str]) -> str:
    """The port as text that the system takes whole.

    :raises UsageError: it names none.
    """
    name = os.fsdecode(port)
    if not name:
        raise UsageError("the port's name is empty; give a tty such as /dev/ttyUSB0")
    if "\0" in name or (not name.isascii() and any("\udc80" <= c <= "\udcff" for c in name)):
        raise UsageError(
            f"the port's name {name!r} has a byte that no port's name has; give a tty such as /dev/ttyUSB0"
        )
    return name


def open_link(protocol: str | os.PathLike[str] | Codec, port: str | os.PathLike[str], baud: int | None = None) -> Link:
    """Open ``port`` (a tty) with the protocol file's settings, at its baud rate unless ``baud`` is given.

    :raises PortError: the port cannot be opened; the sentence says why and what to do.
    """
    codec = protocol if isinstance(protocol, Codec) else load(protocol)
    return Link(codec, port, baud)
