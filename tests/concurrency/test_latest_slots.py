"""The slots of `latest` messages under a model checker: two writers that replace each other's frames, one consumer.

Searched whole (in `make prove`), every schedule and every value that a load may see: one frame from each writer while
the consumer looks once. Beyond that, with cells used again, given back and expired, schedules are drawn at random.
"""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from tests.concurrency.build import HERE, RELACY, build

pytestmark = pytest.mark.live

SITES = ("takes", "commits", "abandons", "sends", "frees")


@pytest.fixture(scope="module")
def relacy() -> Path:
    return build("relacy_slots", ("relacy_slots.cpp",), (), RELACY)


def run(program: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(program), *arguments], capture_output=True, text=True, check=False)


def test_the_memory_orders_are_the_ones_that_are_weakened_below() -> None:
    header = (HERE.parents[1] / "core/include/wirebond/mcu/latest_slots.hpp").read_text()
    assert tuple(re.findall(r"std::memory_order (\w+) = ", header)) == SITES


@pytest.mark.long
def test_no_schedule_of_one_frame_from_each_writer_is_bad(relacy: Path) -> None:
    result = run(relacy, "meeting", "none", "full", "0")
    assert result.returncode == 0, result.stdout
    executions = re.fullmatch(r"no fault after (\d+) executions\n", result.stdout)
    assert executions and int(executions[1]) > 1_000_000


def test_no_frame_is_torn_or_older_than_one_before_it(relacy: Path) -> None:
    result = run(relacy, "replacing", "none", "random", "50000")
    assert result.returncode == 0, result.stdout
    assert "no fault after 50000 executions" in result.stdout


@pytest.mark.long
def test_no_frame_of_ten_million_executions_is_torn(relacy: Path) -> None:
    result = run(relacy, "replacing", "none", "random", "10000000")
    assert result.returncode == 0, result.stdout


@pytest.mark.parametrize("site", SITES)
def test_the_model_checker_finds_each_weakened_memory_order(relacy: Path, site: str) -> None:
    """A test of the test, and of the header: no order stands there in vain."""
    result = run(relacy, "replacing", site, "random", "50000")
    assert result.returncode == 1, result.stdout + result.stderr
    assert re.search(r"DATA RACE|USER ASSERT FAILED", result.stdout), result.stdout
