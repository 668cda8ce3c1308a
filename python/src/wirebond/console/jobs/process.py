"""Run jobs for a `Worker`: ``python -m wirebond.console.jobs.process SECONDS``, jobs on stdin, until stdin ends."""

from __future__ import annotations

import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress

from wirebond.console.jobs.worker import TOO_LONG, JobError, read, write
from wirebond.system import give_way

_MEMORY = 2 << 30  # bytes of addresses
_NICE = 10  # the link has the processor first


def main() -> None:
    """Run one job after the other."""
    seconds = int(sys.argv[1])
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # a library's prints are not part of the answer
    give_way(_NICE)
    _limit_memory()
    while True:
        try:
            work, args, keywords = read(sys.stdin.buffer)
        except EOFError:
            return
        end = _end_after(seconds)
        try:
            answer = False, work(*args, **keywords)
        except MemoryError:
            answer = True, JobError("this needs too much memory; try it with less")
        except Exception as error:
            answer = True, error
        end()
        try:
            write(answers, answer)
        except (pickle.PicklingError, TypeError, AttributeError) as error:
            write(answers, (True, JobError(f"the answer cannot be given: {error}")))


def _limit_memory() -> None:
    if sys.platform == "win32":
        return  # it has no such limit
    import resource  # noqa: PLC0415 Windows has none

    with suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, resource.getrlimit(resource.RLIMIT_AS)[1]))


def _end_after(seconds: int) -> Callable[[], object]:
    """End this process after this time, and the worker starts another; what is returned calls that off. Nothing catches
    the signal. Windows has none: there a job that never lets Python go on is not ended."""
    if sys.platform != "win32":
        signal.alarm(seconds)
        return lambda: signal.alarm(0)
    timer = threading.Timer(seconds, os._exit, [TOO_LONG])
    timer.daemon = True
    timer.start()
    return timer.cancel


if __name__ == "__main__":
    main()
