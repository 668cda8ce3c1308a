"""A suspended process stands still, and what continues it before its time is noticed."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest

from tests.suspended import Suspended
from tests.waiting import wait_until

pytestmark = pytest.mark.live

COUNTS = """
n = 0
while True:
    n += 1
    print(n, flush=True)
    input()
"""


@pytest.fixture
def process() -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-c", COUNTS]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as started:
        assert started.stdout is not None
        assert started.stdout.readline() == "1\n"
        yield started
        started.kill()


def next_number(process: subprocess.Popen[str]) -> str:
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write("\n")
    process.stdin.flush()
    return process.stdout.readline()


def test_a_process_stops_and_goes_on_afterwards(process: subprocess.Popen[str]) -> None:
    with Suspended(process.pid) as pause:
        assert not pause.has_run
    assert not pause.has_run
    assert next_number(process) == "2\n"
    assert not pause.has_run


def test_one_that_something_else_continues_is_stopped_again_and_noticed(process: subprocess.Popen[str]) -> None:
    with Suspended(process.pid) as pause:

        def has_run() -> bool:
            os.kill(process.pid, signal.SIGCONT)
            return pause.has_run

        wait_until(has_run, "it runs for a moment")
        wait_until(lambda: set(pause.states()) == {"T"}, "it is stopped again")
    assert pause.has_run
    assert next_number(process) == "2\n"
