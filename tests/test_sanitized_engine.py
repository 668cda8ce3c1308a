"""The compiled engine once more with address and undefined-behaviour sanitizers: the tests that exercise it most.

It takes more than a minute to build. `make test` has the core under the same sanitizers: tests/fuzz."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from tests.shared import ROOT

pytestmark = pytest.mark.live

BUILD = ROOT / "build" / "sanitized"
REPORT = BUILD / "report"  # and behind it a process's number
COMPILER = "clang++-14"  # it builds them in half of the time that GCC takes
TESTS = [
    "tests/test_vectors.py",
    "tests/test_deframing.py",
    "tests/test_field_types.py",
    "tests/end_to_end/test_link.py",
    "tests/link/test_account.py",
    "tests/link/test_behaviour.py",
    "tests/test_codec.py",
    "tests/link/test_packing.py",
    "tests/test_against_reference.py",
    "tests/analysis/explain/test_against_engine.py",
]
# Two are too large for the sanitizers, one forks, others run a program of their own.
NOT_WITH_SANITIZERS = "ten_megabytes or progress_of_a_large or permission or generated_code"


def build() -> Path:
    """A folder with the package and the sanitized engine in it."""
    python = f"-DPython_EXECUTABLE={sys.executable}"
    options = ["-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release", "-DWIREBOND_SANITIZE=ON", python]
    options += [f"-DCMAKE_CXX_COMPILER={COMPILER}"]
    for command in (["cmake", "-S", str(ROOT), "-B", str(BUILD), *options], ["cmake", "--build", str(BUILD)]):
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        assert result.returncode == 0, result.stdout[-3000:] + result.stderr[-3000:]
    site = BUILD / "site"
    shutil.rmtree(site, ignore_errors=True)
    shutil.copytree(ROOT / "python" / "src", site)
    (engine,) = BUILD.glob("_engine.*.so")
    shutil.copy(engine, site / "wirebond")
    for folder in ("core/include", "ports/posix/include", "protocols", "firmware"):
        shutil.copytree(ROOT / folder, site / "wirebond" / "data" / folder)
    return site


@pytest.mark.long
def test_engine_is_clean_under_the_sanitizers() -> None:
    site = build()
    runtime = f"-print-file-name=libclang_rt.asan-{platform.machine()}.so"
    found = subprocess.run([COMPILER, runtime], capture_output=True, text=True, check=True)
    packages = sysconfig.get_paths()["purelib"]
    environment = os.environ | {
        "LD_PRELOAD": found.stdout.strip(),
        "ASAN_OPTIONS": f"detect_leaks=0:log_path={REPORT}",  # leaks: the interpreter's own
        "PYTHONPATH": os.pathsep.join([str(site), packages, str(ROOT)]),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    # -S: without it the development install of the package would come first.
    command = [
        sys.executable,
        "-S",
        "-m",
        "pytest",
        "-p",
        "no:cacheprovider",
        "-m",
        "not long",
        "-k",
        f"not ({NOT_WITH_SANITIZERS})",
    ]
    proof = "import wirebond._engine as e; print(e.__file__)"
    found = subprocess.run(
        [sys.executable, "-S", "-c", proof], capture_output=True, text=True, env=environment, check=True
    )
    assert str(site) in found.stdout
    for old in BUILD.glob(f"{REPORT.name}.*"):
        old.unlink()
    result = subprocess.run([*command, *TESTS], capture_output=True, text=True, env=environment, cwd=ROOT, check=False)
    reports = "".join(path.read_text()[:3000] for path in BUILD.glob(f"{REPORT.name}.*"))
    assert result.returncode == 0, result.stdout[-3000:] + result.stderr[-3000:] + reports
    assert not reports
    assert " passed" in result.stdout
