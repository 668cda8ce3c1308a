"""Listening to both directions of a line, with a receive-only port on each: who sent what, and in which order."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from types import TracebackType
from typing import NamedTuple, Self

from wirebond.codec import Codec, Message, load
from wirebond.errors import LinkDownError
from wirebond.link.link import Link, open_link

_WAIT = 0.25  # seconds between two looks whether it was closed


class Heard(NamedTuple):
    """A message, and the end that sent it.

    :ivar sender: ``"host"`` or ``"mcu"``.
    :ivar message: what it sent.
    """

    sender: str
    message: Message


class Listener:
    """Two ports that only receive; ``wirebond.listen`` makes one. One thread takes what comes.

    :ivar links: the two links by the end that they hear, for ``state``, ``why``, ``stats``, ``rates`` and ``dump``.
    """

    def __init__(
        self,
        codec: Codec,
        host_port: str | os.PathLike[str],
        mcu_port: str | os.PathLike[str],
        baud: int | None,
        wait_for_port: bool,
    ) -> None:
        self.codec = codec
        self._came = threading.Event()
        with ExitStack() as opened:
            links: dict[str, Link] = {}
            # Whoever plays the one end hears the other.
            for sender, role, port in (("host", "mcu", host_port), ("mcu", "host", mcu_port)):
                link = open_link(
                    codec,
                    port,
                    baud,
                    hold_back=False,
                    listen="all",
                    wait_for_port=wait_for_port,
                    hello=False,
                    clock_sync=False,
                    role=role,
                )
                links[sender] = opened.enter_context(link)
            self._opened = opened.pop_all()
        self.links = links
        for link in links.values():
            link._inbox.listen(self._came.set)
            link._start_reading()

    def receive(self, timeout: float = 0.0) -> list[Heard]:
        """What came since the last call, waiting up to ``timeout`` seconds for the first. Signals are heard meanwhile.

        :param timeout: seconds; 0 does not wait.
        :returns: messages of both ends by the times at which they came; none when the time is over.
        :raises LinkDownError: it is closed, and all that had come was taken.
        """
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
        """Messages of both ends as they come, until ``close``."""
        while True:
            try:
                yield from self.receive(_WAIT)
            except LinkDownError:
                return

    def close(self) -> None:
        """Give both ports back."""
        self._opened.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def listen(
    protocol: str | os.PathLike[str] | Codec,
    *,
    host_port: str | os.PathLike[str],
    mcu_port: str | os.PathLike[str],
    baud: int | None = None,
    wait_for_port: bool = False,
) -> Listener:
    """Listen to both directions of a line between a host and an MCU, and send nothing. Each direction needs a port of
    its own, whose receiving wire is joined to it: two USB adapters, for example.

    :param protocol: a protocol file's path, or a ``Codec``.
    :param host_port: the port that hears what the host sends; any that ``open`` takes.
    :param mcu_port: the port that hears what the MCU sends.
    :param baud: bits per second; default: the file's.
    :param wait_for_port: a port that cannot be opened at first is no error.
    :returns: a listener; close it, or use it in a ``with`` block.
    :raises ProtocolFileError: the file cannot be used.
    :raises PortError: a port cannot be opened.
    """
    codec = protocol if isinstance(protocol, Codec) else load(protocol)
    return Listener(codec, host_port, mcu_port, baud, wait_for_port)
