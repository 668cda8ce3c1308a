"""The unit tests of the core headers, for this machine and for a 64-bit ARM computer such as a Raspberry Pi."""

from __future__ import annotations

import subprocess

from tests.shared import ROOT

SYSTEM = "/usr/aarch64-linux-gnu"  # the C library of the cross compiler


def test_core_unit_tests_pass() -> None:
    build = ROOT / "build" / "core"
    _run(["cmake", "-S", str(ROOT / "core"), "-B", str(build), "-G", "Ninja"])
    _run(["cmake", "--build", str(build)])
    _run([str(build / "core_tests"), "--no-version"])


def test_core_unit_tests_pass_on_aarch64_with_its_carry_less_crc() -> None:
    """The processor is emulated. The tests themselves refuse a build whose CRCs take another way."""
    build = ROOT / "build" / "core-aarch64"
    flags = "-march=armv8-a+crypto -DWIREBOND_EXPECTS_CARRYLESS"
    compiler = "-DCMAKE_CXX_COMPILER=aarch64-linux-gnu-g++"
    _run(["cmake", "-S", str(ROOT / "core"), "-B", str(build), "-G", "Ninja", compiler, f"-DCMAKE_CXX_FLAGS={flags}"])
    _run(["cmake", "--build", str(build)])
    _run(["qemu-aarch64", "-L", SYSTEM, str(build / "core_tests"), "--no-version"])


def _run(command: list[str]) -> None:
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout[-4000:] + result.stderr[-4000:]
