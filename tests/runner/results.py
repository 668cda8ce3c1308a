"""The results of a run in a file, and its progress on the terminal: a plugin of pytest for `python -m tests.runner`."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.runner.kinds import STALL, TOLERANCE
from tests.runner.limit import LEFT_OUT

EVERY = 15.0  # seconds between two lines of progress


@dataclass
class Result:
    """The result of one test. Times in seconds."""

    name: str
    has_passed: bool = True  # or was skipped
    is_skipped: bool = False
    is_left_out: bool = False  # for lack of time
    seconds: float = 0.0
    stall: float = 0.0  # of the machine; only for timed tests
    tolerance: float = 0.0  # the stall that the test tolerates

    def add(self, report: pytest.TestReport) -> None:
        """One of the parts of the test: set-up, call, teardown."""
        self.seconds += report.duration
        self.has_passed &= not report.failed
        self.is_skipped |= report.skipped
        properties = dict(report.user_properties)
        self.is_left_out |= LEFT_OUT in properties
        self.stall = float(properties.get(STALL, self.stall))  # type: ignore[arg-type]
        self.tolerance = float(properties.get(TOLERANCE, self.tolerance))  # type: ignore[arg-type]


def read_results(path: Path) -> list[Result]:
    return [Result(**one) for one in json.loads(path.read_text())]


def write_results(path: Path, results: list[Result]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps([asdict(one) for one in results]))


def of_last_run(path: Path) -> Path:
    """Return the path of the results of the last run."""
    return path.with_suffix(".before.json")


class TimeLeft:
    """Estimates how long a run takes from here: by what each test took in the last run, else by the number of tests.

    :param before: results of the last run; empty: it is not known.
    """

    def __init__(self, before: list[Result]) -> None:
        self._usual = {one.name: one.seconds for one in before}
        self._each = sum(self._usual.values()) / len(before) if before else 1.0  # for tests that are new

    def says(self, finished: Iterable[str], every: Iterable[str], elapsed: float) -> str:
        """:param finished: names of tests, as well as ``every``.
        :param elapsed: seconds that the finished ones took, however many ran at once.
        """
        done = sum(self._usual.get(name, self._each) for name in finished)
        if done == 0.0:
            return "it is not known yet how long the rest takes"
        left = elapsed / done * (sum(self._usual.get(name, self._each) for name in every) - done)
        return f"about {max(left, 0.0):.0f} s left" + ("" if self._usual else " if all tests were alike")


class Watch:
    """Watches the process that collects all results."""

    def __init__(self, path: Path, terminal: Any) -> None:
        self._path, self._terminal = path, terminal
        before = of_last_run(path)
        self._left = TimeLeft(read_results(before) if before.exists() else [])
        self._tests: dict[str, Result] = {}
        self._every: list[str] = []
        self._finished: list[str] = []
        self._failed = 0
        self._began = self._told = 0.0

    def pytest_runtest_logstart(self) -> None:
        if self._began == 0.0:
            self._began = self._told = time.monotonic()

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        self._every = [item.nodeid for item in session.items]

    def pytest_xdist_node_collection_finished(self, ids: list[str]) -> None:
        self._every = ids

    def pytest_report_teststatus(self, report: Any) -> tuple[str, str, str] | None:
        """No letters: the lines of progress say more."""
        return (report.outcome, "", "") if report.when == "call" or not report.passed else None

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        result = self._tests.setdefault(report.nodeid, Result(report.nodeid))
        result.add(report)
        if report.failed:
            self._tell(f"FAILED {report.nodeid}")
        if report.when == "teardown":
            self._finished.append(report.nodeid)
            self._failed += not result.has_passed
            if time.monotonic() - self._told >= EVERY:
                self._tell_progress()

    def pytest_sessionfinish(self) -> None:
        """Leave out the tests under way in an interrupted run: they have neither passed nor failed."""
        ended = set(self._finished)
        write_results(self._path, [one for one in self._tests.values() if one.name in ended or not one.has_passed])

    def _tell_progress(self) -> None:
        self._told = now = time.monotonic()
        left = self._left.says(self._finished, self._every, now - self._began)
        failed = f", {self._failed} failed" if self._failed else ""
        count, total = len(self._finished), len(self._every)
        self._tell(f"{100 * count // max(total, 1):3d} %: {count} of {total}{failed}; {left}")

    def _tell(self, line: str) -> None:
        self._terminal.ensure_newline()
        self._terminal.write_line(line)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--results", type=Path, help="file for the results; also shows the progress in lines")


@pytest.hookimpl(trylast=True)
def pytest_configure(config: pytest.Config) -> None:
    path = config.getoption("--results")
    if path is not None and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Watch(path, config.pluginmanager.getplugin("terminalreporter")))
