"""Reports the state of this process and of those that it started, for a wait that was in vain."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
import traceback
from pathlib import Path

_MOST = 20  # processes
_ENOUGH = 10.0  # seconds for the stacks of one


def account() -> str:
    """The stacks of the other threads here, and command, state and stacks of each process below this one.

    The stacks of a process that is not a Python program are not known.
    """
    names = {thread.ident: thread.name for thread in threading.enumerate()}
    found = [
        f"thread {names.get(ident, ident)} of the test:\n{''.join(traceback.format_stack(frame))}"
        for ident, frame in sys._current_frames().items()
        if ident != threading.get_ident()
    ]
    return "\n".join([*found, *(_of_process(process) for process in descendants()[:_MOST])])


def below(root: int) -> list[int]:
    """Return the processes that this one has started, and those that they have started, without ended ones."""
    found: list[int] = []
    left = [root]
    while left:
        process = left.pop()
        for thread in Path(f"/proc/{process}/task").glob("*/children"):
            with contextlib.suppress(OSError):  # it has ended
                left += map(int, thread.read_text().split())
        found.append(process)
    return found[1:]


def descendants() -> list[int]:
    """Return the processes below this one; of a browser only its first."""
    return [process for process in below(os.getpid()) if "--type=" not in _command(process)]


def _of_process(process: int) -> str:
    with contextlib.suppress(OSError):
        status = Path(f"/proc/{process}/stat").read_text().rpartition(") ")[2].split()[0]
        waits = Path(f"/proc/{process}/wchan").read_text()
        return f"process {process} ({status} {waits}): {_command(process)}\n{_stacks(process)}"
    return f"process {process} has ended"


def _command(process: int) -> str:
    with contextlib.suppress(OSError):
        return Path(f"/proc/{process}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
    return ""


def _stacks(process: int) -> str:
    command = ["py-spy", "dump", "--pid", str(process)]
    path = f"{Path(sys.executable).parent}:{os.environ.get('PATH', '')}"
    with contextlib.suppress(OSError, subprocess.TimeoutExpired):
        told = subprocess.run(
            command, capture_output=True, text=True, timeout=_ENOUGH, check=False, env={**os.environ, "PATH": path}
        )
        return told.stdout
    return ""
