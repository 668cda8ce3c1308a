"""The compiled engine once more with address and undefined-behaviour sanitizers: the tests that exercise it most."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

from tests.shared import ROOT

BUILD = ROOT / "build" / "sanitized"
TESTS = [
    "tests/test_vectors.py",
    "tests/test_against_reference.py",
    "tests/test_deframing.py",
    "tests/test_field_types.py",
    "tests/end_to_end/test_link.py",
    "tests/host_link/test_account.py",
    "tests/host_link/test_behaviour.py",
    "python/tests/test_codec.py",
    "python/tests/test_packing.py",
]
# Two are too large for the sanitizers, one forks, others run a program of their own.
NOT_WITH_SANITIZERS = "ten_megabytes or progress_of_a_large or permission or generated_code"


def build() -> Path:
    """A folder with the package and the sanitized engine in it."""
    python = f"-DPython_EXECUTABLE={sys.executable}"
    options = ["-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release", "-DWIREBOND_SANITIZE=ON", python]
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


def test_engine_is_clean_under_the_sanitizers() -> None:
    site = build()
    runtimes = [
        subprocess.run(["c++", f"-print-file-name={name}"], capture_output=True, text=True, check=True).stdout.strip()
        for name in ("libasan.so", "libubsan.so")
    ]
    packages = sysconfig.get_paths()["purelib"]
    environment = os.environ | {
        "LD_PRELOAD": " ".join(runtimes),
        "ASAN_OPTIONS": "detect_leaks=0",  # the interpreter's own
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
    result = subprocess.run([*command, *TESTS], capture_output=True, text=True, env=environment, cwd=ROOT, check=False)
    assert result.returncode == 0, result.stdout[-3000:] + result.stderr[-3000:]
    assert " passed" in result.stdout
