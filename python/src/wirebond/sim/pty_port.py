"""Running a virtual MCU on a pty: the loop with a clock and a file descriptor that the simulation itself has not."""

from __future__ import annotations

import contextlib
import errno
import os
import select
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

from wirebond.errors import UsageError
from wirebond.sim.virtual_mcu import VirtualMcu

_TICK = 0.002  # seconds between looks at the schedule


class PtyPort:
    """A pseudo-terminal whose other side anybody can open as a tty. ``path`` is that side."""

    def __init__(self) -> None:
        self._controller, self._keeper = os.openpty()  # the keeper keeps the line alive while nobody has it open
        tty.setraw(self._keeper)
        os.set_blocking(self._controller, False)
        self.path = os.ttyname(self._keeper)
        self.lost_bytes = 0  # nobody read: the line has no flow control, as a UART has none

    def read(self, timeout: float) -> bytes:
        ready, _, _ = select.select([self._controller], [], [], timeout)
        if not ready:
            return b""
        try:
            return os.read(self._controller, 4096)
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.EIO):
                return b""
            raise

    def write(self, data: bytes) -> None:
        try:
            written = os.write(self._controller, data) if data else 0
        except BlockingIOError:
            written = 0
        self.lost_bytes += len(data) - written

    def fileno(self) -> int:
        return self._controller

    def close(self) -> None:
        os.close(self._controller)
        os.close(self._keeper)


def run(mcu: VirtualMcu, port: PtyPort, until: float, on_event: Callable[[str], None]) -> None:
    """Serve until ``time.monotonic()`` reaches ``until``; KeyboardInterrupt ends it early."""
    while (now := time.monotonic()) < until:
        data = port.read(min(_TICK, until - now))
        port.write(mcu.feed(data, time.monotonic()))
        port.write(mcu.tick(time.monotonic()))
        for event in mcu.events:
            on_event(event)
        mcu.events.clear()


@contextlib.contextmanager
def symlinked(target: str, link: Path | None) -> Iterator[str]:
    """A symbolic link to the pty for as long as it lives, so that its name is known beforehand."""
    if link is None:
        yield target
        return
    if link.is_symlink():
        if link.exists():
            raise UsageError(
                f"{link} leads to {link.readlink()}, which another program serves; end that one, name another link, or "
                "remove this one"
            )
        link.unlink()  # left behind by a simulation that was killed
    try:
        link.symlink_to(target)
    except OSError as error:
        raise UsageError(
            f"cannot make the link {link}: {error.strerror}; name a file that is not there, in a folder that is"
        ) from None
    try:
        yield str(link)
    finally:
        if link.is_symlink() and str(link.readlink()) == target:
            link.unlink()
