"""The messages of a run about its remaining time."""

from __future__ import annotations

from pathlib import Path

from tests.runner.results import Result, TimeLeft, of_last_run, read_results, write_results

EVERY = ["a", "b", "c", "d"]


def test_at_first_all_tests_count_alike_and_it_says_so() -> None:
    left = TimeLeft([])
    assert left.says(["a"], EVERY, 10.0) == "about 30 s left if all tests were alike"
    assert left.says([], EVERY, 10.0) == "it is not known yet how long the rest takes"


def test_later_each_counts_as_long_as_it_took_before() -> None:
    left = TimeLeft([Result("a", seconds=1.0), Result("b", seconds=4.0), Result("c", seconds=4.0)])
    assert left.says(["a"], ["a", "b", "c"], 2.0) == "about 16 s left"
    assert left.says(["a", "b"], ["a", "b", "c"], 10.0) == "about 8 s left"
    assert left.says(["a"], EVERY, 1.0) == "about 11 s left"  # d is new: 3 s, as long as the others on average


def test_the_times_of_the_last_run_are_kept_beside_those_of_this_one(tmp_path: Path) -> None:
    path = tmp_path / "results.json"
    write_results(path, [Result("a", seconds=1.0)])
    path.replace(of_last_run(path))
    assert read_results(of_last_run(path)) == [Result("a", seconds=1.0)]
