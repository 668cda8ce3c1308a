"""The unit tests of the ports, built and run with sanitizers: the UART for tests, and each port on it."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.shared import ROOT

BUILD = ROOT / "build" / "ports"
PORTS = ["fake", "bare_metal", "freertos", "gd32_spl", "posix", "stm32_hal", "stm32_hal_registered"]


@pytest.fixture(scope="module")
def build() -> Path:
    _run(["cmake", "-S", str(ROOT / "ports"), "-B", str(BUILD), "-G", "Ninja"])
    return BUILD


@pytest.mark.parametrize("port", PORTS)
def test_unit_tests_pass(port: str, build: Path) -> None:
    _run(["cmake", "--build", str(build), "--target", f"{port}_tests"])
    _run([str(build / f"{port}_tests"), "--no-version"])


def _run(command: list[str]) -> None:
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout[-4000:] + result.stderr[-4000:]
