"""A meter of how long this machine kept a test from running; a process of its own beside each timed test.

A *stall* is the longest single wait for a processor, in seconds, of the meter itself or of any thread of the test: of
its process and of all that it started. The meter wakes every millisecond and sees a pause of the whole machine as a
late awakening. The waits of the threads are the second figure of `/proc/PID/task/TID/schedstat`, "time spent waiting on
a runqueue" (Linux, Documentation/scheduler/sched-stats.rst), and the time that a hypervisor took is `steal` of
`/proc/stat`. These are read every 20 ms, so that shorter waits add up to one of at most 20 ms.
"""

from __future__ import annotations

import contextlib
import os
import select
import subprocess
import sys
import time
from pathlib import Path

TICK = 0.001  # seconds
SAMPLE = 0.02  # seconds
_TICKS_PER_SECOND = os.sysconf("SC_CLK_TCK")


class Meter:
    """Measures from `begin` on. The process runs until `close`."""

    def __init__(self) -> None:
        command = [sys.executable, "-S", __file__, str(os.getpid())]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def begin(self) -> None:
        self._ask("begin")

    def stall(self) -> float:
        """Seconds of the longest stall since `begin`."""
        return float(self._ask("stall"))

    def close(self) -> None:
        self._process.communicate()

    def _ask(self, word: str) -> str:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{word}\n")
        self._process.stdin.flush()
        return self._process.stdout.readline()


class Waits:
    """The time that each thread below a process has waited for a processor, and each processor for its hypervisor."""

    def __init__(self, root: int) -> None:
        self._root = root
        self._seen: dict[str, float] = {}

    def longest_new(self) -> float:
        """Seconds of the longest wait since the last call. A thread that is new waited from its start."""
        now = {**self._of_threads(), **self._of_processors()}
        longest = max((after - self._seen.get(who, 0.0) for who, after in now.items()), default=0.0)
        self._seen = now
        return longest

    def _of_threads(self) -> dict[str, float]:
        found: dict[str, float] = {}
        left = [str(self._root)]
        while left:
            process = left.pop()
            if process == str(os.getpid()):
                continue
            with contextlib.suppress(OSError):  # it has ended
                for thread in os.scandir(f"/proc/{process}/task"):
                    folder = thread.path
                    with contextlib.suppress(OSError):
                        found[folder] = int(_read(f"{folder}/schedstat").split()[1]) * 1e-9
                        left += _read(f"{folder}/children").split()
        return found

    @staticmethod
    def _of_processors() -> dict[str, float]:
        rows = [line.split() for line in _read("/proc/stat").splitlines()]
        return {row[0]: int(row[8]) / _TICKS_PER_SECOND for row in rows if row[0].startswith("cpu") and row[0] != "cpu"}


def _read(path: str) -> str:
    file = os.open(path, os.O_RDONLY)
    try:
        return os.read(file, 1 << 16).decode()
    finally:
        os.close(file)


def measure(root: int) -> None:
    """Answer each line of the standard input, until it ends."""
    waits, longest, sampled = Waits(root), 0.0, 0.0
    before, worked = time.monotonic(), time.process_time()
    while True:
        is_asked = select.select([0], [], [], TICK)[0]
        now, work = time.monotonic(), time.process_time()
        # From one awakening to the next, but for its own work: a pause may come while it samples, too.
        longest = max(longest, now - before - (work - worked) - TICK)
        before, worked = now, work
        if now >= sampled + SAMPLE or is_asked:
            longest, sampled = max(longest, waits.longest_new()), now
        if is_asked:
            word = os.read(0, 100).decode().strip()
            if not word:
                return
            if word == "begin":
                longest = 0.0
            os.write(1, f"{longest}\n".encode())


if __name__ == "__main__":
    if Path("/proc/self/schedstat").exists():
        measure(int(sys.argv[1]))
    else:
        sys.exit("the meter of stalls needs /proc/self/schedstat: a Linux kernel with CONFIG_SCHED_INFO")
