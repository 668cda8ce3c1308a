"""Requests that several threads send at once, while another one receives the replies: no address is lost."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.concurrency.build import PLAIN, THREAD_SANITIZE, build
from tests.shared import PROTOCOLS
from wirebond.generate.code import generate_cpp
from wirebond.protocol.loader import load

pytestmark = pytest.mark.live


@pytest.mark.parametrize(
    ("name", "flags"),
    [("plain", PLAIN), ("watched", (*THREAD_SANITIZE, "-Wno-tsan"))],  # it does not know fences; here all is atomic
)
def test_threads_ask_while_one_receives(name: str, flags: tuple[str, ...], tmp_path: Path) -> None:
    generate_cpp(load(PROTOCOLS / "servo_bus.yaml"), tmp_path)
    program = build(f"asked_{name}", ("asked_addresses.cpp",), (*flags, f"-I{tmp_path}"))
    result = subprocess.run([str(program)], capture_output=True, text=True, timeout=300, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
