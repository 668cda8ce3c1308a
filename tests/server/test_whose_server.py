"""A program attaches only to a server of its own user: another user's server gets no byte of it."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import wirebond
from tests.server.conftest import Served
from tests.shared import PROTOCOLS
from tests.waiting import PATIENCE, wait_until
from wirebond import PortError
from wirebond.cli.main import main
from wirebond.link.attached import whose_server
from wirebond.link.attached.address import socket_of

pytestmark = pytest.mark.live

OTHER = 65534  # by convention the user nobody


@pytest.fixture
def other(monkeypatch: pytest.MonkeyPatch) -> int:
    """The number of another user. Without the rights of root, what this user makes counts as that user's."""
    if os.geteuid() == 0:
        return OTHER
    own = os.geteuid()
    monkeypatch.setattr(whose_server.os, "geteuid", lambda: own + 1)
    return own


def give(path: Path, user: int) -> None:
    if os.geteuid() == 0:
        os.chown(path, user, -1, follow_symlinks=False)


@contextmanager
def listening(path: Path, user: int) -> Iterator[socket.socket]:
    """A server of this user, which any program can reach."""
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(path))
        path.chmod(0o666)
        server.setblocking(False)
        if os.geteuid() != 0:
            server.listen()
            yield server
            return
        os.seteuid(user)  # the kernel notes who listens
        try:
            server.listen()
        finally:
            os.seteuid(0)
        yield server


def received(server: socket.socket) -> bytes:
    """All that clients sent until they went."""
    found = b""
    while True:
        try:
            client, _ = server.accept()
        except BlockingIOError:
            return found
        with client:
            client.settimeout(PATIENCE)
            while data := client.recv(65536):
                found += data


def test_a_server_that_another_user_runs_gets_nothing(tmp_path: Path, other: int) -> None:
    path = tmp_path / "robot.sock"
    with listening(path, other) as server:
        with pytest.raises(PortError, match=r"runs as .*not yours.*TCP|belongs to .*not yours.*TCP"):
            wirebond.open(f"wirebond://{path}")
        assert received(server) == b""


def test_a_socket_of_another_user_is_not_touched(tmp_path: Path, other: int) -> None:
    path = tmp_path / "robot.sock"
    with listening(path, os.geteuid()) as server:
        give(path, other)
        with pytest.raises(PortError, match=r"belongs to .*not yours"):
            wirebond.open(f"wirebond://{path}")
        assert received(server) == b""


def test_a_folder_that_another_user_made_first_is_not_believed(
    tmp_path: Path, other: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))  # as /tmp: shared
    path = socket_of("robot")
    path.parent.mkdir(mode=0o755)
    with listening(path, os.geteuid()) as server:
        give(path.parent, other)
        with pytest.raises(PortError, match=rf"{path.parent} belongs to .*not yours"):
            wirebond.open("wirebond://robot")
        assert main(["monitor", str(PROTOCOLS / "diffdrive.yaml"), "wirebond://robot"]) == 3
        assert "not yours" in " ".join(capsys.readouterr().err.split())
        assert received(server) == b""


def test_a_link_to_a_folder_is_not_believed_where_another_user_made_it(
    tmp_path: Path, other: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    (tmp_path / "real").mkdir(mode=0o700)
    path = socket_of("robot")
    path.parent.symlink_to(tmp_path / "real")
    give(path.parent, other)
    with listening(path, os.geteuid()) as server:
        with pytest.raises(PortError, match=r"belongs to .*not yours"):
            wirebond.open("wirebond://robot")
        assert received(server) == b""


def test_a_folder_in_which_every_user_can_replace_the_socket_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "shared"
    folder.mkdir()
    path = folder / "robot.sock"
    with listening(path, os.geteuid()) as server:
        folder.chmod(0o777)
        with pytest.raises(PortError, match=r"every user can replace the socket in .*chmod o-w"):
            wirebond.open(f"wirebond://{path}")
        assert received(server) == b""


def test_a_link_does_not_come_back_to_the_server_of_another_user(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    with served.attach() as link:
        own = os.geteuid()
        served.server.close()
        monkeypatch.setattr(whose_server, "peer_user", lambda _: own + 1)
        with wirebond.Server(served.link, served.server.path):
            wait_until(lambda: "not yours" in link.why, "the link says whose server it is")
            assert link.state == "down"


def test_one_s_own_server_is_attached_to_in_a_shared_folder_that_protects_files(served: Served, tmp_path: Path) -> None:
    folder = tmp_path / "shared"
    folder.mkdir()
    folder.chmod(0o1777)  # as /tmp
    with wirebond.Server(served.link, folder / "robot.sock"), wirebond.open(f"wirebond://{folder}/robot.sock") as link:
        assert link.state == "stale"
