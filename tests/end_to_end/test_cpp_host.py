"""The page docs/cpp-host.md, followed to the letter: find_package, a generated header, a tty with an MCU behind it."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import wirebond
from tests.shared import PROTOCOLS, ROOT
from tests.waiting import PATIENCE
from wirebond.sim import pty_port
from wirebond.sim.virtual_mcu import VirtualMcu

pytestmark = pytest.mark.live

PAGE = ROOT / "docs" / "cpp-host.md"
COMMAND = Path(sys.executable).with_name("wirebond")


def block(language: str) -> str:
    found = re.findall(rf"^```{language}\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    assert len(found) == 1, f"the page shows {len(found)} blocks of {language}"
    return str(found[0])


def run(*command: str | Path, fails: bool = False) -> str:
    environment = {
        **os.environ,
        "PATH": f"{COMMAND.parent}{os.pathsep}{os.environ['PATH']}",
        "CXXFLAGS": "-DWIREBOND_INLINE=inline -DWIREBOND_INLINE_LAMBDA=",  # to compile quickly
    }
    done = subprocess.run(
        list(map(str, command)), capture_output=True, text=True, timeout=120, env=environment, check=False
    )
    assert (done.returncode != 0) == fails, f"{done.stdout}{done.stderr}"
    return done.stdout + done.stderr


@pytest.fixture
def project(tmp_path: Path) -> Path:
    (tmp_path / "CMakeLists.txt").write_text(block("cmake"))
    (tmp_path / "main.cpp").write_text(block("cpp"))
    shutil.copy(PROTOCOLS / "diffdrive.yaml", tmp_path)
    return tmp_path


@pytest.fixture
def mcu() -> Iterator[str]:
    """The tty of a virtual diffdrive MCU."""
    port = pty_port.PtyPort()
    virtual = VirtualMcu(wirebond.load(PROTOCOLS / "diffdrive.yaml"), time.monotonic())
    ended = threading.Event()

    def serve() -> None:
        while not ended.is_set():
            pty_port.run(virtual, port, time.monotonic() + 0.05, lambda _: None)

    thread = threading.Thread(target=serve)
    thread.start()
    yield port.path
    ended.set()
    thread.join(PATIENCE)
    port.close()


def test_a_cpp_program_finds_the_headers_and_asks_an_mcu_for_its_status(project: Path, mcu: str) -> None:
    cmakedir = run(COMMAND, "--cmakedir").strip()
    run("cmake", "-S", project, "-B", project / "build", f"-Dwirebond_DIR={cmakedir}")
    run("cmake", "--build", project / "build")
    assert re.fullmatch(r"battery [\d.]+ V\n", run(project / "build" / "status", mcu))
    assert "cannot open the tty: No such file" in run(project / "build" / "status", "/dev/ttyNOPE", fails=True)


def test_the_commands_of_the_page_work_in_its_order(project: Path, mcu: str) -> None:
    page = PAGE.read_text(encoding="utf-8")
    files, _, rest = page.partition(block("cpp"))
    assert "cmake -S" not in files, "the page builds a program that it has not shown yet"
    commands = re.findall(r"^    (\S.*)$", rest.partition("\n## ")[0], re.MULTILINE)
    assert len(commands) == 3
    out = run("bash", "-e", "-c", "\n".join(["cd " + str(project), *commands]).replace("/dev/ttyUSB0", mcu))
    assert re.search(r"^battery [\d.]+ V$", out, re.MULTILINE)


@pytest.mark.skipif(not (ROOT / ".venv" / "bin" / "wirebond").exists(), reason="this Python is not the clone's .venv")
def test_the_command_of_a_clone_is_found_without_the_path(project: Path) -> None:
    environment = {**os.environ, "PATH": "/usr/local/bin:/usr/bin:/bin"}
    command = ["cmake", "-S", str(project), "-B", str(project / "build"), f"-Dwirebond_DIR={ROOT / 'cmake'}"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, env=environment, check=False)
    assert done.returncode == 0, done.stderr


def test_a_mistake_in_the_file_ends_the_configuration_in_a_sentence(project: Path) -> None:
    text = (project / "diffdrive.yaml").read_text()
    (project / "diffdrive.yaml").write_text(text.replace("id: 0x01", "id: 1x", 1))
    cmakedir = run(COMMAND, "--cmakedir").strip()
    words = run("cmake", "-S", project, "-B", project / "build", f"-Dwirebond_DIR={cmakedir}", fails=True)
    assert re.search(r"diffdrive\.yaml:\d+:\d+:", words)


def test_headers_install_without_python_and_versions_are_compared(tmp_path: Path) -> None:
    prefix, build = tmp_path / "prefix", tmp_path / "headers"
    run("cmake", "-S", ROOT, "-B", build, "-DWIREBOND_ENGINE=OFF")
    run("cmake", "--install", build, "--prefix", prefix)
    for wanted, fails in (("", False), ("0.1", False), ("0.2", True), ("1.0", True), ("0.0", True)):
        (tmp_path / "CMakeLists.txt").write_text(
            "cmake_minimum_required(VERSION 3.16)\nproject(use LANGUAGES CXX)\n"
            f"find_package(wirebond {wanted} REQUIRED)\n"
            'file(WRITE use.cpp "#include \\"wirebond/message.hpp\\"\\n#include \\"wirebond/posix/stream.hpp\\"\\n")\n'
            "add_library(use OBJECT use.cpp)\ntarget_link_libraries(use PRIVATE wirebond::posix)\n"
        )
        shutil.rmtree(tmp_path / "build", ignore_errors=True)
        command = ["cmake", "-S", tmp_path, "-B", tmp_path / "build", f"-DCMAKE_PREFIX_PATH={prefix}"]
        run(*command, fails=fails)
        if not wanted:
            run("cmake", "--build", tmp_path / "build")


def test_all_places_have_the_same_version() -> None:
    project = re.search(r'^version = "(.*)"$', (ROOT / "pyproject.toml").read_text(), re.MULTILINE)
    cmake = re.search(r'PACKAGE_VERSION "(.*)"', (ROOT / "cmake" / "wirebondConfigVersion.cmake").read_text())
    assert project is not None and cmake is not None
    assert {project[1], cmake[1], wirebond.__version__} == {wirebond.__version__}
