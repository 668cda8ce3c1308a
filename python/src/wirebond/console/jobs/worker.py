"""A process that does one job after the other, each within a time and a memory. The other side is `process.py`."""

from __future__ import annotations

import os
import pickle
import signal
import struct
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import IO, Any, ParamSpec, TypeVar

from wirebond.as_json import encode, plain
from wirebond.errors import WirebondError
from wirebond.system import APART

SECONDS = 30  # that one job may take
TOO_LONG = 75  # exit code of a process whose job took too long, where no signal ends it
LENGTH = struct.Struct("<Q")
_P = ParamSpec("_P")
_T = TypeVar("_T")


class JobError(WirebondError):
    """A job took too long or needed too much memory, and was given up."""


class Worker:
    """Starts its process with the first job, and again after one that was given up. Any thread; one job at a time.

    :ivar seconds: that one job may take.
    """

    def __init__(self, seconds: int = SECONDS) -> None:
        self.seconds = seconds
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._is_closed = False

    def run(self, work: Callable[_P, _T], *args: _P.args, **keywords: _P.kwargs) -> _T:
        """Return the result of ``work``, or raise its exception. It is a function of a module, and all can be pickled.

        :raises JobError: it was given up.
        """
        with self._lock:
            process = self._started()
            assert process.stdin is not None
            assert process.stdout is not None
            try:
                write(process.stdin, (work, args, keywords))
                raised, value = read(process.stdout)
            except (EOFError, BrokenPipeError):
                raise JobError(self._why(self._ended(process))) from None
        if raised:
            raise value
        return value  # type: ignore[no-any-return]

    def close(self) -> None:
        """End the process, and the job that it does. A second call does nothing."""
        self._is_closed = True
        if (process := self._process) is not None:
            process.kill()
        with self._lock:  # the job has seen its end
            if self._process is not None:
                self._ended(self._process)

    def _started(self) -> subprocess.Popen[bytes]:
        if self._is_closed:
            raise JobError("the console is closed")
        if self._process is None:
            # Its session is its own: Ctrl-C is for this program, which ends it in order.
            self._process = subprocess.Popen(
                [sys.executable, "-m", "wirebond.console.jobs.process", str(self.seconds)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                **APART,
                env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
            )
        return self._process

    def _ended(self, process: subprocess.Popen[bytes]) -> int:
        """Wait until a process has ended; return its exit code."""
        self._process = None
        with suppress(BrokenPipeError), process:
            pass
        return process.returncode

    def _why(self, code: int) -> str:
        if code == TOO_LONG or (sys.platform != "win32" and code == -signal.SIGALRM):
            return f"this took more than {self.seconds} s and was given up; try it with less"
        return "this was ended before it was done; try it again, or with less"


def as_json(work: Callable[..., object], args: tuple[Any, ...], keywords: dict[str, Any]) -> bytes:
    """Return a job around a job: its result as JSON, so that its size costs this program little."""
    return encode(plain(work(*args, **keywords)))


def write(pipe: IO[bytes], value: Any) -> None:
    """Write one value."""
    data = pickle.dumps(value)
    pipe.write(LENGTH.pack(len(data)) + data)
    pipe.flush()


def read(pipe: IO[bytes]) -> Any:
    """Return the next value.

    :raises EOFError: there is none.
    """
    head = pipe.read(LENGTH.size)
    data = pipe.read(LENGTH.unpack(head)[0]) if len(head) == LENGTH.size else b""
    if not data:
        raise EOFError
    return pickle.loads(data)  # noqa: S301 of a process that is this program's own
