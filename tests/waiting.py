"""All waiting of the tests. A test waits for an event, with one generous bound, and asserts no duration.

A machine that is busy, or suspended for seconds, makes everything later and nothing wrong. So no other file of the
tests sleeps or compares readings of a clock; `make lint` refuses it, except in tests marked `timed`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

from tests import processes

PATIENCE = 60.0  # seconds: a bound for what never comes, not an expectation
_PAUSE = 0.002  # seconds between two looks


def moments(what: object = "it", bound: float = PATIENCE) -> Iterator[None]:
    """Rounds of a loop that waits: each one looks, and leaves the loop when what it waits for is there.

    After ``bound`` seconds, AssertionError says that ``what`` did not come. A function is called for it then, so that
    it can say what was there instead.
    """
    end = time.monotonic() + bound
    while True:
        is_last = time.monotonic() >= end  # before the look, so that there is one after a pause of the machine
        yield
        if is_last:
            error = AssertionError(f"waited {bound:g} s in vain: {what() if callable(what) else what}")
            error.add_note(processes.account())
            raise error
        time.sleep(_PAUSE)


def wait_until(holds: Callable[[], object], what: object = "it", bound: float = PATIENCE) -> None:
    """Until this is true. ``what`` and ``bound`` as in `moments`."""
    for _ in moments(what, bound):
        if holds():
            return


def let_pass(seconds: float) -> None:
    """Sleep at least so long: until something has become old, or to give what must not come the time to come.

    More time must be as good. A test that would fail after more of it waits for an event instead.
    """
    time.sleep(seconds)


def rounds_for(seconds: float) -> Iterator[None]:
    """Rounds of a loop that goes on for at least so long, such as one that reads what must not come.

    The last round begins after that time, so that it sees what came meanwhile. More time must be as good.
    """
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        yield
    yield


class Stopwatch:
    """Seconds since it was made, for bounds that a slow machine makes wider: what takes at least so long, or what
    comes at most once a second."""

    def __init__(self) -> None:
        self._began = time.monotonic()

    @property
    def seconds(self) -> float:
        return time.monotonic() - self._began
