"""Reports whether this machine was quiet during a benchmark: the processor time of other programs, and how often the
machine stood still."""

from __future__ import annotations

import os
import resource
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

TICK = 0.005  # seconds
MOST_STALL = 0.1  # seconds
MOST_OTHERS = 0.15  # processors
_TICKS_PER_SECOND = os.sysconf("SC_CLK_TCK")


@dataclass
class Noise:
    """From `begin` to `end`. The benchmark runs as a child of this process, which itself does nothing meanwhile."""

    _stall: float = 0.0
    _ends: threading.Event = field(default_factory=threading.Event)

    def begin(self) -> None:
        self._began, self._busy, self._own = time.monotonic(), _busy(), _own()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def end(self) -> str:
        """Say what was not quiet; empty if all was. Call it after the child was waited for."""
        self._ends.set()
        self._thread.join()
        seconds = max(time.monotonic() - self._began, TICK)
        others = (_busy() - self._busy - (_own() - self._own)) / seconds
        found = []
        if self._stall > MOST_STALL:
            found.append(f"the machine stood still for {self._stall * 1000:.0f} ms")
        if others > MOST_OTHERS:
            found.append(f"other programs used {others:.1f} processors")
        return " and ".join(found)

    def _watch(self) -> None:
        before = time.monotonic()
        while not self._ends.wait(TICK):
            now = time.monotonic()
            self._stall = max(self._stall, now - before - TICK)
            before = now


def _busy() -> float:
    """Seconds of all processors together that were not idle, those that a hypervisor took included."""
    # user nice system idle iowait irq softirq steal (proc_stat(5))
    ticks = [int(word) for word in Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:9]]
    return (sum(ticks) - ticks[3] - ticks[4]) / _TICKS_PER_SECOND


def _own() -> float:
    """Seconds that this process and the children that it waited for have used."""
    usages = (resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)
