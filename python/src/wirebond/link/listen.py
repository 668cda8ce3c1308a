"""Listens to both directions of a line, with ports that only receive: who sent what, and in which order."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from types import TracebackType
from typing import NamedTuple, Self

from wirebond.codec import Codec, Message, load
from wirebond.errors import LinkDownError, UsageError
from wirebond.link.link import Link, open_link
from wirebond.link.shared_line import Sender, SharedLine, SharedStats
from wirebond.link.tap import Chunk

_WAIT = 0.25  # seconds between two checks whether it was closed
_LOOK = 0.005  # seconds between two reads of a shared line
_HELD_BACK = 0.02  # seconds that an adapter may hold bytes back
_LINE = "line"  # the link of a shared line


class Heard(NamedTuple):
    """A message, and the end that sent it.

    :ivar sender: ``"host"`` or ``"mcu"``; ``"either"`` if one port hears both ends and the protocol does not say.
    :ivar message: the message.
    """

    sender: str
    message: Message


class Listener:
    """Ports that only receive: one for each direction, or one that hears both; ``wirebond.listen`` makes one. One
    thread takes the messages.

    :ivar links: the links, for ``state``, ``why``, ``stats``, ``rates`` and ``dump``: by the end that they hear, or
        one, ``"line"``, that hears both.
    """

    def __init__(self, codec: Codec, ports: dict[str, str | os.PathLike[str]], baud: int | None, wait: bool) -> None:
        self.codec = codec
        self._came = threading.Event()
        with ExitStack() as opened:
            links: dict[str, Link] = {}
            for sender, port in ports.items():
                link = open_link(
                    codec,
                    port,
                    baud,
                    hold_back=False,
                    listen="all",
                    wait_for_port=wait,
                    hello=False,
                    clock_sync=False,
                    role="mcu" if sender == "host" else "host",  # the role of one end receives the other's frames
                )
                links[sender] = opened.enter_context(link)
            self._opened = opened.pop_all()
        self.links = links
        shared = links.get(_LINE)
        self._shared = None if shared is None else _SharedPort(shared)
        for link in links.values():
            link.internals.inbox.listen(self._came.set)
            link._start_reading()

    @property
    def shared(self) -> SharedStats | None:
        """The account of bytes of one port that hears both ends. None: each end has its own port."""
        return None if self._shared is None else self._shared.line.stats

    @property
    def untold(self) -> list[str]:
        """The messages whose sender one port for both ends cannot determine, as one sentence each."""
        return [] if self._shared is None else list(self._shared.line.untold)

    def receive(self, timeout: float = 0.0) -> list[Heard]:
        """Return the messages since the last call, and wait up to ``timeout`` seconds for the first. Signals interrupt
        it.

        :param timeout: seconds; 0 does not wait.
        :returns: messages of both ends by the times at which they came; none if none came in that time.
        :raises LinkDownError: it is closed, and all received messages were taken.
        """
        if self._shared is not None:
            return self._shared.receive(timeout)
        until = time.monotonic() + timeout
        while True:
            self._came.clear()
            taken: dict[str, list[Message]] = {}
            ended = 0
            try:
                for sender, link in self.links.items():
                    try:
                        taken[sender] = link.receive()
                    except LinkDownError:
                        ended += 1
                found = [Heard(sender, message) for sender, messages in taken.items() for message in messages]
                found.sort(key=lambda heard: heard.message.t)
                left = until - time.monotonic()
                if found or left <= 0:
                    return found
            except BaseException:  # a signal's handler raised
                for sender, messages in taken.items():
                    self.links[sender]._inbox.give_back(messages)
                raise
            if ended == len(self.links):
                raise LinkDownError(f"the ports of {self.codec.name} are closed; no message will come")
            self._came.wait(min(left, _WAIT))

    def __iter__(self) -> Iterator[Heard]:
        """Yield messages of both ends as they come, until ``close``."""
        while True:
            try:
                yield from self.receive(_WAIT)
            except LinkDownError:
                return

    def close(self) -> None:
        """Close both ports."""
        self._opened.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class _SharedPort:
    """The port of a line that both ends send on. One thread."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._tap = link.tap()
        self._looked = time.monotonic()
        self.line = SharedLine(link.codec)

    def receive(self, timeout: float) -> list[Heard]:
        until = time.monotonic() + timeout
        while True:
            now = time.monotonic()
            is_closed = self._link.internals.engine.is_closed()
            found: list[tuple[Sender, Message]] = []
            pieces = [piece for piece in self._tap.take().pieces if isinstance(piece, Chunk)]
            for piece in pieces:
                found += self.line.feed(piece.bytes, piece.before)
            if not pieces:
                found += self.line.finish() if is_closed else self.line.idle(self._looked)
            self._looked = max(self._looked, now - _HELD_BACK)  # bytes until then are read at the next turn
            self._link.internals.inbox.take_rest([])  # drop the link's own messages: it sees half of the bytes only
            left = until - time.monotonic()
            if found or left <= 0:
                return [Heard(str(sender), message) for sender, message in found]
            if is_closed:
                raise LinkDownError(f"{self._link.port} is closed; no message will come")
            time.sleep(min(left, _LOOK))


def listen(
    protocol: str | os.PathLike[str] | Codec,
    *,
    host_port: str | os.PathLike[str] | None = None,
    mcu_port: str | os.PathLike[str] | None = None,
    port: str | os.PathLike[str] | None = None,
    baud: int | None = None,
    wait_for_port: bool = False,
) -> Listener:
    """Listen to both directions of a line between a host and an MCU, and send nothing: with two ports, one whose
    receiving wire is joined to each direction, or with one where both ends send on one line, as on RS-485.

    If both ends send on one line, a frame belongs to the end whose messages fit its id, its magic or ``match``; else to
    the end that its address names; else it is a reply if the frame before asked for it, or a request.
    ``Listener.untold`` has the messages for which even that is not enough.

    :param protocol: a protocol file's path, or a ``Codec``.
    :param host_port: the port that hears what the host sends; any that ``open`` takes.
    :param mcu_port: the port that hears what the MCU sends.
    :param port: instead of these two, the one that hears both.
    :param baud: bits per second; default: the file's.
    :param wait_for_port: a port that cannot be opened at first is not an error.
    :returns: a listener; close it, or use it in a ``with`` block.
    :raises UsageError: neither two ports are given, nor one.
    :raises ProtocolFileError: the file cannot be used.
    :raises PortError: a port cannot be opened.
    """
    if port is not None and host_port is None and mcu_port is None:
        ports = {_LINE: port}
    elif port is None and host_port is not None and mcu_port is not None:
        ports = {"host": host_port, "mcu": mcu_port}
    else:
        raise UsageError(
            "give host_port and mcu_port if each direction has its own port, or port for one that hears both"
        )
    codec = protocol if isinstance(protocol, Codec) else load(protocol)
    return Listener(codec, ports, baud, wait_for_port)
