"""Long work of the server runs in its own process, within a time and a memory; the views go on."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

from tests.console.conftest import Desk, view
from tests.waiting import PATIENCE
from wirebond.console.jobs import JobError, Worker, protocol_files
from wirebond.console.jobs.protocol_files import codec_of
from wirebond.errors import ProtocolFileError

pytestmark = pytest.mark.live


@pytest.fixture(scope="module")
def worker() -> Iterator[Worker]:
    made = Worker(seconds=1)
    yield made
    made.close()


def test_views_go_on_and_the_server_s_process_has_little_to_do_while_the_lint_measures(
    desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    def lint_here(*_: Any) -> None:
        raise AssertionError("the lint runs in the server's process")

    monkeypatch.setattr(protocol_files, "lint", lint_here)
    answers: list[Any] = []
    thread = threading.Thread(target=lambda: answers.append(desk.ask("/api/lint")))
    with desk.look(messages={"every": 0.05}) as socket:
        view(socket, "messages")
        rounds = 0
        thread.start()
        while thread.is_alive():
            rounds += 1
            desk.send("odometry", left_ticks=rounds, right_ticks=rounds)
            view(
                socket,
                "messages",
                lambda said, n=rounds: any(r["fields"]["left_ticks"] == n for r in said["rows"] if "fields" in r),
            )
    assert answers[0][0] == 200 and answers[0][1]["findings"]
    assert rounds >= 2


def test_a_job_that_takes_too_long_is_given_up_and_the_next_one_is_done(worker: Worker) -> None:
    with pytest.raises(JobError, match="more than 1 s"):
        worker.run(time.sleep, 60)
    assert worker.run(len, "abc") == 3


def test_a_job_that_needs_too_much_memory_is_given_up(worker: Worker) -> None:
    with pytest.raises(JobError, match="memory"):
        worker.run(bytes, 1 << 33)
    with pytest.raises(JobError, match="ended before it was done"):
        worker.run(os.abort)
    assert worker.run(len, "abc") == 3


def test_an_exception_of_a_job_is_raised_with_its_places(worker: Worker) -> None:
    with pytest.raises(ProtocolFileError) as found:
        worker.run(codec_of, "wirebond: 1\nprotocol: 3\n")
    assert 2 in {problem.line for problem in found.value.problems}


def test_a_worker_that_is_closed_ends_its_job_and_does_no_other() -> None:
    worker = Worker()
    assert worker.run(len, "abc") == 3
    closing = threading.Timer(0.1, worker.close)
    closing.start()
    with pytest.raises(JobError):
        worker.run(time.sleep, 25)
    closing.join(PATIENCE)
    with pytest.raises(JobError, match="closed"):
        worker.run(len, "abc")
