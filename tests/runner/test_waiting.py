"""The report of a wait in vain."""

from __future__ import annotations

import subprocess
import sys
import threading

import pytest

from tests.waiting import moments, wait_until

pytestmark = pytest.mark.live


def test_a_wait_in_vain_says_what_did_not_come_and_what_all_processes_do() -> None:
    program = "def waits_for_a_word():\n    print('ready', flush=True)\n    input()\nwaits_for_a_word()"
    command = [sys.executable, "-c", program]
    ends = threading.Event()

    def waits_for_the_end() -> None:
        ends.wait()

    thread = threading.Thread(target=waits_for_the_end, name="helper")
    thread.start()
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        with pytest.raises(AssertionError, match=r"waited 0.05 s in vain: the answer \(3 came\)") as caught:
            wait_until(lambda: False, lambda: f"the answer ({1 + 2} came)", bound=0.05)
        process.communicate("word")
    ends.set()
    thread.join()
    (note,) = caught.value.__notes__
    assert "thread helper of the test" in note
    assert "waits_for_the_end" in note
    assert f"process {process.pid} (S" in note
    assert "waits_for_a_word (<string>:3)" in note  # its Python stack


def test_a_wait_checks_once_more_after_its_bound() -> None:
    """A machine that was suspended beyond the bound is no reason to fail."""
    looks = 0
    for _ in moments("it", bound=0.0):
        looks += 1
        if looks == 1:
            break
    assert looks == 1
