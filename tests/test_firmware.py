"""The firmwares without their boards, as a firmware engineer would test them on a desk."""

from __future__ import annotations

from pathlib import Path

import pytest

import wirebond
from tests.compilers import CXX
from tests.conformance.build import run
from tests.shared import PROTOCOLS, ROOT
from wirebond.generate.code import generate_cpp

pytestmark = pytest.mark.live

FIRMWARE = ROOT / "firmware"
FLAGS = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-Wshadow", "-Wconversion", "-O0"]


@pytest.mark.parametrize(("firmware", "protocol"), [("balance", "pid_tuner")])
def test_firmware_behaves_on_a_simulated_board(firmware: str, protocol: str, tmp_path: Path) -> None:
    generate_cpp(wirebond.load(PROTOCOLS / f"{protocol}.yaml").model, tmp_path)
    program = tmp_path / "program"
    test = str(FIRMWARE / "tests" / f"{firmware}_test.cpp")
    includes = [f"-I{tmp_path}", f"-I{FIRMWARE / firmware}", f"-I{ROOT / 'ports' / 'fake' / 'include'}"]
    run([CXX, *FLAGS, *includes, test, "-DDOCTEST_CONFIG_IMPLEMENT_WITH_MAIN", "-o", str(program)])
    run([str(program), "--no-version"])
