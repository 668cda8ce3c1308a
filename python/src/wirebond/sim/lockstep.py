"""A firmware under virtual time: a process whose clock stops until the simulation lets it run."""

from __future__ import annotations

import subprocess
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from wirebond.errors import WirebondError

_US = 1_000_000


@dataclass(frozen=True)
class Event:
    t: float  # seconds since the start
    text: str


class LockstepFirmware:
    """``advance`` lets time pass and returns what the firmware sent. Nothing depends on this machine's speed: the same
    calls give the same bytes and events, however long they take.

    :param program: it is run with ``--lockstep``, and talks as ``wirebond/posix/lockstep.hpp`` says.
    :raises WirebondError: also from ``advance``: it has ended.
    """

    def __init__(self, program: Path, name: str = "the firmware") -> None:
        self.events: list[Event] = []  # of the firmware; the caller empties it
        self._name = name
        self._now = 0  # microseconds
        self._arriving: deque[tuple[int, bytes]] = deque()
        self._sent = b""
        self._process = subprocess.Popen(
            [str(program), "--lockstep"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
            start_new_session=True,  # Ctrl-C in the terminal is for us
        )
        self._until = self._wait()  # when the firmware wants to go on

    @property
    def now(self) -> float:
        """Seconds since the start."""
        return self._now / _US

    def send(self, data: bytes, delay: float = 0.0) -> None:
        """Send these bytes out of the line so long from now. In order of their times."""
        self._arriving.append((self._now + round(delay * _US), data))

    def tell(self, line: str) -> None:
        """Send a line to the operator's input; the firmware's main file lists the lines. It takes effect at the next
        advance."""
        self._write(f"l {line}\n")

    def advance(self, seconds: float) -> bytes:
        """Let time pass; return the bytes that left the firmware's UART in it."""
        end = self._now + round(seconds * _US)
        while True:
            arrives = self._arriving[0][0] if self._arriving else end + 1
            upto = min(self._until, max(arrives, self._now))
            if upto > end:
                self._now = end
                sent, self._sent = self._sent, b""
                return sent
            data = b""
            while self._arriving and self._arriving[0][0] <= upto:
                data += self._arriving.popleft()[1]
            self._now = upto
            self._write(f"t {upto} {data.hex()}\n")
            self._until = self._wait()

    def _write(self, line: str) -> None:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(line)
            self._process.stdin.flush()
        except BrokenPipeError:
            raise WirebondError(f"{self._name} has ended") from None

    def _wait(self) -> int:
        assert self._process.stdout is not None
        while line := self._process.stdout.readline():
            kind, number, text = [*line.rstrip("\n").split(" ", 2), ""][:3]
            if kind == "e":
                self.events.append(Event(int(number) / _US, text))
            else:
                self._sent += bytes.fromhex(text)
                return int(number)
        raise WirebondError(f"{self._name} has ended")

    def close(self) -> None:
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()
        self._process.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
