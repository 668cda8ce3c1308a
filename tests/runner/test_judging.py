"""The run's judgement of a timed test that failed."""

from __future__ import annotations

from tests.runner.__main__ import MOST_REPEATS, Verdicts, judge
from tests.runner.results import Result

NAME = "tests/test_lease.py::test_it_ends"


def result(has_passed: bool, stall: float) -> Result:
    return Result(NAME, has_passed=has_passed, stall=stall, tolerance=0.05)


def verdicts_of(*results: Result) -> tuple[Verdicts, int]:
    """Return the verdicts on a test with these outcomes, one after the other, and how many outcomes were used."""
    left, found = list(results), Verdicts()
    judge(left.pop(0), lambda _: left.pop(0), found)
    return found, len(results) - len(left)


def test_one_that_passed_shows_nothing_whatever_the_machine_did() -> None:
    assert verdicts_of(result(has_passed=True, stall=2.0)) == (Verdicts(), 1)


def test_a_failure_on_a_calm_machine_is_one_at_once() -> None:
    calm = result(has_passed=False, stall=0.04)
    assert verdicts_of(calm, calm) == (Verdicts(failed=[NAME]), 1)


def test_a_failure_in_a_stall_is_repeated_until_the_machine_is_calm() -> None:
    stalled = result(has_passed=False, stall=2.0)
    assert verdicts_of(stalled, result(has_passed=True, stall=0.0)) == (Verdicts(calm=[NAME]), 2)
    assert verdicts_of(stalled, stalled, result(has_passed=False, stall=0.01)) == (Verdicts(failed=[NAME]), 3)


def test_a_machine_that_is_never_calm_judges_nothing() -> None:
    stalled = [result(has_passed=False, stall=stall) for stall in (2.0, 0.3, 0.2, 0.4, 9.0)]
    assert verdicts_of(*stalled) == (Verdicts(unjudged={NAME: 0.2}), 1 + MOST_REPEATS)
