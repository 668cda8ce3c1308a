"""Both USB ports under a link, on doubles of the vendors' classes: waits, short and empty packets, disconnects."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from tests.compilers import CXX
from tests.shared import PROTOCOLS, ROOT

from wirebond.generate.code import generate_cpp
from wirebond.protocol.loader import load

pytestmark = pytest.mark.live

FLAGS = ["-std=c++17", "-O0", "-Wall", "-Wextra", "-Werror", "-D_GLIBCXX_ASSERTIONS"]


def test_a_link_over_usb_loses_nothing_and_is_down_while_nobody_reads(tmp_path: Path) -> None:
    generate_cpp(load(PROTOCOLS / "diffdrive.yaml"), tmp_path)
    port = ROOT / "ports" / "usb_cdc"
    folders = [f"-I{folder}" for folder in (tmp_path, port / "include", port / "tests")]
    sources = [str(ROOT / "tests" / "mcu_link" / "usb" / "usb_test.cpp"), str(ROOT / "core" / "tests" / "main.cpp")]
    program = tmp_path / "usb_test"
    for command in ([CXX, *FLAGS, *folders, *sources, "-o", str(program)], [str(program), "--no-version"]):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
