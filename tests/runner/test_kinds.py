"""A test without a marker may not do what only live tests may, and each timed test has its stall measured."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import textwrap
import threading
from pathlib import Path

import pytest

from tests.shared import ROOT
from tests.waiting import let_pass
from wirebond.link.attached.address import socket_folder

pytestmark = pytest.mark.live


def run(folder: Path, text: str) -> tuple[str, list[dict[str, object]]]:
    """Return the output of pytest for this file, and the results."""
    head = "import os, socket, subprocess, sys, time\nimport pytest\n\n"
    (folder / "test_it.py").write_text(head + textwrap.dedent(text))
    options = ["-o", "addopts=", "-o", "testpaths=", "-q", "-c", str(ROOT / "pyproject.toml"), "--rootdir", str(folder)]
    plugins = ["-p", "tests.runner.kinds", "-p", "tests.runner.results", "--results", str(folder / "results.json")]
    process = subprocess.run(
        [sys.executable, "-m", "pytest", *options, *plugins, "-p", "no:cacheprovider", str(folder / "test_it.py")],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    results = folder / "results.json"
    return process.stdout + process.stderr, json.loads(results.read_text()) if results.exists() else []


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("subprocess.run(['true'])", "starts a process"),
        ("os.waitpid(os.posix_spawn('/bin/true', ['true'], {}), 0)", "starts a process"),
        ("socket.socket().bind(('127.0.0.1', 0))", "opens a port"),
        ("[os.close(end) for end in os.openpty()]", "opens a pty"),
        ("time.sleep(0)", "sleeps"),
    ],
)
def test_a_test_without_a_marker_that_is_not_pure_fails(tmp_path: Path, line: str, said: str) -> None:
    text = f"""
        def test_pure(): pass
        def test_not_pure(): {line}
        @pytest.mark.live
        def test_live(): {line}
    """
    shown, results = run(tmp_path, text)
    assert f"a test that is not marked `live` {said}" in shown
    assert [result["has_passed"] for result in results] == [True, False, True]


def test_a_test_that_is_interrupted_has_no_result(tmp_path: Path) -> None:
    _, results = run(tmp_path, "def test_whole(): pass\ndef test_interrupted(): raise KeyboardInterrupt\n")
    assert [str(result["name"]).rpartition("::")[2] for result in results] == ["test_whole"]


def test_leftovers_of_another_run_meet_no_test() -> None:
    """The system reuses the numbers of ptys, so a remembered emergency stop would hold another test's robot."""
    command = "import conftest; from wirebond.link.attached.address import socket_folder; print(socket_folder())"
    other = subprocess.run([sys.executable, "-c", command], cwd=ROOT, capture_output=True, text=True, check=True)
    common = str(Path("/tmp") / f"wirebond-{os.getuid()}")
    assert len({other.stdout.strip(), str(socket_folder()), common}) == 3


def test_the_stall_of_a_timed_test_is_measured(tmp_path: Path) -> None:
    """The process that runs it, and the meter below it, are suspended for a while."""
    text = """
        @pytest.mark.timed(tolerance=0.1)
        def test_late():
            (PLACE / "pid").write_text(str(os.getpid()))
            while not (PLACE / "is_over").exists():
                time.sleep(0.01)
            assert False
    """.replace("PLACE", f"__import__('pathlib').Path({str(tmp_path)!r})")
    ends = threading.Event()

    def suspend() -> None:
        pid = tmp_path / "pid"
        while not pid.exists() or not pid.read_text():
            if ends.wait(0.01):
                return
        root = int(pid.read_text())
        children = Path(f"/proc/{root}/task/{root}/children").read_text().split()
        for process in (root, *map(int, children)):
            os.kill(process, signal.SIGSTOP)
        let_pass(0.3)
        for process in (root, *map(int, children)):
            os.kill(process, signal.SIGCONT)
        (tmp_path / "is_over").touch()

    thread = threading.Thread(target=suspend)
    thread.start()
    shown, (result,) = run(tmp_path, text)
    ends.set()
    thread.join()
    assert result["has_passed"] is False
    assert result["tolerance"] == 0.1
    assert float(str(result["stall"])) > 0.25
    assert "the machine stalled for" in shown


def test_a_timed_test_states_what_it_tolerates(tmp_path: Path) -> None:
    shown, _ = run(tmp_path, "@pytest.mark.timed(tolerance=2)\ndef test_it(): pass\n")
    assert "write `timed(tolerance=SECONDS)` with at most 0.5 s" in shown
