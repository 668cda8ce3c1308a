"""Running a virtual MCU on a pty: the loop with a clock and a file descriptor that the simulation itself has not."""

from __future__ import annotations

import contextlib
import errno
import os
import select
import struct
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from wirebond.errors import UsageError
from wirebond.sim.virtual_mcu import VirtualMcu
from wirebond.system import NOT_OUR_TERMINAL, no_ptys

with contextlib.suppress(ImportError):  # Windows has none
    import fcntl
    import termios
    import tty

_LOOK = 0.02  # seconds between two checks for a program
_SET_UP = 25  # checks while a program sets up its port
_TICK = 0.002  # seconds between checks of the schedule


class PtyPort:
    """A pseudo-terminal whose other side anybody can open as a tty. ``path`` is that side.

    :raises UsageError: this is Windows.
    """

    def __init__(self) -> None:
        # The keeper keeps the line alive while no program has it open.
        self._controller, self._keeper, self.path = _raw_pty()
        self.lost_bytes = 0  # no program read them: the line has no flow control, as a UART has none

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

    def wait_for_program(self) -> None:
        """Wait until a program has opened the other side and set it up: most drop earlier bytes.

        From here on the line is in packet mode (ioctl_tty(2), TIOCPKT), which shows it; ``read`` is not for that mode.
        """
        if sys.platform == "win32":
            return
        fcntl.ioctl(self._controller, termios.TIOCPKT, struct.pack("i", 1))
        self._close_keeper()
        watched = select.poll()
        watched.register(self._controller, 0)
        while watched.poll(0):  # hung up
            time.sleep(_LOOK)
        with contextlib.suppress(OSError):  # some keep others out, and the line is alive by them
            self._keeper = os.open(self.path, os.O_RDWR | NOT_OUR_TERMINAL)
        for _ in range(_SET_UP):
            time.sleep(_LOOK)
            if self._was_flushed():
                return

    def unread(self) -> int | None:
        """Return how many written bytes the program has not read yet; None if that cannot be known."""
        if self._keeper < 0 or sys.platform == "win32":
            return None
        if not select.select([self._keeper], [], [], 0)[0]:  # unlike FIONREAD, it waits for bytes on their way
            return 0
        waiting = bytearray(4)
        fcntl.ioctl(self._keeper, termios.FIONREAD, waiting)
        return int.from_bytes(waiting, sys.byteorder)

    def _was_flushed(self) -> bool:
        if sys.platform == "win32":
            return False
        try:
            return bool(os.read(self._controller, 4096)[0] & termios.TIOCPKT_FLUSHREAD)
        except OSError:  # nothing has happened, or the program is gone again
            return False

    def fileno(self) -> int:
        return self._controller

    def close(self) -> None:
        os.close(self._controller)
        self._close_keeper()

    def _close_keeper(self) -> None:
        if self._keeper >= 0:
            os.close(self._keeper)
        self._keeper = -1


def _raw_pty() -> tuple[int, int, str]:
    """Return both ends of a new pty, and the path of the second."""
    if sys.platform == "win32":
        raise no_ptys("a device that is simulated or replayed")
    controller, tty_end = os.openpty()
    set_raw(tty_end)
    os.set_blocking(controller, False)
    return controller, tty_end, os.ttyname(tty_end)


def set_raw(descriptor: int) -> None:
    """Let a tty give every byte as it is.

    :param descriptor: of the open tty.
    """
    if sys.platform != "win32":
        tty.setraw(descriptor)


def run(mcu: VirtualMcu, port: PtyPort, until: float, on_event: Callable[[str], None]) -> None:
    """Serve until ``time.monotonic()`` reaches ``until``; KeyboardInterrupt ends it early."""
    while (now := time.monotonic()) < until:
        data = port.read(min(_TICK, until - now))
        if mcu.codec.model.link.echo:
            port.write(data)  # the line echoes the host's bytes
        port.write(mcu.feed(data, time.monotonic()))
        port.write(mcu.tick(time.monotonic()))
        for event in mcu.events:
            on_event(event)
        mcu.events.clear()


@contextlib.contextmanager
def symlinked(target: str, link: Path | None) -> Iterator[str]:
    """Yield a symbolic link to the pty for as long as it lives, so that its name is known beforehand."""
    if link is None:
        yield target
        return
    if link.is_symlink():
        if link.exists():
            raise UsageError(
                f"{link} leads to {link.readlink()}, which another program serves; end that one, name another link, or "
                "remove this one"
            )
        link.unlink()  # left by a simulation that was killed
    try:
        link.symlink_to(target)
    except OSError as error:
        raise UsageError(
            f"cannot make the link {link}: {error.strerror}; name a new file in an existing folder"
        ) from None
    try:
        yield str(link)
    finally:
        if link.is_symlink() and str(link.readlink()) == target:
            link.unlink()
