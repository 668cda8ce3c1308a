"""The send queue under proof: a list model, interrupts at every step, a model checker, threads under a sanitizer.

What the model checker searches, of two senders with two frames each:

- whole, every schedule and every value that a load may see: the senders against each other, with room for all of their
  frames, one of them giving back what it does not need, and the consumer when both are done;
- every schedule with at most one preemption: the same with the consumer beside them, and room for two frames;
- every schedule with at most two preemptions: one frame from each, with the consumer;
- drawn at random: four frames from each, with the consumer, room and entries used again and again.

Not searched whole is the consumer beside two senders: that search has not ended within anybody's patience.
"""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.concurrency.build import HERE, RELACY, SANITIZE, THREAD_SANITIZE, build, stress

pytestmark = pytest.mark.live

SITES = ("opens", "closes", "looks", "frees", "finds", "gives_back", "takes")
MAIN = "../../core/tests/main.cpp"


@pytest.fixture(scope="module")
def scripted() -> Path:
    return build("scripted", (MAIN, "model_test.cpp", "interleaving_test.cpp"), SANITIZE)


@pytest.fixture(scope="module")
def relacy() -> Path:
    return build("relacy_queue", ("relacy_queue.cpp",), (), RELACY)


@pytest.fixture(scope="module")
def watched_threads() -> Path:
    return stress(THREAD_SANITIZE, "stress_watched")


def run(program: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([str(program), *arguments], capture_output=True, text=True, check=False)


def test_the_outbox_is_a_list_and_no_interrupt_harms_it(scripted: Path) -> None:
    result = run(scripted, "--no-version")
    assert result.returncode == 0, result.stdout[-4000:] + result.stderr[-4000:]


@pytest.mark.long
def test_no_interrupt_harms_it_three_deep(scripted: Path) -> None:
    result = run(scripted, "--no-version", "--no-skip", "--test-case=*three deep*")
    assert result.returncode == 0, result.stdout[-4000:] + result.stderr[-4000:]


def test_the_memory_orders_are_the_ones_that_are_weakened_below() -> None:
    header = (HERE.parents[1] / "core/include/wirebond/mcu/send_queue.hpp").read_text()
    assert tuple(re.findall(r"std::memory_order (\w+) = ", header)) == SITES


def test_the_model_checker_finds_no_fault(relacy: Path) -> None:
    result = run(relacy, "circling", "none", "random", "30000")
    assert result.returncode == 0, result.stdout
    assert "no fault after 30000 executions" in result.stdout


def test_the_model_checker_finds_numbers_in_the_order_of_the_wire(relacy: Path) -> None:
    """The consumer writes into frames that it passes on, while senders write behind and before them."""
    result = run(relacy, "numbered", "none", "random", "30000")
    assert result.returncode == 0, result.stdout


@pytest.mark.long
@pytest.mark.parametrize("scene", ["circling", "numbered"])
def test_the_model_checker_finds_no_fault_in_two_million_executions(relacy: Path, scene: str) -> None:
    result = run(relacy, scene, "none", "random", "2000000")
    assert result.returncode == 0, result.stdout


@pytest.mark.long
def test_every_schedule_of_two_senders_with_two_frames_each_is_good(relacy: Path) -> None:
    result = run(relacy, "alone", "none", "whole", "0")
    executions = re.fullmatch(r"no fault after (\d+) executions\n", result.stdout)
    assert result.returncode == 0 and executions, result.stdout
    assert int(executions[1]) > 1_000_000


@pytest.mark.parametrize("site", ["gives_back", "takes"])
def test_the_whole_search_finds_the_weakened_orders_between_senders(relacy: Path, site: str) -> None:
    result = run(relacy, "alone", site, "whole", "0")
    assert result.returncode == 1 and "DATA RACE" in result.stdout, result.stdout


@pytest.mark.long
@pytest.mark.parametrize(("scene", "preemptions"), [("passing", 2), ("pairs", 1)])
def test_every_schedule_with_few_preemptions_is_good(relacy: Path, scene: str, preemptions: int) -> None:
    """And every value that a load may see in it: one or two frames from each of two senders, and the consumer."""
    result = run(relacy, scene, "none", "bound", str(preemptions))
    assert result.returncode == 0, result.stdout


@pytest.mark.parametrize("site", SITES)
def test_the_model_checker_finds_each_weakened_memory_order(relacy: Path, site: str) -> None:
    """A test of the test, and of the header: no order stands there in vain."""
    result = run(relacy, "circling", site, "random", "30000")
    assert result.returncode == 1, result.stdout + result.stderr
    assert re.search(r"DATA RACE|USER ASSERT FAILED", result.stdout), result.stdout


@pytest.mark.parametrize("kind", ["outbox", "mixed"])
@pytest.mark.parametrize("senders", [1, 2, 4, 8])
def test_threads_lose_no_frame_and_race_for_no_byte(watched_threads: Path, kind: str, senders: int) -> None:
    verify_threads(watched_threads, kind, senders, 24_000)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["outbox", "mixed"])
@pytest.mark.parametrize("senders", [1, 2, 4, 8])
def test_threads_lose_no_frame_of_a_million(watched_threads: Path, kind: str, senders: int) -> None:
    verify_threads(watched_threads, kind, senders, 1_000_000)


def verify_threads(program: Path, kind: str, senders: int, frames: int) -> None:
    result = run(program, kind, str(senders), str(frames))
    assert result.returncode == 0, result.stdout + result.stderr[-4000:]
    told: dict[str, Any] = json.loads(result.stdout)
    assert told["lost"] == 0
    assert told["balances"]
    assert told["accepted"] > frames / 4
    if kind == "outbox":
        assert told["accepted"] == frames
