"""The wheel holds what it must hold, and works where nothing of the source tree is in reach."""

from __future__ import annotations

import fcntl
import os
import shutil
import site
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

from tests.shared import ROOT
from wirebond.generate.code import PORTS, PORTS_IN_C

pytestmark = [pytest.mark.live, pytest.mark.long]

PAGE = ROOT / "python" / "src" / "wirebond" / "console" / "page"  # there where Node was, which built it


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    with (ROOT / "build" / "wheel.lock").open("w") as lock:  # several processes of the tests may want it at once
        fcntl.flock(lock, fcntl.LOCK_EX)
        subprocess.run(["make", "wheel"], cwd=ROOT, check=True, capture_output=True)
        (made,) = (ROOT / "build" / "wheel").glob("*.whl")
        shutil.copy(made, folder)
    return folder / made.name


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bin folder of a clean environment with the wheel in it. What the package depends on is borrowed from here: a
    path in a .pth file brings no editable installation with it."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=True)
    python = folder / "bin" / "python"
    subprocess.run([python, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", wheel], check=True)
    (packages,) = folder.glob("lib/python*/site-packages")
    (packages / "borrowed.pth").write_text("\n".join(site.getsitepackages()))
    return folder / "bin"


def test_the_guide_installs_from_a_clone(tmp_path: Path) -> None:
    """The first commands of docs/ros2-install.md, without the network: what the package needs is borrowed from here."""
    guide = (ROOT / "docs" / "ros2-install.md").read_text(encoding="utf-8")
    section = guide.partition("## An environment of its own")[2]
    make, install, serve = section.partition("```text\n")[2].partition("```")[0].splitlines()
    clone = tmp_path / "clone"
    subprocess.run(["git", "clone", "--quiet", ROOT, clone], check=True)
    paths = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, "HOME": str(tmp_path), "PATH": paths}
    environment |= {"PIP_NO_INDEX": "1", "PIP_NO_DEPS": "1", "PIP_NO_BUILD_ISOLATION": "false"}  # false: no isolation

    def shell(command: str) -> str:
        done = subprocess.run(["bash", "-c", command], env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
        return done.stdout

    shell(make)
    (packages,) = (tmp_path / "wirebond").glob("lib/python*/site-packages")
    (packages / "borrowed.pth").write_text("\n".join(site.getsitepackages()))
    assert "PATH/TO/wirebond[ros2]" in install
    shell(install.replace("PATH/TO/wirebond", str(clone)))
    command, file = serve.split()[0], serve.split()[2]
    shown = shell(f"{command} check {clone / 'protocols' / file}")
    assert "protocol diffdrive" in shown
    where = shell("~/wirebond/bin/python -c 'import wirebond; print(wirebond.__file__)'")
    assert Path(where).is_relative_to(tmp_path / "wirebond")


def run(installed: Path, *command: str | Path, cwd: Path) -> str:
    environment = {
        "PATH": f"{installed}{os.pathsep}{os.environ['PATH']}",
        "HOME": str(cwd),
        "LC_ALL": "C.UTF-8",
    }
    done = subprocess.run(
        list(map(str, command)), cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    return done.stdout


def test_wheel_holds_headers_files_types_and_one_engine(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        metadata = archive.read(next(n for n in names if n.endswith(".dist-info/METADATA"))).decode()
        scripts = archive.read(next(n for n in names if n.endswith("/entry_points.txt"))).decode()
    in_tree = {
        f"wirebond/data/{path.relative_to(ROOT).as_posix()}"
        for folder, endings in {
            "cmake": (".cmake",),
            "core/include": (".hpp", ".h"),
            **{f"ports/{port}/include": (".hpp", ".h") for port in (*PORTS, "stm32")},
            **{f"ports/{port}/c": (".c", ".h") for port in PORTS_IN_C},
            "protocols": (".yaml", ".json"),
            "firmware": (".hpp", ".cpp"),
            "sim/include": (".hpp",),
            "sim/soak": (".hpp", ".cpp"),
            "sim/wire": (".hpp", ".cpp"),
        }.items()
        for path in (ROOT / folder).rglob("*")
        if path.suffix in endings and not (folder == "firmware" and {"boards", "stm32"} & set(path.parts))
    }
    sources = ROOT / "python" / "src"
    package = {
        path.relative_to(sources).as_posix()
        for path in sources.rglob("*")
        if path.suffix in (".py", ".pyi", ".j2", ".typed", ".yaml", ".txt", ".wasm")
        or (PAGE in path.parents and path.is_file())
    }
    assert len(in_tree) > 40 and len(package) > 80
    assert in_tree | package <= names
    assert len([name for name in names if name.endswith(".so")]) == 1
    strange = {n for n in names - in_tree - package if not n.endswith(".so") and ".dist-info/" not in n}
    assert strange == set()
    assert any(name.endswith("licenses/LICENSE") for name in names)
    assert "wirebond = wirebond.cli.start:main" in scripts
    assert "Requires-Python: >=3.11" in metadata


def test_commands_work_from_the_wheel_alone(installed: Path, tmp_path: Path) -> None:
    assert "Usage: wirebond" in run(installed, "wirebond", "--help", cwd=tmp_path)
    where = run(installed, installed / "python", "-c", "import wirebond; print(wirebond.__file__)", cwd=tmp_path)
    assert Path(where).is_relative_to(installed.parent)
    data = Path(where).parent / "data"
    assert Path(run(installed, "wirebond", "--cmakedir", cwd=tmp_path).strip()) == data / "cmake"
    file = data / "protocols" / "diffdrive.yaml"
    frame = run(installed, "wirebond", "encode", file, "velocity", "linear=0.5", "angular=0", cwd=tmp_path)
    assert frame == "AA 55 01 F4 01 00 00 00 00 0B 0D\n"
    decoded = run(installed, "wirebond", "decode", file, "--sender", "host", "--hex", frame.strip(), cwd=tmp_path)
    assert '"linear": 0.5' in decoded
    for language in ("cpp", "c", "python"):
        run(installed, "wirebond", "gen", file, "--lang", language, "--out", tmp_path / language, cwd=tmp_path)
    compiler = ["g++", "-std=c++17", "-fsyntax-only", f"-I{tmp_path / 'c'}"]
    run(installed, *compiler, tmp_path / "c" / "diffdrive.cpp", cwd=tmp_path)
    typed = "import diffdrive; print(diffdrive.Velocity(linear=0.5).encode().hex())"
    assert run(installed, installed / "python", "-c", typed, cwd=tmp_path / "python") == "aa5501f401000000000b0d\n"


def test_cmake_finds_the_headers_of_the_wheel_and_its_command(installed: Path, tmp_path: Path) -> None:
    cmakedir = run(installed, "wirebond", "--cmakedir", cwd=tmp_path).strip()
    (tmp_path / "main.cpp").write_text('#include "native.hpp"\n#include "wirebond/posix/stream.hpp"\nint main() {}\n')
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.16)\nproject(use LANGUAGES CXX)\nfind_package(wirebond 0.1 REQUIRED)\n"
        "add_executable(use main.cpp)\ntarget_link_libraries(use PRIVATE wirebond::posix)\n"
        f"wirebond_protocol(use {cmakedir}/../protocols/native.yaml)\nmessage(STATUS ${{WIREBOND_COMMAND}})\n"
    )
    configure = ["cmake", "-S", tmp_path, "-B", tmp_path / "build", f"-Dwirebond_DIR={cmakedir}"]
    assert str((installed / "wirebond").resolve()) in run(installed, *configure, cwd=tmp_path)
    run(installed, "cmake", "--build", tmp_path / "build", cwd=tmp_path)


def test_python_is_the_one_that_the_wheel_is_for(wheel: Path) -> None:
    assert f"cp{sys.version_info.major}{sys.version_info.minor}-" in wheel.name
