"""An emulated board as a process: its UARTs are TCP ports on loopback, its report is text."""

from __future__ import annotations

import queue
import socket
import subprocess
import threading
from pathlib import Path
from types import TracebackType
from typing import Self

from tests.waiting import PATIENCE

UARTS = 2


class Machine:
    """Runs ``program`` (an ELF file). ``ports``: USART1 and USART2, as a link opens them. Ends with its ``with`` block,
    or with this process, however that ends. Comes up when the program says ``ready``: from then on it loses no byte
    that it receives, and none that it sends while a link has the port open. (Over a pty, the emulator lost some that it
    sent while the reader was late.)

    The processor makes one instruction in a nanosecond of its own time, and skips the time in which it has nothing to
    do; so its time has nothing to do with ours.
    """

    def __init__(self, program: Path) -> None:
        sockets = [socket.create_server(("127.0.0.1", 0)) for _ in range(UARTS)]
        self.ports = ["tcp://{}:{}".format(*one.getsockname()) for one in sockets]
        numbers = [one.fileno() for one in sockets]
        self._process = subprocess.Popen(
            [
                "setpriv", "--pdeathsig=KILL", "qemu-system-arm",
                "-machine", "netduinoplus2", "-icount", "shift=0,sleep=off",
                "-display", "none", "-monitor", "none",
                *(
                    word
                    for number in numbers
                    for word in ("-chardev", f"socket,id=line{number},fd={number},server=on,wait=off,nodelay=on",
                                 "-serial", f"chardev:line{number}")
                ),
                "-chardev", "stdio,id=report,signal=off",
                "-semihosting-config", "enable=on,target=native,chardev=report",
                "-kernel", str(program),
            ],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            pass_fds=numbers,
        )  # fmt: skip
        for one in sockets:
            one.close()
        self._lines: queue.Queue[str | None] = queue.Queue()
        self._seen: list[str] = []
        threading.Thread(target=self._collect, daemon=True).start()
        while self.line() != "ready":
            pass

    def _collect(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line.rstrip("\n"))
        self._lines.put(None)

    def line(self, patience: float = PATIENCE) -> str:
        """The next line of the report. AssertionError, with all lines before, where none comes."""
        try:
            line = self._lines.get(timeout=patience)
        except queue.Empty:
            line = None
        assert line is not None, "\n".join(["the emulated program says no more; it said", *self._seen])
        self._seen.append(line)
        return line

    def report(self, patience: float = PATIENCE) -> dict[str, int]:
        """The lines ``name value`` up to the line ``end``."""
        values = {}
        while (line := self.line(patience)) != "end":
            name, _, value = line.rpartition(" ")
            assert value.isdigit(), "\n".join(self._seen)
            values[name] = int(value)
        return values

    def close(self) -> None:
        self._process.kill()
        self._process.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
