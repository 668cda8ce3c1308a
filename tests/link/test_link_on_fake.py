"""Link on the simulated UART: bad lines, laps, restarts, mishaps of all kinds, deadlines; every byte accounted for."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest
from tests.shared import PROTOCOLS, ROOT

from wirebond.codegen import generate_cpp
from wirebond.protocol.loader import load

BUILD = ROOT / "build" / "link"


@pytest.fixture(scope="module")
def program() -> Path:
    generated = BUILD / "generated"
    for name in ("diffdrive", "enterprize", "native"):
        generate_cpp(load(PROTOCOLS / f"{name}.yaml"), generated)
    source = str(ROOT / "tests" / "link" / "fake")
    _run(["cmake", "-S", source, "-B", str(BUILD), "-G", "Ninja", f"-DWIREBOND_GENERATED={generated}"])
    _run(["cmake", "--build", str(BUILD)])
    return BUILD / "link_tests"


def test_link_keeps_its_promises_on_a_bad_uart(program: Path) -> None:
    _run([str(program), "--no-version"])


@pytest.mark.long
def test_link_keeps_its_promises_on_a_bad_uart_for_long(program: Path) -> None:
    _run([str(program), "--no-version"], {"WIREBOND_LONG": "1"})


def _run(command: list[str], more: dict[str, str] | None = None) -> None:
    result = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, **(more or {})})
    assert result.returncode == 0, result.stdout[-4000:] + result.stderr[-4000:]
