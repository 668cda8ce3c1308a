"""The handshake of senders, poll and the UART's interrupt: a model checker, and two threads that meet for real.

Searched with at most two preemptions, and every value that a load may see: one frame from each of two senders, and the
interrupt. Beyond that, with a poll that asks for restarts and gives runs up, and a port that refuses some, schedules
are drawn at random. `tests/mcu_link/handshake_test.cpp` has the table line by line.
"""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path

import pytest

from tests.concurrency.build import BUILD, HERE, PLAIN, RELACY, build
from tests.shared import ROOT
from wirebond.generate.code import generate_cpp
from wirebond.protocol.loader import load

pytestmark = pytest.mark.live

SITES = ("offers", "takes", "rests")


@pytest.fixture(scope="module")
def relacy() -> Path:
    return build("relacy_handshake", ("relacy_handshake.cpp",), (), RELACY)


def run(program: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(program), *arguments], capture_output=True, text=True, check=False)


def test_the_memory_orders_are_the_ones_that_are_weakened_below() -> None:
    header = (HERE.parents[1] / "core/include/wirebond/mcu/handshake.hpp").read_text()
    assert tuple(re.findall(r"std::memory_order (\w+) = ", header)) == SITES


def test_no_frame_is_left_and_no_other_run_is_aborted(relacy: Path) -> None:
    result = run(relacy, "crowd", "none", "random", "30000")
    assert result.returncode == 0, result.stdout
    assert "no fault after 30000 executions" in result.stdout


def test_every_schedule_of_one_frame_from_each_sender_with_two_preemptions_is_good(relacy: Path) -> None:
    result = run(relacy, "meeting", "none", "bound", "2")
    assert result.returncode == 0, result.stdout
    executions = re.fullmatch(r"no fault after (\d+) executions\n", result.stdout)
    assert executions and int(executions[1]) > 500_000


@pytest.mark.long
def test_no_frame_is_left_in_ten_million_executions(relacy: Path) -> None:
    result = run(relacy, "crowd", "none", "random", "10000000")
    assert result.returncode == 0, result.stdout


@pytest.mark.parametrize("site", SITES)
def test_the_model_checker_finds_each_weakened_memory_order(relacy: Path, site: str) -> None:
    """A test of the test, and of the header: no order stands there in vain."""
    result = run(relacy, "crowd", site, "random", "200000")
    assert result.returncode == 1, result.stdout + result.stderr
    assert "USER ASSERT FAILED" in result.stdout, result.stdout


@pytest.mark.parametrize("rounds", [100_000, pytest.param(10_000_000, marks=pytest.mark.long)])
def test_two_threads_lose_no_wake_up(rounds: int) -> None:
    generated = BUILD / "generated"
    generate_cpp(load(ROOT / "tests" / "mcu_link" / "aging.yaml"), generated)
    program = build("wakeups", ("wakeups.cpp",), (*PLAIN, f"-I{generated}"))
    result = run(program, str(rounds))
    assert result.returncode == 0, result.stdout + result.stderr
    assert json.loads(result.stdout) == {"rounds": rounds, "lost": 0}
