"""One port for several links: a line that carries several formats, as a GNSS receiver's with UBX and NMEA."""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

from wirebond.arguments import path, whole
from wirebond.codec import Codec
from wirebond.errors import PortError, UsageError
from wirebond.link.devices.port_name import MAX_BAUD, PortName, port_name
from wirebond.link.python_ports import LineSettings, PortOpener, PortThread, PythonOpener, PythonPort

_WAIT = 0.01  # seconds that a read waits
_MOST_PENDING = 1 << 16  # bytes that came and that a link has not taken; more stay with the system


class CommonPort:
    """A port that several links open, each with a protocol of its own::

        port = wirebond.CommonPort("/dev/ttyACM0")
        with wirebond.open("ubx.yaml", port) as ubx, wirebond.open("nmea.yaml", port) as nmea:
            ...

    Each link gets every received byte and finds its own frames among them; the frames of the others count as discarded
    bytes. Frames that the links send leave whole, one after another. The first link opens the port, and its baud rate
    holds for the others; the last link closes it. Any thread.

    :param port: a tty, a USB device or a serial server, by a name that `wirebond.open` takes.
    :param baud: bits per second; default: that of the file whose link is opened first.
    :raises UsageError: links cannot share this kind of port; or ``baud`` is out of its range.
    """

    def __init__(self, port: str | os.PathLike[str], baud: int | None = None) -> None:
        text = os.fsdecode(path("port", port, "a port, such as /dev/ttyUSB0"))
        if text.startswith("wirebond://"):
            raise UsageError(
                f"{text} is the link of a server, which has one protocol; give several files to `wirebond serve`, and "
                "attach to the server of each"
            )
        self._name = port_name(text)
        if self._name.recording or text == "sim:":
            raise UsageError(f"{text} carries one protocol; open it by its name, for one link")
        given = None if baud is None else whole("baud", baud, 1, MAX_BAUD, "bits per second")
        self._line = _Line(self._name, given)

    @property
    def name(self) -> str:
        """The port's name, as it was given."""
        return self._name.text

    @property
    def baud(self) -> int | None:
        """Bits per second; None: the first link that opens it decides."""
        return self._line.baud

    @property
    def codecs(self) -> tuple[Codec, ...]:
        """The protocols of all links that opened it."""
        return self._line.codecs


def opener_of(port: CommonPort, codec: Codec, settings: LineSettings, root: Path) -> PortOpener:
    """Return the opener by which one link opens a common port, each time it does. Any thread.

    :param codec: the link's protocol.
    :param settings: of the line, as the link needs them.
    :param root: where the system's ``sys`` is.
    """
    line = port._line
    line.add(codec, settings)
    return _Opener(line, settings, lambda: PythonOpener(line.name, settings, _WAIT, root))


class _Line:
    """The state that the links of a common port share."""

    def __init__(self, name: PortName, baud: int | None) -> None:
        self.name = name
        self.baud = baud
        self._process = os.getpid()
        self._lock = threading.Lock()
        self._opened: _Opened | None = None  # the last one
        self.codecs: tuple[Codec, ...] = ()

    def add(self, codec: Codec, settings: LineSettings) -> None:
        """Add a link."""
        with self._lock:
            self.baud = self.baud or settings.baud
            if codec.hash not in {known.hash for known in self.codecs}:
                self.codecs = (*self.codecs, codec)

    def open(self, settings: LineSettings, make: Callable[[], PythonOpener]) -> tuple[PythonPort, PythonOpener]:
        """Return the port of one link, and what opened it. It is opened unless another link has it open.

        :param make: makes what opens the port, where no link has opened it yet.
        :raises PortError: the port cannot be opened, or is open with other settings.
        """
        if os.getpid() != self._process:
            raise PortError(
                f"{self.name.text} belongs to the process that made its CommonPort, and this one is its fork; make "
                "another CommonPort here"
            )
        with self._lock:
            opened = self._opened
            branch = None if opened is None else opened.branch()
            if opened is None or branch is None:
                opened = self._opened = _open(opened, settings, make)
                branch = opened.first
            elif settings != opened.settings:
                branch.close()
                raise PortError(
                    f"{self.name.text} is open for another link, at {opened.settings}, and this one asks for "
                    f"{settings}; leave out its baud rate, or give both protocol files the same `link`"
                )
            return branch, opened.opener


def _open(last: _Opened | None, settings: LineSettings, make: Callable[[], PythonOpener]) -> _Opened:
    """Open the port again. After a failure the same opener looks for the same device. Once all links have closed the
    port, its name may lead to another device."""
    if last is None:
        return _Opened(make(), settings)
    last.wait_until_closed()
    return _Opened(last.opener if last.has_failed and last.settings == settings else make(), settings)


class _Opener:
    """See `PortOpener`."""

    def __init__(self, line: _Line, settings: LineSettings, make: Callable[[], PythonOpener]) -> None:
        self._line = line
        self._settings = settings
        self._make = make
        self._last = make()  # that opened the port
        self.line: dict[str, Any] | None = None

    def open(self) -> PythonPort:
        """See `PortOpener`."""
        port, self._last = self._line.open(self._settings, self._make)
        self.line = self._last.line
        return port

    def why_gone(self, error: OSError | None, /) -> str:
        """See `PortOpener`."""
        return self._last.why_gone(error)

    def appearance(self) -> object:
        """See `PortOpener`."""
        return self._last.appearance()


class _Opened:
    """The port from one opening to its end, with a thread that reads. The end: it failed, or its last branch is closed.

    Behind the end the port is closed before any branch fails, so that it can be opened again.

    :ivar first: a branch; for more see ``branch()``.
    :raises PortError: the port cannot be opened.
    """

    def __init__(self, opener: PythonOpener, settings: LineSettings) -> None:
        self.opener = opener
        self.settings = settings
        self._port = opener.open()
        self._changed = threading.Condition()
        self.first = _Branch(self)
        self._branches = [self.first]
        self._writer: _Branch | None = None
        self._cancelling = 0  # threads that cancel the port
        self._is_closing = False  # no one cancels it any more
        self._failure: OSError | None = None
        self._is_over = False
        self._is_closed = False
        self._is_left = False
        self._reader = PortThread(target=self._read, name="reader of a common port", daemon=True)
        self._reader.start()

    def branch(self) -> _Branch | None:
        """Add a branch; None: the port is at its end."""
        branch = _Branch(self)  # without the lock: it may collect a link as garbage, whose end waits for others
        with self._changed:
            if self._is_over:
                return None
            self._branches.append(branch)
            return branch

    def _read(self) -> None:
        failure: OSError | None = None
        try:
            while self._may_read():
                data, looked = self._port.read()
                if data:
                    with self._changed:
                        for branch in self._branches:
                            branch.chunks.append((data, looked))
                        self._changed.notify_all()
        except OSError as error:
            failure = error
        with self._changed:
            self._end(failure)
        self._cancel()  # a write that waits
        with self._changed:
            self._changed.wait_for(lambda: self._writer is None and not self._cancelling)
            self._is_closing = True
        self._port.close()
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()

    def _may_read(self) -> bool:
        """Wait until every branch has room. False: the port is at its end."""

        def has_room() -> bool:
            return self._is_over or all(branch.pending <= _MOST_PENDING for branch in self._branches)

        with self._changed:
            self._changed.wait_for(has_room)
            return not self._is_over

    def _end(self, failure: OSError | None) -> None:
        """End all branches. With the lock."""
        self._is_over = True
        self._failure = self._failure or failure
        self._changed.notify_all()

    def _raise_if_over(self) -> None:
        """Raise if the port has ended. With the lock. Each branch has an error of its own, with the cause's number."""
        if not self._is_over:
            return
        self._changed.wait_for(lambda: self._is_closed)
        error = self._failure
        cause = error.__context__ if error is not None and isinstance(error.__context__, OSError) else error
        raise OSError(*(() if cause is None else cause.args))

    @property
    def has_failed(self) -> bool:
        """Was its end a failure of the port?"""
        with self._changed:
            return self._failure is not None

    def wait_until_closed(self) -> None:
        """Wait until the port is at its end."""
        with self._changed:
            self._changed.wait_for(lambda: self._is_closed)

    # ---- called by a branch

    def read(self, branch: _Branch) -> tuple[bytes, float]:
        with self._changed:
            self._changed.wait_for(lambda: branch.chunks or branch.is_cancelled or self._is_over, _WAIT)
            if branch.is_cancelled:
                return b"", time.monotonic()
            if branch.chunks:
                self._changed.notify_all()  # there is room again
                return branch.chunks.popleft()
            self._raise_if_over()
        return b"", time.monotonic()

    def write(self, branch: _Branch, data: bytes) -> int:
        with self._changed:
            self._changed.wait_for(lambda: self._writer is None or branch.is_cancelled or self._is_over)
            if branch.is_cancelled:
                return 0
            self._raise_if_over()
            self._writer = branch
        failure: OSError | None = None
        try:
            return self._port.write(data)
        except OSError as error:
            failure = error
            raise
        finally:
            with self._changed:
                self._writer = None
                if failure is not None:
                    self._end(failure)
                self._changed.notify_all()

    def held(self) -> int:
        return self._port.held()

    def cancel(self, branch: _Branch) -> None:
        with self._changed:
            branch.is_cancelled = True
            self._changed.notify_all()
            is_writing = self._writer is branch
        if is_writing:
            self._cancel()

    def close(self, branch: _Branch) -> None:
        with self._changed:
            self._branches.remove(branch)
            if not self._branches:
                self._end(None)
            self._changed.notify_all()
            if self._branches:
                return
        self._cancel()
        self._reader.join()

    def _cancel(self) -> None:
        """Cancel a wait, unless the port is closed, or will be at once."""
        with self._changed:
            if self._is_closing:
                return
            self._cancelling += 1
        try:
            self._port.cancel()
        finally:
            with self._changed:
                self._cancelling -= 1
                self._changed.notify_all()

    def leave_to_parent(self) -> None:
        """Give everything up in a forked child, which has neither the threads nor the locks."""
        if not self._is_left:
            self._is_left = True
            self._port.leave_to_parent()


class _Branch:
    """The port of one link; see `PythonPort`.

    :ivar chunks: what came and was not read, each with the time when it was looked for more. With the port's lock.
    :ivar is_cancelled: reads and writes end at once. With the port's lock.
    """

    def __init__(self, opened: _Opened) -> None:
        self._opened = opened
        self.chunks: deque[tuple[bytes, float]] = deque()
        self.is_cancelled = False

    @property
    def pending(self) -> int:
        """Bytes that were not read."""
        return sum(len(data) for data, _ in self.chunks)

    def read(self) -> tuple[bytes, float]:
        """See `PythonPort`."""
        return self._opened.read(self)

    def write(self, data: bytes) -> int:
        """See `PythonPort`."""
        return self._opened.write(self, data)

    def held(self) -> int:
        """See `PythonPort`."""
        return self._opened.held()

    def cancel(self) -> None:
        """See `PythonPort`."""
        self._opened.cancel(self)

    def close(self) -> None:
        """See `PythonPort`."""
        self._opened.close(self)

    def leave_to_parent(self) -> None:
        """See `PythonPort`."""
        self._opened.leave_to_parent()
