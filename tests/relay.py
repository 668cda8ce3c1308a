"""A TCP connection that goes through the test, and loses what the test says."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable


class Relay:
    """Between a client and the server: what is dropped is lost without a close."""

    def __init__(self, to: int, host: str = "127.0.0.1", port: int = 0) -> None:
        self._to = to
        self._socket = socket.create_server((host, port))
        self.port = self._socket.getsockname()[1]
        self.drops = threading.Event()
        self._open = [self._socket]
        self._threads: list[threading.Thread] = []

    def __enter__(self) -> Relay:
        self._start(self._accept)
        return self

    def __exit__(self, *_: object) -> None:
        _shut(self._socket)
        self._threads[0].join()  # none opens behind it
        for one in self._open:
            _shut(one)
        for thread in self._threads[1:]:
            thread.join()
        for one in self._open:
            one.close()

    def _start(self, run: Callable[..., None], *args: object) -> None:
        thread = threading.Thread(target=run, args=args)
        self._threads.append(thread)
        thread.start()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):  # it was shut
            while True:
                near, _ = self._socket.accept()
                far = socket.create_connection(("127.0.0.1", self._to))
                self._open += [near, far]
                self._start(self._carry, near, far)
                self._start(self._carry, far, near)

    def _carry(self, source: socket.socket, target: socket.socket) -> None:
        has_lost = False
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                if self.drops.is_set():
                    has_lost = True
                elif has_lost:  # TCP never goes on behind a hole
                    _shut(source)
                    break
                else:
                    target.sendall(data)
        if not self.drops.is_set():
            _shut(target)


def _shut(one: socket.socket) -> None:
    with contextlib.suppress(OSError):
        one.shutdown(socket.SHUT_RDWR)
