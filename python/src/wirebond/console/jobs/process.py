"""Run jobs for a `Worker`: ``python -m wirebond.console.jobs.process SECONDS``, jobs on stdin, until stdin ends."""

from __future__ import annotations

import os
import pickle
import resource
import signal
import sys
from contextlib import suppress

from wirebond.console.jobs.worker import JobError, read, write

_MEMORY = 2 << 30  # bytes of addresses
_NICE = 10  # the link has the processor first


def main() -> None:
    """One job after the other."""
    seconds = int(sys.argv[1])
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints is no answer
    os.nice(_NICE)
    with suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, resource.getrlimit(resource.RLIMIT_AS)[1]))
    while True:
        try:
            work, args, keywords = read(sys.stdin.buffer)
        except EOFError:
            return
        signal.alarm(seconds)  # nothing catches it: it ends this process, and the worker starts another
        try:
            answer = False, work(*args, **keywords)
        except MemoryError:
            answer = True, JobError("this needs too much memory; try it with less")
        except Exception as error:
            answer = True, error
        signal.alarm(0)
        try:
            write(answers, answer)
        except (pickle.PicklingError, TypeError, AttributeError) as error:
            write(answers, (True, JobError(f"the answer cannot be given: {error}")))


if __name__ == "__main__":
    main()
