"""The unit tests of the core headers, for this machine and for a 64-bit ARM computer such as a Raspberry Pi."""

from __future__ import annotations

import subprocess

import pytest

from tests.compilers import CMAKE
from tests.shared import ROOT

pytestmark = pytest.mark.live

SYSTEM = "/usr/aarch64-linux-gnu"  # the C library of the cross compiler

optimised = pytest.mark.parametrize("level", ["-O0", pytest.param("-O2", marks=pytest.mark.long)])


@optimised
def test_core_unit_tests_pass(level: str) -> None:
    build = ROOT / "build" / f"core{level}"
    options = [f"-DWIREBOND_OPTIMISE={level}", *(CMAKE if level == "-O0" else [])]
    _run(["cmake", "-S", str(ROOT / "core"), "-B", str(build), "-G", "Ninja", *options])
    _run(["cmake", "--build", str(build)])
    _run([str(build / "core_tests"), "--no-version"])


@optimised
def test_core_unit_tests_pass_on_aarch64_with_its_carry_less_crc(level: str) -> None:
    """The processor is emulated. The tests themselves refuse a build whose CRCs take another way. `make test` builds
    those of checks and of the encoder."""
    build = ROOT / "build" / f"core-aarch64{level}"
    options = [
        f"-DWIREBOND_OPTIMISE={level}",
        "-DCMAKE_CXX_COMPILER=aarch64-linux-gnu-g++",
        "-DCMAKE_CXX_FLAGS=-march=armv8-a+crypto -DWIREBOND_EXPECTS_CARRYLESS",
        f"-DWIREBOND_ONLY={'check_test;encoder_test' if level == '-O0' else ''}",
    ]
    _run(["cmake", "-S", str(ROOT / "core"), "-B", str(build), "-G", "Ninja", *options])
    _run(["cmake", "--build", str(build)])
    _run(["qemu-aarch64", "-L", SYSTEM, str(build / "core_tests"), "--no-version"])


def _run(command: list[str]) -> None:
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout[-4000:] + result.stderr[-4000:]
