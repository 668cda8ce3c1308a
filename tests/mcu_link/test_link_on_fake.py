"""Link on the simulated UART: bad lines, laps, restarts, mishaps of all kinds, deadlines; every byte accounted for."""

from __future__ import annotations

import os
import subprocess

import pytest
from tests.compilers import CMAKE
from tests.shared import PROTOCOLS, ROOT

from wirebond.generate.code import generate_cpp
from wirebond.protocol.loader import load

pytestmark = pytest.mark.live


def build(sanitize: bool) -> str:
    """The tests' program; with sanitizers its compilation takes minutes."""
    folder = ROOT / "build" / ("mcu_link-sanitized" if sanitize else "mcu_link")
    for name in ("diffdrive", "enterprize", "native"):
        generate_cpp(load(PROTOCOLS / f"{name}.yaml"), folder / "generated")
    options = [f"-DWIREBOND_GENERATED={folder / 'generated'}", f"-DWIREBOND_SANITIZE={'ON' if sanitize else 'OFF'}"]
    source = str(ROOT / "tests" / "mcu_link" / "fake")
    options += [] if sanitize else CMAKE
    _run(["cmake", "-S", source, "-B", str(folder), "-G", "Ninja", *options])
    _run(["cmake", "--build", str(folder)])
    return str(folder / "link_tests")


def test_link_keeps_its_promises_on_a_bad_uart() -> None:
    _run([build(sanitize=False), "--no-version"])


@pytest.mark.long
def test_link_keeps_its_promises_on_a_bad_uart_for_long() -> None:
    _run([build(sanitize=True), "--no-version"], {"WIREBOND_LONG": "1"})


def _run(command: list[str], more: dict[str, str] | None = None) -> None:
    result = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **(more or {})})
    assert result.returncode == 0, result.stdout[-4000:] + result.stderr[-4000:]
