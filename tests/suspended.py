"""Suspends a process, or one loop, while a test does something."""

from __future__ import annotations

import asyncio
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Self

from tests.waiting import PATIENCE, wait_until

_OFTEN = 0.005  # seconds
_COUNTS = ("voluntary_ctxt_switches:", "nonvoluntary_ctxt_switches:")


class Suspended:
    """``with Suspended(process.pid) as pause:`` each thread of the process has stopped when the block begins.

    What suspends and continues a whole run, tests and all, continues this process before its time. It is stopped again
    at once then, and ``has_run`` says so.

    :ivar has_run: whether it was not still for the whole block; also within the block, until now.
    """

    def __init__(self, process: int) -> None:
        self._process = process
        self._over = threading.Event()
        self._guard = threading.Thread(target=self._watch)
        self._switches = 0
        self._at_end: int | None = None

    def __enter__(self) -> Self:
        self._guard.start()
        wait_until(lambda: self.states() == {"T"}, lambda: f"all threads stop; they are {self.states()}")
        self._switches = self._counted()
        return self

    @property
    def has_run(self) -> bool:
        return (self._counted() if self._at_end is None else self._at_end) != self._switches

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._guard.join()
        self._at_end = self._counted()
        os.kill(self._process, signal.SIGCONT)

    def _watch(self) -> None:
        while True:
            os.kill(self._process, signal.SIGSTOP)
            if self._over.wait(_OFTEN):
                return

    def states(self) -> set[str]:
        """Return the states of its threads, by one letter each (proc(5))."""
        files = Path(f"/proc/{self._process}/task").glob("*/stat")
        return {file.read_text().rpartition(")")[2].split()[0] for file in files}

    def _counted(self) -> int:
        """Return how often its threads were put on a processor, and taken off again."""
        lines = [line for file in Path(f"/proc/{self._process}/task").glob("*/status") for line in file.open()]
        return sum(int(line.split()[1]) for line in lines if line.startswith(_COUNTS))


@contextmanager
def stalled(loop: asyncio.AbstractEventLoop) -> Iterator[None]:
    """This loop of another thread does nothing until the end of the block."""
    began, goes_on = threading.Event(), threading.Event()
    loop.call_soon_threadsafe(lambda: (began.set(), goes_on.wait(PATIENCE)))
    assert began.wait(PATIENCE)
    try:
        yield
    finally:
        goes_on.set()
