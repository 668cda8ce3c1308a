"""The process that joins two ptys by a simulated wire."""

from __future__ import annotations

import contextlib
import json
import signal
import subprocess
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

from wirebond import paths
from wirebond.errors import WirebondError
from wirebond.sim.build import Program, cache, compile_once, shipped
from wirebond.sim.faults import LineFaults

NAME = "wire"
DIRECTIONS = ("a_to_b", "b_to_a")


class LineShape(NamedTuple):
    """``parity``: N, E or O."""

    data_bits: int = 8
    parity: str = "N"
    stop_bits: int = 1


_8N1 = LineShape()


@dataclass(frozen=True, kw_only=True)
class WireSettings(LineFaults):
    """Times are in seconds.

    ``batch``: an adapter hands over at multiples of it, up to ``jitter`` later. ``unplug``: the cable is out from this
    time on, for so long. ``echo``: both directions are one line, and an end hears its own bytes. ``line`` is that of
    end A, and ``baud_b`` and ``line_b`` of end B, None: the same."""

    baud: int = 115200
    line: LineShape = _8N1
    baud_b: int | None = None
    line_b: LineShape | None = None
    batch: float = 0.0
    jitter: float = 0.0
    unplug: tuple[float, float] | None = None
    echo: bool = False
    script: tuple[str, ...] = ()  # result of `read_script`

    def arguments(self) -> list[str]:
        times = {"batch": self.batch, "jitter": self.jitter}
        if self.unplug is not None:
            times |= {"unplug_at": self.unplug[0], "unplug_for": self.unplug[1]}
        return [
            *self._end("a", self.baud, self.line),
            *self._end("b", self.baud_b or self.baud, self.line_b or self.line),
            *(f"{name}_ns={round(seconds * 1e9)}" for name, seconds in times.items()),
            f"echo={int(self.echo)}",
            *self.fault_arguments(),
            *self.script,
        ]

    @staticmethod
    def _end(name: str, baud: int, line: LineShape) -> list[str]:
        parity = "NEO".index(line.parity)
        values = {"baud": baud, "data_bits": line.data_bits, "parity": parity, "stop_bits": line.stop_bits}
        return [f"{name}_{key}={value}" for key, value in values.items()]


def program() -> Program:
    """Return its program."""
    includes = [paths.sim() / "include", paths.posix_include()]
    return Program("the simulated wire", NAME, paths.sim() / "wire" / "main.cpp", includes)


def build() -> Path:
    """Return the compiled program: the one that came with the package; without one it is compiled, once for its
    sources.

    :raises WirebondError: there is no C++ compiler, or it fails.
    """
    return shipped(NAME) or compile_once(program(), cache(NAME))


class WireProcess:
    """``a`` and ``b`` are the ptys' paths. It ends with its ``with`` block, or with this process, however that ends.

    :raises WirebondError: it does not compile or start.
    """

    def __init__(self, settings: WireSettings) -> None:
        self._process = subprocess.Popen(
            [str(build()), *settings.arguments()],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C in the terminal is for us
        )
        assert self._process.stdout is not None
        self.a = self._process.stdout.readline().strip()
        self.b = self._process.stdout.readline().strip()
        if not self.b:
            self.close()
            raise WirebondError("the simulated wire ended at once; the system may have no pty left")

    @property
    def pid(self) -> int:
        """The process's number."""
        return self._process.pid

    def wait(self, seconds: float | None) -> None:
        """Wait until it ends by itself, which it does when a pty breaks, or for so long."""
        try:
            self._process.wait(timeout=seconds)
        except subprocess.TimeoutExpired:
            return

    def account(self) -> dict[str, Any]:
        """Return the outcome of every byte so far, by direction. While it runs.

        :raises WirebondError: it has ended by itself.
        """
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # `_read_account` says why
            self._process.stdin.write("\n")
            self._process.stdin.flush()
        return self._read_account()

    def end(self) -> dict[str, Any]:
        """Stop it, and return the outcome of every byte, by direction.

        :raises WirebondError: it had ended by itself.
        """
        self._process.send_signal(signal.SIGINT)
        account = self._read_account()
        self._process.wait()
        return account

    def _read_account(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise WirebondError(f"the simulated wire ended with code {self._process.wait()}")
        account: dict[str, Any] = json.loads(line)
        return account

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
