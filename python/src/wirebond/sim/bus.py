"""A simulated bus: several devices on one line. What one of them sends, all others hear.

As a program it joins ttys, and prints the tty of the line:

    python -m wirebond.sim.bus /dev/pts/3 /dev/pts/4
"""

from __future__ import annotations

import os
import select
import sys
import threading
from collections.abc import Iterable
from types import TracebackType
from typing import Self

from wirebond.sim.pty_port import PtyPort, set_raw
from wirebond.system import NOT_OUR_TERMINAL, WITHOUT_WAITING

_TICK = 0.05  # seconds between checks whether it shall end


class Bus:
    """Joins ``ttys``, one of each device, by a thread. ``port`` is the tty at which a host hears all of them. Devices
    that send at once disturb each other, as on a real bus. Ends with its ``with`` block.

    :raises OSError: a tty cannot be opened.
    :raises UsageError: this is Windows.
    """

    def __init__(self, ttys: Iterable[str]) -> None:
        self._host = PtyPort()
        self.port = self._host.path
        self._devices: list[int] = []
        self._ends = threading.Event()
        try:
            for path in ttys:
                self._devices.append(os.open(path, os.O_RDWR | NOT_OUR_TERMINAL | WITHOUT_WAITING))
                set_raw(self._devices[-1])
        except OSError:
            self._close()
            raise
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        while not self._ends.is_set():
            sources: list[PtyPort | int] = [self._host, *self._devices]
            ready, _, _ = select.select(sources, [], [], _TICK)
            for source in ready:
                self._forward(source)

    def _forward(self, source: PtyPort | int) -> None:
        if isinstance(source, PtyPort):
            data = source.read(0)
        else:
            data = _read(source)
            self._host.write(data)
            if not data:  # its device has gone
                self._devices.remove(source)
                os.close(source)
        for device in self._devices:
            if device != source:
                _write(device, data)

    def _close(self) -> None:
        for device in self._devices:
            os.close(device)
        self._host.close()

    def close(self) -> None:
        self._ends.set()
        self._thread.join()
        self._close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _read(device: int) -> bytes:
    try:
        return os.read(device, 4096)
    except OSError:
        return b""


def _write(device: int, data: bytes) -> None:
    """Write to a device. Bytes that it does not take are lost: the line has no flow control."""
    try:
        os.write(device, data)
    except OSError:
        return


def main(ttys: list[str]) -> int:
    """Run the program, and return its exit code."""
    if not ttys:
        print("usage: python -m wirebond.sim.bus TTY...", file=sys.stderr)
        return 2
    try:
        with Bus(ttys) as bus:
            print(bus.port, flush=True)
            threading.Event().wait()
    except OSError as error:
        print(f"cannot open {error.filename}: {error.strerror}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 0
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
