"""Services with real peers: the simulation, and a firmware with all of them as a process."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import wirebond
from tests.host_link.mcu import wait_until
from tests.shared import PROTOCOLS, ROOT, codec
from wirebond.gen import generate_cpp
from wirebond.sim.process import FirmwareProcess
from wirebond.sim.pty_port import PtyPort
from wirebond.sim.pty_port import run as serve
from wirebond.sim.virtual_mcu import VirtualMcu

COMMAND = [str(Path(sys.executable).with_name("wirebond"))]
NATIVE = str(PROTOCOLS / "native.yaml")
FLAGS = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-Wshadow", "-Wconversion", "-O0", "-pthread"]


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    result = subprocess.run([*COMMAND, *arguments], capture_output=True, text=True, timeout=60, check=False)
    assert "Traceback" not in result.stdout + result.stderr
    return result


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("services")
    generate_cpp(wirebond.load(NATIVE).model, folder)
    folders = [folder, ROOT / "firmware", ROOT / "ports" / "posix" / "include"]
    source = Path(__file__).with_name("services_firmware.cpp")
    command = ["g++", *FLAGS, *(f"-I{one}" for one in folders), str(source), "-o", str(folder / "arm")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder / "arm"


@pytest.fixture
def firmware(program: Path) -> Iterator[FirmwareProcess]:
    with FirmwareProcess(program, "the arm") as process:
        yield process


@contextmanager
def simulated(protocol: wirebond.Codec) -> Iterator[str]:
    """A virtual MCU on a pty; its path."""
    pty, over = PtyPort(), threading.Event()

    def turn() -> None:
        mcu = VirtualMcu(protocol, time.monotonic())
        while not over.is_set():
            serve(mcu, pty, time.monotonic() + 0.05, lambda _: None)

    thread = threading.Thread(target=turn)
    thread.start()
    try:
        yield pty.path
    finally:
        over.set()
        thread.join()
        pty.close()


@pytest.fixture
def other_file(tmp_path: Path) -> Path:
    """Native with one field of another scale: another hash."""
    path = tmp_path / "changed.yaml"
    text = Path(NATIVE).read_text()
    path.write_text(text.replace("scale: 0.001, range: [-3.0, 3.0]", "scale: 0.01, range: [-3.0, 3.0]"))
    assert wirebond.load(path).hash != codec("native").hash
    return path


# ---- hello


def test_a_firmware_of_the_same_file_is_known_as_such(firmware: FirmwareProcess) -> None:
    with wirebond.open(NATIVE, firmware.port) as link:
        wait_until(lambda: link.peer.state == "same", "the peer says hello")
        assert link.peer.hash == link.codec.hash


def test_a_firmware_of_another_file_is_told_by_every_command(firmware: FirmwareProcess, other_file: Path) -> None:
    other = str(other_file)
    sent = run("send", other, firmware.port, "command", "speed=0", "mode=idle")
    assert sent.returncode == 0
    assert sent.stderr.count("the MCU was built from another protocol file") == 1
    assert "`wirebond diff`" in sent.stderr
    repeated = run("send", other, firmware.port, "command", "speed=0", "mode=idle", "--rate", "50", "--seconds", "0.3")
    assert repeated.stderr.count("the MCU was built from another protocol file") == 1
    watched = run("monitor", other, firmware.port, "--json", "--seconds", "0.3")
    assert watched.stderr.count("the MCU was built from another protocol file") == 1
    hellos = [m for m in map(json.loads, watched.stdout.splitlines()) if m["message"] == "hello"]
    assert hellos[0]["peer"] == {"state": "different", "hash": f"{codec('native').hash:016x}"}


def test_a_simulation_says_hello_as_well() -> None:
    with simulated(codec("native")) as port, wirebond.open(NATIVE, port) as link:
        wait_until(lambda: link.peer.state == "same", "the peer says hello")


# ---- clock


def test_the_clock_of_a_firmware_is_followed_within_its_bound(firmware: FirmwareProcess) -> None:
    with wirebond.open(NATIVE, firmware.port) as link:
        with pytest.raises(wirebond.UsageError, match="not known yet"):
            link.host_time(0)
        wait_until(lambda: link.clock is not None and link.clock.exchanges >= 6, "six exchanges")
        for _ in range(20):
            now = time.monotonic()
            answer = link.host_time(int(now * 1e6) & 0xFFFFFFFF, near=now)  # its clock is that of this machine
            assert abs(answer.t - now) <= answer.error < 0.1
        assert link.clock is not None
        assert link.clock.restarts == 0
        assert [m.name for m in link.receive(0.1) if m.name != "hello"] == []  # the exchanges are the link's own


def test_the_clock_begins_again_with_a_firmware_that_restarts(program: Path, tmp_path: Path) -> None:
    name = tmp_path / "mcu"
    with FirmwareProcess(program, "the arm") as first:
        name.symlink_to(first.port)
        with wirebond.open(NATIVE, name) as link:
            wait_until(lambda: link.clock is not None, "the first clock")
            name.unlink()
            first.close()
            wait_until(lambda: link.state == "down", "the end of the port")
            with simulated(codec("native")) as port:  # its clock begins at zero
                name.symlink_to(port)
                wait_until(lambda: link.clock is not None and link.clock.restarts == 1, "the restart")
                assert link.clock is not None
                stamp = link.request("clock_request", host_us=1)
                answer = link.host_time(stamp["sent_us"], near=stamp.t)
                assert abs(answer.t - stamp.t) <= answer.error + 0.5
