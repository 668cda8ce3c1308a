"""The unit tests of the core headers, built as a firmware engineer would build them and run."""

from __future__ import annotations

import subprocess

from tests.shared import ROOT


def test_core_unit_tests_pass() -> None:
    build = ROOT / "build" / "core"
    _run(["cmake", "-S", str(ROOT / "core"), "-B", str(build), "-G", "Ninja"])
    _run(["cmake", "--build", str(build)])
    _run([str(build / "core_tests"), "--no-version"])


def _run(command: list[str]) -> None:
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout[-4000:] + result.stderr[-4000:]
