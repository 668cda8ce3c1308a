"""The far end of a pty that a test scripts: it sends what the test says, and answers requests as the test says."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import wirebond
from tests.waiting import wait_until as wait_until  # noqa: PLC0414 other folders take it from here
from wirebond.protocol.model import End
from wirebond.sim.pty_port import PtyPort


class Mcu:
    """``answer`` is called in a thread of its own with each message of the host, and gives the bytes of its reply."""

    def __init__(self, codec: wirebond.Codec, answer: Callable[[wirebond.Message], bytes] | None = None) -> None:
        self.codec = codec
        self.pty = PtyPort()
        self.path = self.pty.path
        self.heard: list[wirebond.Message] = []
        self._answer = answer
        self._is_over = False
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def frame(self, name: str, header: dict[str, Any] | None = None, **values: Any) -> bytes:
        return self.codec.encode(name, values, header=header, sender=End.MCU)

    def send(self, name: str, header: dict[str, Any] | None = None, **values: Any) -> None:
        self.write(self.frame(name, header, **values))

    def write(self, data: bytes) -> None:
        with self._lock:
            lost = self.pty.lost_bytes
            self.pty.write(data)
            assert self.pty.lost_bytes == lost, "the link does not read"

    def close(self) -> None:
        self._is_over = True
        self._thread.join()
        self.pty.close()

    def _run(self) -> None:
        decoder = self.codec.decoder("host")
        while not self._is_over:
            for message in decoder.feed(self.pty.read(0.02)):
                self.heard.append(message)
                if self._answer is not None:
                    self.write(self._answer(message))


@contextmanager
def linked(
    codec: wirebond.Codec, answer: Callable[[wirebond.Message], bytes] | None = None, **options: Any
) -> Iterator[tuple[wirebond.Link, Mcu]]:
    """A link and the MCU at its far end."""
    mcu = Mcu(codec, answer)
    try:
        with wirebond.open(codec, mcu.path, **options) as link:
            yield link, mcu
    finally:
        mcu.close()
