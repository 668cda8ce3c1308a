"""Attacks and accidents around a server: it is killed, its place is taken or cannot be written, clients ask for too
much."""

from __future__ import annotations

import json
import resource
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

import wirebond
from tests.server.conftest import Served
from tests.shared import PROTOCOLS
from tests.waiting import PATIENCE, wait_until
from wirebond import recording as recordings
from wirebond.cli.main import main
from wirebond.link.attached import words
from wirebond.link.tap import TAP_BYTES

pytestmark = pytest.mark.live

DIFFDRIVE = str(PROTOCOLS / "diffdrive.yaml")
WIREBOND = Path(sys.executable).with_name("wirebond")


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "run"))
    return tmp_path


def attached(served: Served) -> socket.socket:
    found = socket.socket(socket.AF_UNIX)
    found.settimeout(PATIENCE)
    found.connect(served.server.path or "")
    found.sendall(words.json_message(words.Attach(id=1, messages="none")))
    assert found.recv(100)
    return found


@pytest.mark.long  # its short form is in test_clients.py: an attached link comes back when the server does
def test_a_server_that_is_killed_and_started_again_has_its_clients_back(place: Path) -> None:
    command = [str(WIREBOND), "serve", DIFFDRIVE, "sim:", "--recordings", str(place / "kept")]
    server = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    try:
        path = place / "run" / "wirebond" / "diffdrive.sock"
        wait_until(path.exists, "the server starts")
        with ExitStack() as stack:
            clients = [stack.enter_context(wirebond.open("wirebond://diffdrive")) for _ in range(5)]
            began = clients[0].recordings.start()
            clients[1].take_control()
            assert all(client.request("status_query", timeout=PATIENCE) for client in clients)
            server.kill()
            server.wait()
            wait_until(lambda: all(client.state == "down" for client in clients), "they notice it")
            assert all("is gone" in client.why for client in clients) or "no server runs at" in clients[0].why
            with pytest.raises(wirebond.LinkDownError):
                clients[2].send("velocity", linear=0.1)
            server = subprocess.Popen(command, stderr=subprocess.DEVNULL)
            wait_until(lambda: all(client.state != "down" for client in clients), "they attach again")
            assert all(client.request("status_query", timeout=PATIENCE) for client in clients)
            assert clients[0].control.holder is None
            with pytest.raises(wirebond.NotInControlError, match="take_control"):
                clients[2].send("velocity", linear=0.1)
            (listed,) = clients[0].recordings.list()
            assert (listed.name, listed.state) == (began.name, "unclosed")
            second = clients[4].recordings.start()
            server.send_signal(signal.SIGTERM)  # ends in order
            server.wait(PATIENCE)
        assert recordings.open(second.path).is_closed
        assert main(["info", began.path]) == 0
        assert recordings.open(began.path).is_closed
        assert {path.name for path in (place / "kept").iterdir()} == {Path(began.path).name, Path(second.path).name}
    finally:
        server.kill()
        server.wait()


def test_a_second_server_of_a_name_is_refused_and_the_first_goes_on(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = place / "run" / "wirebond" / "diffdrive.sock"
    path.parent.mkdir(parents=True, mode=0o700)
    with wirebond.open(DIFFDRIVE, "sim:") as link, wirebond.Server(link, path):
        assert main(["serve", DIFFDRIVE, "sim:", "--seconds", "5"]) == 3
        assert "another server listens at" in capsys.readouterr().err
        with wirebond.open("wirebond://diffdrive") as client:
            assert client.request("status_query", timeout=PATIENCE)


def test_a_place_for_the_socket_that_cannot_be_used_has_its_sentence(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def said() -> str:
        assert main(["serve", DIFFDRIVE, "sim:", "--seconds", "5"]) == 2
        return " ".join(capsys.readouterr().err.split())

    (place / "file").write_text("")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(place / "file"))
    assert "cannot make the folder" in said()
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/proc")
    assert "cannot make the folder /proc/wirebond" in said()
    (place / "open" / "wirebond").mkdir(parents=True)
    (place / "open" / "wirebond").chmod(0o777)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(place / "open"))
    assert "can be written by others" in said()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(place / ("long" * 40)))
    assert "whose path has at most 107 bytes" in said()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(place))
    with pytest.raises(wirebond.PortError, match=r"no server runs at .* start one with `wirebond serve"):
        wirebond.open("wirebond://diffdrive")


@pytest.mark.timed(tolerance=0.3)
@pytest.mark.usefixtures("real_ages")
def test_a_client_that_asks_for_a_mebibyte_again_and_again_keeps_nobody_waiting(served: Served) -> None:
    body = json.dumps({"do": "send", "id": 2, "message": "velocity", "fields": {"x": "y" * 1_000_000}}).encode()
    message = words.framed(words.JSON, body)
    hostile, ends = attached(served), threading.Event()
    sent = [0]

    def ask() -> None:
        while not ends.is_set():
            try:
                hostile.sendall(message)
                sent[0] += 1
            except OSError:
                return

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    thread = threading.Thread(target=ask)
    thread.start()
    try:
        with served.attach() as link:
            wait_until(lambda: sent[0] > 20)
            for _ in range(20):
                began = time.monotonic()
                assert link.state == "stale"
                assert time.monotonic() - began < 1
    finally:
        ends.set()
        hostile.shutdown(socket.SHUT_RDWR)
        thread.join()
        hostile.close()
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 64_000  # KiB


def test_a_half_open_connection_is_no_client(served: Served) -> None:
    half = attached(served)
    assert served.server.client_count == 1
    half.shutdown(socket.SHUT_WR)
    wait_until(lambda: served.server.client_count == 0)
    half.close()


def test_recordings_that_no_client_takes_are_bounded_for_all_together(served: Served) -> None:
    with ExitStack() as stack:
        links = [stack.enter_context(served.attach()) for _ in range(5)]
        taps = [link.tap(4 * TAP_BYTES) for link in links[:4] for _ in range(4)]
        with pytest.raises(wirebond.UsageError, match="the recordings of all clients already hold 268435456 of"):
            links[4].tap(4 * TAP_BYTES)
        taps[0].close()
        links[4].tap(4 * TAP_BYTES)


def test_a_wall_clock_that_jumps_changes_no_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real, jumps = time.time_ns(), [0]

    def jump() -> int:
        jumps[0] += 1
        return real - jumps[0] * 3600 * 10**9

    monkeypatch.setattr(time, "time_ns", jump)
    monkeypatch.setattr(time, "time", lambda: jump() / 1e9)
    path = tmp_path / "run.mcap"
    with (
        wirebond.open(DIFFDRIVE, "sim:") as own,
        wirebond.Server(own, tmp_path / "socket"),
        wirebond.open(f"wirebond://{tmp_path / 'socket'}") as link,
        link.record(path),
    ):
        link.take_control()
        for _ in range(3):
            assert link.request("status_query", timeout=PATIENCE)
        assert link.control.is_own
    found = recordings.open(path)
    times = [chunk.t for chunk in found.chunks()]
    assert times == sorted(times)
    assert found.duration < 3600
