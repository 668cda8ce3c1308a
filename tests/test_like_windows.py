"""Commands without everything that Python does not have on Windows; like_windows.py says what that shows."""

from __future__ import annotations

import contextlib
import io
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.like_windows import PORTS, missing_modules, missing_names
from tests.shared import PROTOCOLS, ROOT
from tests.waiting import PATIENCE, moments
from wirebond import load
from wirebond.cli.main import main
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live

FILE = str(PROTOCOLS / "diffdrive.yaml")
FRAME = "AA5501F401000000000B0D"
# The same as here.
SAME = (
    ["--version"],
    ["--help"],
    ["serve", "--help"],
    ["check", FILE],
    ["encode", FILE, "velocity", "linear=0.5", "angular=0"],
    ["decode", FILE, "--sender", "host", "--hex", FRAME],
    ["explain", FILE, "--hex", FRAME],
    ["schema"],
)
# A sentence, and the exit code of wrong usage.
NOT_THERE = {
    ("sim", FILE): "needs a pty, and Windows has none; run it on Linux, or on this computer in WSL",
    ("monitor", FILE, "sim:"): "needs a pty, and Windows has none",
    ("wire", "a", "b"): "is a program for Linux alone; run it there, or on Windows in WSL",
    ("demo",): "the rover is a program for Linux alone",
    ("soak", "--minutes", "0.01"): "is a program for Linux alone",
    ("serve", FILE, "COM3"): "no Unix sockets, so servers have no names here; use TCP: `wirebond serve FILE PORT --tcp",
    ("serve", FILE, "COM3", "--tcp", "127.0.0.1:0", "--ros2"): "ROS 2",
    ("monitor", FILE, "wirebond://diffdrive"): "no Unix sockets, so servers have no names here; use TCP",
}
NO_PORT = "there is no port COM3; plug it in, or look for its name with `python -m serial.tools.list_ports`"


def like_windows(commands: list[list[str]], folder: Path) -> list[tuple[int, str]]:
    """Return the exit code and output of each command, run in one process like one on Windows."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.like_windows", json.dumps(commands)],
        cwd=ROOT,
        env={**os.environ, "LOCALAPPDATA": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return [(code, text) for code, text in json.loads(done.stdout)]


def here(command: list[str]) -> tuple[int, str]:
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(out):
        code = main(command)
    return code, out.getvalue()


def test_the_stand_in_lacks_what_windows_lacks() -> None:
    assert {"fcntl", "termios", "resource", "pty", "tty", "pwd", "grp", "posix", "readline"} <= missing_modules()
    assert {"fork", "getuid", "killpg", "O_NONBLOCK", "register_at_fork", "openpty", "fchmod"} <= missing_names("os")
    assert {"SIGHUP", "SIGKILL", "SIGALRM", "alarm", "pthread_sigmask"} <= missing_names("signal")
    assert {"AF_UNIX", "SO_PEERCRED"} <= missing_names("socket")
    assert {"poll", "epoll"} <= missing_names("select")
    assert not {"open", "fsync", "link", "O_EXCL"} & missing_names("os")


def test_commands_without_a_port_do_the_same_as_on_linux(tmp_path: Path) -> None:
    generate = ["gen", FILE, "--out"]
    found = like_windows([*SAME, [*generate, str(tmp_path / "there")]], tmp_path)
    for command, what in zip(SAME, found, strict=False):
        assert what == here(command), command
    assert found[-1][0] == 0
    assert here([*generate, str(tmp_path / "here")])[0] == 0
    made = {path.relative_to(tmp_path / "here") for path in (tmp_path / "here").rglob("*") if path.is_file()}
    assert len(made) > 20
    for path in made:
        assert (tmp_path / "there" / path).read_bytes() == (tmp_path / "here" / path).read_bytes(), path


def test_commands_that_windows_cannot_run_say_so(tmp_path: Path) -> None:
    found = like_windows([list(command) for command in NOT_THERE], tmp_path)
    for (command, sentence), (code, text) in zip(NOT_THERE.items(), found, strict=True):
        assert (code, sentence in text) == (2, True), (command, text)
        assert "Traceback" not in text


def test_a_port_that_is_not_there_is_a_sentence(tmp_path: Path) -> None:
    commands = [["monitor", FILE, "COM3"], ["record", FILE, "COM3"], ["serve", FILE, "COM3", "--web", "0"]]
    commands[-1] += ["--no-browser", "--seconds", "0.1"]
    *found, served = like_windows(commands, tmp_path)
    assert found == [(3, f"wirebond: {NO_PORT}\n")] * 2
    assert served[0] == 0
    assert f"{NO_PORT}. Waiting for it." in served[1]
    assert "wirebond://" not in served[1]


# A program as users write one. It prints each change, answers each status with a velocity, and ends by itself.
PROGRAM = """
import sys
from tests import like_windows
like_windows.become()
import wirebond
from wirebond.link.python_link import PythonLink
with wirebond.open(sys.argv[1], "COM3", wait_for_port=True) as link:
    assert isinstance(link.internals.engine, PythonLink)
    was, ends = None, False
    while not ends:
        for message in link.receive(0.02):
            if message.name == "status":
                print("battery", message["battery"], flush=True)
                ends = message["battery"] == 0
                if not ends:
                    link.send("velocity", linear=message["battery"] / 10, angular=0)
        if link.state != was:
            was = link.state
            print(was, flush=True)
print("closed", link.stats.reconnects, flush=True)
"""


@pytest.fixture
def program(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    environment = {**os.environ, "LOCALAPPDATA": str(tmp_path), PORTS: json.dumps({"COM3": str(tmp_path / "com3")})}
    command = [sys.executable, "-c", PROGRAM, FILE]
    with subprocess.Popen(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True) as process:
        yield process
        process.kill()


def test_com3_is_opened_by_pyserial_in_a_thread_around_the_engines_core(
    program: subprocess.Popen[str], tmp_path: Path
) -> None:
    """Opened, sent and received over, unplugged, plugged in again, closed: the port is a pty behind pyserial."""
    codec = load(FILE)
    assert program.stdout is not None
    name = tmp_path / "com3"

    def says(line: str) -> None:
        """Read what the program says, up to this line."""
        assert line in iter(lambda: (program.stdout or io.StringIO()).readline().strip() or "it ended", "it ended")

    def status(battery: float) -> bytes:
        return codec.encode("status", battery=battery, errors=[], state=[])

    def exchange(port: PtyPort, voltage: float) -> None:
        decoder = codec.decoder("host")
        port.write(status(voltage))
        says(f"battery {voltage}")
        for _ in moments("the answer"):
            found = [message for message in decoder.feed(port.read(0.01)) if message.name == "velocity"]
            if found and found[0]["linear"] == pytest.approx(voltage / 10):
                return

    says("down")
    for voltage in (12.5, 19.0):
        port = PtyPort()
        name.symlink_to(port.path)
        says("stale")
        exchange(port, voltage)
        if voltage < 15:
            name.unlink()
            port.close()
            says("down")
    port.write(status(0.0))
    says("closed 1")
    assert program.wait(PATIENCE) == 0
    port.close()
