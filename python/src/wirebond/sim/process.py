"""A firmware as a process on a pty: what its main file in ``firmware/<name>/host`` prints and takes."""

from __future__ import annotations

import queue
import subprocess
import threading
from pathlib import Path
from types import TracebackType
from typing import Self

from wirebond.errors import WirebondError

_START_TIMEOUT = 10.0  # seconds


class FirmwareProcess:
    """A running firmware. ``port`` is its tty, ``events`` are the lines that it reports. ``name`` is for sentences,
    ``arguments`` are its main file's. Ends with its ``with`` block, or with this process, however that ends.

    :raises WirebondError: it does not start.
    """

    def __init__(self, program: Path, name: str, *arguments: str) -> None:
        self._process = subprocess.Popen(
            [str(program), *arguments, "--end-with-stdin"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
            start_new_session=True,  # Ctrl-C in the terminal is for us
        )
        self._lines: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._collect, daemon=True).start()
        try:
            self.port = self._lines.get(timeout=_START_TIMEOUT)
        except queue.Empty:
            self.close()
            raise WirebondError(f"{name} did not start") from None
        if not self.port:
            raise WirebondError(f"{name} ended at once; the system may have no pty left")

    def _collect(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line.strip())
        self._lines.put("")

    @property
    def pid(self) -> int:
        """The process's number."""
        return self._process.pid

    def events(self, timeout: float = 0.0) -> list[str]:
        """Return lines such as ``12.345 stop`` since the last call; waits up to ``timeout`` seconds for the first."""
        lines: list[str] = []
        try:
            lines.append(self._lines.get(timeout=timeout) if timeout > 0 else self._lines.get_nowait())
            while True:
                lines.append(self._lines.get_nowait())
        except queue.Empty:
            return [line for line in lines if line]

    def tell(self, line: str) -> None:
        """Send a line to the operator's input; the firmware's main file lists the lines."""
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()

    def close(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(timeout=2)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
