"""Processes of a run are suspended one at a time, and all go on afterwards."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.processes import below
from tests.runner.pauses import pause
from tests.shared import ROOT
from tests.waiting import PATIENCE, wait_until

pytestmark = pytest.mark.live

WITH_A_CHILD = "import subprocess, sys; subprocess.run([sys.executable, '-c', 'print(1, flush=True); input()'])"


def state(process: int) -> str:
    return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]


def test_a_process_below_is_found_suspended_and_continued() -> None:
    command = [sys.executable, "-c", WITH_A_CHILD]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "1\n"
        (child,) = below(process.pid)
        pause(child, lambda: wait_until(lambda: state(child) == "T", "it stops"))
        wait_until(lambda: state(child) != "T", "it goes on")
        process.communicate("\n")
    assert process.returncode == 0
    pause(child, lambda: pytest.fail("it has ended"))


def test_the_exit_code_is_the_commands() -> None:
    command = [sys.executable, "-m", "tests.runner.pauses", "--longest", "0.01"]
    program = [sys.executable, "-c", "import sys, subprocess; subprocess.run([sys.executable, '-c', '']); sys.exit(3)"]
    done = subprocess.run([*command, *program], cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == 3
    assert done.stdout.endswith(" pauses\n")
    none = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert none.returncode == 2 and "a command is missing" in none.stderr
