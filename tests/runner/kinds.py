"""The three kinds of tests, as a plugin of pytest; CONTRIBUTING.md says what they are and why.

A test without a marker is *pure*: it starts no process, opens no port or tty, and does not sleep. It fails if it does.
Tests marked `live` may do that. Tests marked `timed` may also assert durations; a meter of the machine's stalls runs
beside each.
"""

from __future__ import annotations

import functools
import os
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, ClassVar

import pytest

from tests.runner.stalls import Meter

TESTS = Path(__file__).resolve().parents[1]
_TTYS = ("/dev/pt", "/dev/tty")
_REFUSED = {  # in pure tests, by the audit events of Python
    "subprocess.Popen": "starts a process",
    "os.fork": "starts a process",
    "os.forkpty": "starts a process",
    "os.posix_spawn": "starts a process",
    "os.system": "starts a process",
    "socket.bind": "opens a port",
    "socket.connect": "opens a connection",
}
# Names of properties that the reports of timed tests have, both in seconds.
STALL = "stall"
TOLERANCE = "tolerance"


class _Pure:
    """The forbidden acts of the pure test that runs now."""

    test: pytest.Item | None = None
    done: ClassVar[list[str]] = []


def _audit(event: str, arguments: tuple[Any, ...]) -> None:
    if _Pure.test is None:
        return
    if event in _REFUSED:
        _Pure.done.append(f"{_REFUSED[event]} ({event}{arguments!r:.200})")
    elif event == "open" and isinstance(arguments[0], str) and arguments[0].startswith(_TTYS):
        _Pure.done.append(f"opens {arguments[0]}")


def _audited(what: str, function: Callable[..., Any]) -> Callable[..., Any]:
    """For functions without an audit event in the oldest Python that we run on."""

    @functools.wraps(function)
    def call(*arguments: Any) -> Any:
        if _Pure.test is not None:
            _Pure.done.append(what)
        return function(*arguments)

    return call


def pytest_configure(config: pytest.Config) -> None:
    sys.addaudithook(_audit)
    os.openpty = _audited("opens a pty", os.openpty)
    time.sleep = _audited("sleeps", time.sleep)
    config.pluginmanager.register(Stalls())


def is_timed(test: pytest.Item) -> bool:
    return test.get_closest_marker("timed") is not None


def tolerance(test: pytest.Item) -> float:
    """Seconds: a shorter stall cannot make this timed test fail."""
    marker = test.get_closest_marker("timed")
    assert marker is not None
    return float(marker.kwargs["tolerance"])


@functools.cache
def timed_files() -> list[Path]:
    """The files that have timed tests. The runner collects only these for its second part."""
    return [path for path in sorted(TESTS.rglob("test_*.py")) if "pytest.mark.timed(" in path.read_text("utf-8")]


def pytest_itemcollected(item: pytest.Item) -> None:
    if not is_timed(item):
        return
    if not 0.0 < tolerance(item) <= 0.5:
        raise pytest.UsageError(f"{item.nodeid}: write `timed(tolerance=SECONDS)` with at most 0.5 s")
    if TESTS in item.path.parents and item.path not in timed_files():
        raise pytest.UsageError(f"{item.nodeid}: write `pytest.mark.timed(tolerance=SECONDS)` in its file")


# ---- pure


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    if item.get_closest_marker("live") or is_timed(item):
        return (yield)
    _Pure.test, _Pure.done = item, []
    try:
        return (yield)
    finally:
        _Pure.test = None


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_teardown() -> Iterator[None]:
    """Fails the pure test that was not."""
    yield
    if _Pure.test is not None and _Pure.done:
        pytest.fail(f"a test that is not marked `live` {_Pure.done[0]}", pytrace=False)


# ---- timed


class Stalls:
    """The meter, from the first timed test on."""

    def __init__(self) -> None:
        self._meter: Meter | None = None

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> Iterator[None]:
        if is_timed(item):
            self._meter = self._meter or Meter()
            self._meter.begin()
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item: pytest.Item, call: pytest.CallInfo[None]) -> Iterator[None]:
        if is_timed(item) and self._meter is not None:
            stall = self._meter.stall()
            item.user_properties += [(STALL, stall), (TOLERANCE, tolerance(item))]
            if call.excinfo is not None:
                tolerated = f"the test tolerates {tolerance(item) * 1000:.0f} ms"
                item.add_report_section(
                    call.when, "machine", f"the machine stalled for {stall * 1000:.0f} ms; {tolerated}"
                )
        return (yield)

    def pytest_unconfigure(self) -> None:
        if self._meter is not None:
            self._meter.close()
