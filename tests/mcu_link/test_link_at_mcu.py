"""The MCU's end of a link, rule by rule, over generated code and with sanitizers."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from tests.compilers import CXX, SANITIZE
from tests.shared import PROTOCOLS, ROOT

from wirebond.generate.code import generate_cpp
from wirebond.protocol.loader import load

pytestmark = pytest.mark.live

FLAGS = ["-std=c++17", "-O0", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror"]
CALLS = ["-DWIREBOND_INLINE=inline", "-DWIREBOND_INLINE_LAMBDA="]  # else each check of the sanitizers is there often


def test_every_rule_of_the_link_holds(tmp_path: Path) -> None:
    for name in ("diffdrive", "native"):
        generate_cpp(load(PROTOCOLS / f"{name}.yaml"), tmp_path)
    for name in (
        "aging",
        "bus",
        "heard",
        "quiet",
        "peers",
        "tuned",
        "loose",
        "seeded",
        "seeded_blocks",
        "seeded_escaped",
        "held",
    ):
        generate_cpp(load(ROOT / "tests" / "mcu_link" / f"{name}.yaml"), tmp_path)
    for name in ("msp", "mavlink"):
        generate_cpp(load(PROTOCOLS / "contrib" / f"{name}.yaml"), tmp_path)
    generate_cpp(load(ROOT / "tests" / "generate" / "code" / "every_header.yaml"), tmp_path)
    program = tmp_path / "link_test"
    sources = [
        str(path) for path in (*(ROOT / "tests" / "mcu_link").glob("*_test.cpp"), ROOT / "core" / "tests" / "main.cpp")
    ]
    _run([CXX, *FLAGS, *SANITIZE, *CALLS, f"-I{tmp_path}", *sources, "-o", str(program)])
    _run([str(program), "--no-version"])


def _run(command: list[str]) -> None:
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout[-4000:] + result.stderr[-4000:]
