"""The unit tests of the ports, built and run with sanitizers: the UART for tests, and each port on it.

The port for STM32 also runs on the vendor's own drivers, where STM32_HAL_PATH names them.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from tests.compilers import CMAKE
from tests.shared import ROOT

pytestmark = pytest.mark.live

HAL = Path(os.environ.get("STM32_HAL_PATH", "/nonexistent"))
TESTED = {test.parents[1].name for test in (ROOT / "ports").glob("*/tests/*_test.cpp")}
PORTS = [*sorted(TESTED), "stm32_hal_registered"]


@pytest.fixture(scope="module", params=["-O0", pytest.param("-O1", marks=pytest.mark.long)])
def build(request: pytest.FixtureRequest) -> Path:
    folder = ROOT / "build" / f"ports{request.param}"
    options = [f"-DWIREBOND_OPTIMISE={request.param}", f"-DSTM32_HAL_PATH={HAL if HAL.is_dir() else ''}"]
    options += CMAKE if request.param == "-O0" else []
    _run(["cmake", "-S", str(ROOT / "ports"), "-B", str(folder), "-G", "Ninja", *options])
    return folder


@pytest.mark.parametrize("port", PORTS)
def test_unit_tests_pass(port: str, build: Path) -> None:
    _run(["cmake", "--build", str(build), "--target", f"{port}_tests"])
    _run([str(build / f"{port}_tests"), "--no-version"])


@pytest.mark.skipif(not HAL.is_dir(), reason="STM32_HAL_PATH names no folder with the vendor's HAL")
def test_port_for_stm32_works_on_the_vendors_own_drivers(build: Path) -> None:
    drivers = "Drivers/STM32F4xx_HAL_Driver"
    if not [*HAL.glob(drivers), *HAL.glob(f"*/{drivers}")]:
        pytest.skip("STM32_HAL_PATH has no HAL of the F4")
    test_unit_tests_pass("stm32_hal_vendor", build)


def _run(command: list[str]) -> None:
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout[-4000:] + result.stderr[-4000:]
