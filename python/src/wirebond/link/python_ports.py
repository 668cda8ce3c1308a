"""Ports that are driven from Python: RFC 2217 servers, and every port where the engine has none of its own."""

from __future__ import annotations

import contextlib
import errno
import os
import platform
import select
import socket
import stat
import struct
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from wirebond.errors import PortError
from wirebond.link.devices import pty_number, sysfs
from wirebond.link.devices.permission import no_permission
from wirebond.link.devices.port_name import PortName
from wirebond.link.devices.pty_number import PtyNumber

if sys.platform == "win32":
    TtyError: type[Exception] = OSError
else:
    import termios

    TtyError = termios.error
ANSWER = 5.0  # seconds that a server has to answer
# A line without DTR and RTS does not confirm them (ser2net on a pty, sredird on any): they do not matter to a link.
_RFC2217_OPTIONS = "ign_set_control"
_RFC2217_SETTINGS = {"baudrate": "baud rate", "datasize": "data bits", "parity": "parity", "stopsize": "stop bits"}


@dataclass(frozen=True)
class LineSettings:
    """``parity``: as in a protocol file."""

    baud: int
    data_bits: int
    parity: str
    stop_bits: int

    def __str__(self) -> str:
        return f"{self.baud} baud, {self.data_bits} data bits, parity {self.parity}, {self.stop_bits} stop bits"


class PortThread(threading.Thread):
    """Serves a port. Where it collects a link as garbage, the end of that link must not wait: it may wait for this
    thread."""


class PythonPort(Protocol):
    """An open port. One thread reads, one writes; any may cancel. What goes wrong is an ``OSError``."""

    def read(self) -> tuple[bytes, float]:
        """Return the received bytes, after a short wait for the first, and the time of the last read, on
        ``time.monotonic()``."""
        ...

    def write(self, data: bytes) -> int:
        """Wait until the port has accepted all bytes. Return how many it accepted: fewer if the wait was cancelled."""
        ...

    def held(self) -> int:
        """Return how many bytes the driver holds, as far as it reports them."""
        ...

    def cancel(self) -> None:
        """End a ``read`` and a ``write`` of other threads soon. The port is not used after this."""
        ...

    def close(self) -> None:
        """Give it back. No thread reads or writes any more."""
        ...

    def leave_to_parent(self) -> None:
        """Give back the descriptor's copy in a forked child, and send nothing to a server."""
        ...


class PyserialPort:
    """A serial port, or an RFC 2217 server."""

    def __init__(self, port: Any) -> None:
        self._port = port
        self._tells_what_it_holds = hasattr(type(port), "out_waiting")

    def read(self) -> tuple[bytes, float]:
        """See ``PythonPort``."""
        first = self._port.read(1)
        looked = time.monotonic()
        more = self._port.in_waiting if first else 0
        return bytes(first + self._port.read(more)) if more else bytes(first), looked

    def write(self, data: bytes) -> int:
        """See ``PythonPort``."""
        return int(self._port.write(data))

    def held(self) -> int:
        """See ``PythonPort``."""
        return int(self._port.out_waiting) if self._tells_what_it_holds else 0

    def cancel(self) -> None:
        """See ``PythonPort``."""
        for name in ("cancel_read", "cancel_write"):
            with contextlib.suppress(OSError, AttributeError, TypeError):  # it has no such call, or is closed
                getattr(self._port, name)()

    def close(self) -> None:
        """See ``PythonPort``."""
        with contextlib.suppress(OSError):
            _unlock(self._port)
        with contextlib.suppress(OSError):
            self._port.close()

    def leave_to_parent(self) -> None:
        """See ``PythonPort``."""
        with contextlib.suppress(OSError):
            if hasattr(self._port, "leave_to_parent"):
                self._port.leave_to_parent()
            else:
                os.close(self._port.fileno())


class TcpPort:
    """A server that gives a serial line as raw bytes. (pyserial's ``socket://`` reads byte by byte.)"""

    def __init__(self, connection: socket.socket, wait: float) -> None:
        self._connection = connection
        self._wait = wait
        connection.settimeout(ANSWER)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def read(self) -> tuple[bytes, float]:
        """See ``PythonPort``."""
        ready, _, _ = select.select([self._connection], [], [], self._wait)
        looked = time.monotonic()
        if not ready:
            return b"", looked
        data = self._connection.recv(65536)
        if not data:
            raise ConnectionAbortedError
        return data, looked

    def write(self, data: bytes) -> int:
        """See ``PythonPort``."""
        self._connection.sendall(data)
        return len(data)

    def held(self) -> int:
        """See ``PythonPort``."""
        return 0

    def cancel(self) -> None:
        """See ``PythonPort``."""
        with contextlib.suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """See ``PythonPort``."""
        self._connection.close()

    def leave_to_parent(self) -> None:
        """See ``PythonPort``."""
        self._connection.close()


class PortOpener(Protocol):
    """Opens one port, again and again. One thread at a time.

    :ivar line: settings of the port that was opened last, for `line_from`; None: it has none.
    """

    line: dict[str, Any] | None

    def open(self) -> PythonPort:
        """Open the port; may wait for seconds.

        :raises PortError: the port cannot be opened.
        """

    def why_gone(self, error: OSError | None, /) -> str:
        """Return a sentence about a port that has just failed; None: it ended."""

    def appearance(self) -> object:
        """Return a value that changes when the port's device appears again."""


class PythonOpener:
    """Opens one port, again and again. One thread at a time.

    :param wait: seconds that a ``read`` of its ports waits.
    :param root: where the system's ``sys`` is.
    """

    def __init__(self, name: PortName, settings: LineSettings, wait: float, root: Path = Path("/")) -> None:
        self._name = name
        self._settings = settings
        self._wait = wait
        self._at = name.text  # where it was found last
        self._pty = PtyNumber()
        self._root = root
        self.line: dict[str, Any] | None = None  #: of the port that was opened last, for `line_from`; None: it has none

    def open(self) -> PythonPort:
        """Open the port. May wait for seconds.

        :raises PortError: that it cannot be opened, and what to do.
        """
        name = self._name
        self._at = name.path() if name.moves else name.text
        self._refuse_a_strangers()
        try:
            if name.is_tcp and not name.is_rfc2217:
                return TcpPort(socket.create_connection((name.host, int(name.service)), ANSWER), self._wait)
            with contextlib.nullcontext() if name.moves else self._pty.kept(self._at):
                self._refuse_a_strangers()
                timer = _LatencyTimer(self._root, self._at)
                port = self._open_with_pyserial()
                self.line = self._line_of(port, timer)
                self._pty.remember(self._at)
                return PyserialPort(port)
        except PortError:
            raise  # it has its sentence
        except (OSError, ValueError, TtyError) as failure:
            error = failure
            if not isinstance(error, (OSError, ValueError)):  # a tty that goes away while it is set up
                error = OSError(*error.args)
            cause = error.__context__ if isinstance(error.__context__, OSError) else error
            code = cause.errno if isinstance(cause, OSError) and not isinstance(cause, socket.gaierror) else None
            sentence = self._refused_by_server(error, cause) if name.is_tcp else self._refused(error, code)
            raise PortError(sentence, code, name.text) from None

    def _refuse_a_strangers(self) -> None:
        if not self._name.moves and self._pty.is_a_strangers(self._at):
            raise PortError(pty_number.sentence(self._at), None, self._name.text)

    def _open_with_pyserial(self) -> Any:
        line = self._settings
        options: dict[str, Any] = {
            "baudrate": line.baud,
            "bytesize": line.data_bits,
            "parity": {"none": "N", "even": "E", "odd": "O"}[line.parity],
            "stopbits": line.stop_bits,
            "timeout": self._wait,
        }
        # Programs whose ports the engine opens begin sooner without pyserial.
        if self._name.is_rfc2217:
            from wirebond.link.rfc2217 import open_rfc2217  # noqa: PLC0415

            return open_rfc2217(f"rfc2217://{self._name.address}?{_RFC2217_OPTIONS}", **options)
        import serial  # noqa: PLC0415

        return serial.serial_for_url(self._at, **options, **({} if sys.platform == "win32" else {"exclusive": True}))

    def _line_of(self, port: Any, timer: _LatencyTimer) -> dict[str, Any]:
        """Return the settings that the port really uses. An RFC 2217 server has confirmed them."""
        line = self._settings
        made = {"baud": line.baud, "asked_baud": line.baud, "data_bits": line.data_bits, "parity": line.parity}
        made |= {"stop_bits": line.stop_bits, "is_exclusive": not self._name.is_tcp, "low_latency": "not_offered"}
        if self._name.is_tcp or not _HAS_TERMIOS2:
            return made
        made |= _read_back(port.fileno(), line.baud)
        if _low_latency(port.fileno()) is not None:
            with contextlib.suppress(OSError, ValueError):
                port.set_low_latency_mode(True)
            made["low_latency"] = "accepted" if _low_latency(port.fileno()) else "refused"
        return made | timer.set()

    def why_gone(self, error: OSError | None) -> str:
        """Return why an open port is gone."""
        cause = error.__context__ if error is not None and isinstance(error.__context__, OSError) else error
        code = None if cause is None else cause.errno
        if self._name.is_tcp and code is None:
            return f"{self._name.text} closed the connection; look at the log of its server"
        reason = "hang-up" if code is None else os.strerror(code)
        if self._name.is_tcp:
            return f"the connection to {self._name.text} broke ({reason}); look at the network and the server"
        place = self._at if self._at == self._name.text else f"{self._name.text}: {self._at}"
        return f"{place} went away ({reason}); plug it in again, or look at the system's log"

    def appearance(self) -> object:
        """Return a value that changes when the port's file may have appeared, or may have other permissions; always the
        same if there is no file."""
        if self._name.is_tcp or sys.platform == "win32":
            return None
        path = Path("/dev/*" if self._name.moves else self._name.text).absolute()
        found: list[tuple[int, int]] = []
        for place in (path, *path.parents):
            with contextlib.suppress(OSError):
                seen = place.stat()
                found.append((seen.st_ino, seen.st_ctime_ns))
                if place != path:
                    break
        return tuple(found)

    # ---- sentences

    def _refused(self, error: Exception, code: int | None) -> str:
        path = self._at
        text = str(error)
        exists = Path(path).exists() if sys.platform != "win32" else "FileNotFoundError" not in text
        if code == errno.ENOENT or not exists:
            return f"there is no port {path}; plug it in, or look for its name with `{_LIST_PORTS}`"
        if sys.platform != "win32" and not stat.S_ISCHR(Path(path).stat().st_mode):
            what = "a folder, and a serial port is expected" if Path(path).is_dir() else "not a serial port"
            return f"{path} is {what}; give a tty such as /dev/ttyUSB0, /dev/ttyACM0 or a pty"
        if code in (errno.EAGAIN, errno.EBUSY) or "PermissionError" in text:
            return f"{path} is in use by another program; close that one"
        if code == errno.EACCES:
            return no_permission(path)
        if isinstance(error, ValueError):
            return f"{path} cannot run at {self._settings.baud} baud; choose a rate that the adapter knows"
        return f"cannot open {path}: {text}; check its name, baud rate, parity and stop bits ({self._settings})"

    def _refused_by_server(self, error: Exception, cause: Exception) -> str:
        name = self._name.text
        if isinstance(cause, socket.gaierror):
            why = cause.strerror
            return f"the name of {name} cannot be found ({why}); check its spelling, or give an address"
        if isinstance(cause, ConnectionRefusedError):
            return f"nothing listens at {name}; start the server there, or check the port's number"
        if isinstance(cause, TimeoutError):
            return (
                f"{name} does not answer within {ANSWER:g} s; check that it is switched on, its address, and the "
                "firewall between"
            )
        if isinstance(error, ConnectionAbortedError | BrokenPipeError | ConnectionResetError):
            return (
                f"{name} closed the connection at once; its serial port may be missing, or in use by another client: "
                "look at the log of its server"
            )
        text = str(error)
        if "seem to support RFC2217" in text:
            return (
                f"{name} is not an RFC 2217 server: it does not negotiate; if it gives the line as raw bytes, name it "
                f"tcp://{self._name.address}"
            )
        if isinstance(error, ValueError):
            what = next((said for key, said in _RFC2217_SETTINGS.items() if f"'{key}'" in text), "the settings")
            return f"{name} refused {what} of the link ({self._settings}); choose a value that its serial port supports"
        if "RFC2217" in text or "timeout while waiting" in text:
            return f"{name} did not confirm the settings of the link ({self._settings}); check what its server allows"
        return f"cannot connect to {name}: {cause}; check its address and the network"


_TCGETS2 = 0x802C542A  # of Linux on x86 and ARM: struct termios2, with the rate as a number
_HAS_TERMIOS2 = sys.platform == "linux" and platform.machine() in ("x86_64", "i686", "aarch64", "armv7l", "riscv64")
_TIOCGSERIAL, _ASYNC_LOW_LATENCY = 0x541E, 1 << 13
_CSIZE, _CSTOPB, _PARENB, _PARODD = 0o60, 0o100, 0o400, 0o1000


def _read_back(descriptor: int, asked_baud: int) -> dict[str, Any]:
    """Rate and shape of the bytes as the driver has them."""
    if sys.platform == "win32":
        return {}
    import fcntl  # noqa: PLC0415

    raw = fcntl.ioctl(descriptor, _TCGETS2, bytes(44))
    flags, rate = struct.unpack_from("=I", raw, 8)[0], struct.unpack_from("=I", raw, 40)[0]
    return {
        "baud": rate or asked_baud,
        "data_bits": 5 + ((flags & _CSIZE) >> 4),
        "parity": "none" if not flags & _PARENB else "odd" if flags & _PARODD else "even",
        "stop_bits": 2 if flags & _CSTOPB else 1,
    }


def _low_latency(descriptor: int) -> bool | None:
    """Return whether the driver has the flag; None: it knows no such flags."""
    if sys.platform == "win32":
        return None
    import fcntl  # noqa: PLC0415

    try:
        raw = fcntl.ioctl(descriptor, _TIOCGSERIAL, bytes(128))
    except OSError:
        return None
    return bool(struct.unpack_from("=i", raw, 16)[0] & _ASYNC_LOW_LATENCY)


def _unlock(port: Any) -> None:
    """End the lock of pyserial's "exclusive" at once. A process that was just forked has a copy of the descriptor until
    it runs another program, and with it the lock."""
    if sys.platform != "win32":
        import fcntl  # noqa: PLC0415

        fcntl.flock(port.fileno(), fcntl.LOCK_UN)


class _LatencyTimer:
    """Like the engine's: the timer of an FTDI adapter, before and after the opening."""

    def __init__(self, root: Path, port: str) -> None:
        self._path = root / "sys/bus/usb-serial/devices" / Path(port).resolve().name / "latency_timer"
        self._before = sysfs.number(self._path)

    def set(self) -> dict[str, Any]:
        if self._before is None:
            return {}
        code = 0
        now = sysfs.number(self._path)
        if now is not None and now > 1:
            try:
                with self._path.open("r+b", buffering=0) as file:
                    file.write(b"1\n")
            except OSError as error:
                code = error.errno or 0
            now = sysfs.number(self._path)
        return {"latency_timer": (str(self._path), self._before, self._before if now is None else now, code)}


_LIST_PORTS = {"linux": "ls /dev/tty*", "darwin": "ls /dev/cu.*"}.get(sys.platform, "python -m serial.tools.list_ports")
