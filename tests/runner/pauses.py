"""Suspends processes of a test run at random: a machine that stops now and then, but process by process.

    python -m tests.runner.pauses [--seed N] [--longest SECONDS] COMMAND ...

The processes below the command are suspended one at a time, for up to `--longest` seconds: pytest's workers, firmwares,
servers, browsers. A firmware that has stopped alone refuses commands as too old, and a program that has stopped alone
lets its leases end. A test that fails here, and passes without, depends on time.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress

from tests.processes import below

BETWEEN = 0.5  # seconds from one pause to the next, at most


def pause(process: int, wait: Callable[[], object]) -> None:
    """Suspend a process until ``wait`` returns. One that has ended is left alone."""
    with suppress(ProcessLookupError):
        os.kill(process, signal.SIGSTOP)
        try:
            wait()
        finally:
            os.kill(process, signal.SIGCONT)


def run(command: list[str], seed: int, longest: float) -> int:
    """Run the command with pauses, and return its exit code."""
    source = random.Random(seed)
    over = threading.Event()
    pauses = 0
    with subprocess.Popen(command) as process:

        def suspend() -> None:
            nonlocal pauses
            while not over.wait(source.uniform(0, BETWEEN)):
                if processes := below(process.pid):
                    pause(source.choice(processes), lambda: over.wait(source.uniform(0, longest)))
                    pauses += 1

        thread = threading.Thread(target=suspend)
        thread.start()
        try:
            code = process.wait()
        finally:
            over.set()
            thread.join()
    print(f"{pauses} pauses", flush=True)
    return code


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1, help="of the choices")
    parser.add_argument("--longest", type=float, default=0.7, help="seconds")
    parser.add_argument("command", nargs=argparse.REMAINDER)
    chosen = parser.parse_args()
    if not chosen.command:
        parser.error("a command is missing, such as `python -m pytest -m live`")
    return run(chosen.command, chosen.seed, chosen.longest)


if __name__ == "__main__":
    sys.exit(main())
