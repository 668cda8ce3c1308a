"""The check of waiting refuses the right code, and only that."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.architecture.waiting_rules import EXCEPTIONS, TESTS, all_problems, problems


def test_the_tests_keep_to_it_and_each_exception_is_there() -> None:
    assert all_problems() == []
    assert [name for name in EXCEPTIONS if not Path(TESTS, name.partition("::")[0]).exists()] == []


@pytest.mark.parametrize(
    "body",
    [
        "time.sleep(0.1)",
        "assert time.monotonic() < 5",
        "end = time.monotonic() + 5\n    while time.monotonic() < end: pass",
        "now, count = time.time(), 0\n    assert count < now",
        "began = time.process_time()\n    work()\n    took = time.process_time() - began\n    assert took < 2",
        "assert (spent := time.perf_counter() - before) < 1",
        "began = time.monotonic()\n    assert abs(began - link.t) < 1",
        "began = time.monotonic()\n    def inner():\n        return began > 3",
    ],
)
def test_this_is_refused(body: str) -> None:
    found = problems("test_it.py", f"import time\ndef test_it():\n    {body}\n")
    assert found
    assert all(one.startswith("tests/test_it.py:") for one in found)
    assert problems("test_it.py", f"import time\n@pytest.mark.timed(tolerance=0.1)\ndef test_it():\n    {body}\n") == []


@pytest.mark.parametrize(
    "body",
    [
        "mcu = VirtualMcu(codec, time.monotonic())\n    assert mcu.feed(data, time.monotonic()) == 3",
        "assert first.t < second.t",
        "wait_until(lambda: link.state == 'up')",
        'program = "time.sleep(60)"',
    ],
)
def test_this_passes(body: str) -> None:
    assert problems("test_it.py", f"import time\ndef test_it():\n    {body}\n") == []
