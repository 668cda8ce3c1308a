"""For Windows and macOS: the engine compiles without a warning, and the package uses no name that Python lacks there.

Whether it runs there, nothing here shows: docs/windows-macos.md.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import nanobind
import pytest
from setup.foreign_python import FOREIGN_TARGETS, ZIG, ForeignTarget, foreign_headers, import_library, stable_names

from tests.shared import ROOT

pytestmark = [pytest.mark.live, pytest.mark.long]

NATIVE = ROOT / "python" / "native"
WITH_PORTS = {"ports", "link", "link_binding", "opener", "pty_number"}  # as in CMakeLists.txt
SOURCES = [*sorted((ROOT / "engine" / "src").glob("*.cpp")), *sorted(NATIVE.glob("*.cpp"))]
PORTABLE = [path for path in SOURCES if not (path.parent == NATIVE and path.stem in WITH_PORTS)]
FLAGS = ("-std=c++17", "-Wall", "-Wextra", "-Werror", "-DPy_LIMITED_API=0x030C0000")


@pytest.fixture(scope="module")
def headers() -> Path:
    """Those of a CPython 3.12 or newer of this computer."""
    code = "import sys, sysconfig; sys.exit(sys.version_info < (3, 12) or print(sysconfig.get_path('include')))"
    pythons = [sys.executable, *filter(None, (shutil.which(f"python3.{minor}") for minor in range(12, 20)))]
    pythons += map(str, sorted(Path.home().glob(".pyenv/versions/3.1[2-9].*/bin/python3")))
    for python in pythons:
        asked = subprocess.run([python, "-c", code], capture_output=True, text=True, check=False)
        if asked.returncode == 0 and (include := Path(asked.stdout.strip())).is_dir():
            return include
    pytest.skip("there is no CPython 3.12 or newer with its headers on this computer")


@pytest.fixture(scope="module")
def include(headers: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return foreign_headers(headers, tmp_path_factory.mktemp("python"))


@pytest.mark.parametrize("source", PORTABLE, ids=lambda path: path.stem)
@pytest.mark.parametrize("target", FOREIGN_TARGETS[:2], ids=lambda target: target.name)
def test_the_engine_without_ports_compiles_without_a_warning(
    target: ForeignTarget, source: Path, include: Path, tmp_path: Path
) -> None:
    folders = [ROOT / "core" / "include", ROOT / "engine" / "include"]
    system = [include, Path(nanobind.include_dir())]
    command = [*ZIG, "c++", "-target", target.zig, *FLAGS, *(f"-I{folder}" for folder in folders)]
    command += [*(word for folder in system for word in ("-isystem", str(folder))), "-c", str(source)]
    command += ["-o", str(tmp_path / "made.o")]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""


def test_the_import_library_has_the_names_of_the_stable_interface_alone(tmp_path: Path) -> None:
    names = dict(stable_names())
    assert not names["PyLong_FromLong"]
    assert names["PyLong_Type"]
    assert "PyUnicode_AsUTF8" not in names  # it became stable with 3.13
    assert import_library(tmp_path).stat().st_size > 10_000


@pytest.mark.parametrize("platform", ["win32", "darwin"])
def test_the_package_uses_no_name_that_python_lacks_there(platform: str, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "mypy", "--platform", platform, "--cache-dir", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
