"""The unit tests of the simulator's C++ headers, built and run with sanitizers."""

from __future__ import annotations

import subprocess

import pytest
from tests.compilers import CMAKE
from tests.shared import ROOT

pytestmark = pytest.mark.live

BUILD = ROOT / "build" / "sim"


def test_unit_tests_pass() -> None:
    _run(["cmake", "-S", str(ROOT / "sim"), "-B", str(BUILD), "-G", "Ninja", *CMAKE])
    _run(["cmake", "--build", str(BUILD)])
    _run([str(BUILD / "sim_tests"), "--no-version"])


def _run(command: list[str]) -> None:
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout[-4000:] + result.stderr[-4000:]
