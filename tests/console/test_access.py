"""Access to the console: token, Host and Origin; and the sentences for those that have none."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from tests.console.conftest import Desk, hear, make_desk, say
from tests.waiting import PATIENCE
from wirebond.console import Console
from wirebond.console.guard import Guard
from wirebond.errors import PortError, UsageError
from wirebond.link.attached.kept_token import kept_token

pytestmark = pytest.mark.live

TOKEN = "to-k_en.~9"


@pytest.fixture(scope="module")
def locked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    """A console that wants a token."""
    yield from make_desk(tmp_path_factory.mktemp("locked"), token=TOKEN)


@pytest.mark.parametrize("path", ["/attach", "/views"])
@pytest.mark.parametrize("token", ["", "wrong", 7, None])
def test_a_websocket_without_the_token_gets_a_sentence_and_is_closed(locked: Desk, path: str, token: object) -> None:
    with locked.web(path) as socket:
        say(socket, {"do": "attach", "id": 5, "token": token} if path == "/attach" else {"token": token, "views": {}})
        said = json.loads(socket.recv(timeout=PATIENCE))
        assert said["error"] in ("token", "not_understood") and said["text"]
        with pytest.raises(ConnectionClosed) as closed:
            socket.recv(timeout=PATIENCE)
        assert closed.value.rcvd is not None and closed.value.rcvd.code == 1008
    assert locked.server.client_count == 0


def test_the_token_opens_both_websockets_and_the_api_and_is_in_the_address(locked: Desk) -> None:
    with locked.web("/attach") as socket:
        say(socket, {"do": "attach", "id": 5, "token": TOKEN})
        assert hear(socket, lambda said: said.get("re") == 5)["ok"]["protocol"] == "diffdrive"
    with locked.web("/views") as socket:
        say(socket, {"token": TOKEN, "views": {}})
        assert hear(socket, bool)["view"] == "hello"
    assert locked.ask("/api/protocol", headers={"Authorization": ""})[0] == 401
    assert locked.ask("/api/protocol", headers={"Authorization": "Bearer wrong"})[0] == 401
    assert locked.ask("/api/protocol", headers={"Authorization": f"Bearer {TOKEN}"})[0] == 200
    assert locked.ask("/", headers={"Authorization": ""})[0] == 200  # the page itself has nothing of the robot


@pytest.mark.parametrize("path", ["/attach", "/views"])
@pytest.mark.parametrize("origin", ["http://evil.example", "http://127.0.0.1:1", "null", "file://"])
def test_a_page_of_another_place_cannot_open_a_websocket(desk: Desk, path: str, origin: str) -> None:
    with pytest.raises(InvalidStatus) as refused, desk.web(path, origin=origin):
        pass
    assert refused.value.response.status_code == 403


def test_the_console_s_own_page_can(desk: Desk) -> None:
    with desk.web("/views", origin=f"http://{desk.host}") as socket:
        say(socket, {"token": desk.token, "views": {}})
        assert hear(socket, bool)["view"] == "hello"


def test_a_post_of_another_page_is_refused_and_no_answer_names_an_origin(desk: Desk) -> None:
    status, answer = desk.ask("/api/check", {"text": "x"}, {"Origin": "http://evil.example"})
    assert status == 403 and "evil.example" in answer["text"]
    assert desk.ask("/api/check", {"text": "x"}, {"Origin": f"http://{desk.host}"})[0] == 200


@pytest.mark.parametrize("host", ["evil.example:{port}", "evil.example", "127.0.0.1:1", "", "[", "127.0.0.1:{port}:1"])
def test_a_name_that_was_bound_anew_to_this_computer_is_refused(desk: Desk, host: str) -> None:
    status, answer = desk.ask("/api/protocol", headers={"Host": host.format(port=desk.port)})
    assert status in (400, 403)
    if status == 403:
        assert "not this console" in answer["text"]


def test_a_browser_that_is_refused_shows_a_sentence(desk: Desk) -> None:
    status, page = desk.ask("/", headers={"Host": "<b>robot:1", "Accept": "text/html,*/*"})
    assert status == 403
    assert b"not this console" in page and b"&lt;b&gt;robot" in page and b"<b>" not in page


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1", "[::1]", "192.168.1.7"])
def test_addresses_of_a_computer_are_no_names_that_can_be_bound_anew(host: str) -> None:
    guard = Guard(8765, TOKEN)
    assert guard.refuses(f"{host}:8765", None) is None
    assert guard.refuses(f"{host}:8765", f"http://{host}:8765") is None
    assert guard.refuses(f"{host}:8765", f"http://{host}") is not None


def test_the_token_is_after_the_number_sign_where_no_log_gets_it() -> None:
    with Console(port=0, token=TOKEN) as console:
        assert console.address == f"http://127.0.0.1:{console.port}/#token={TOKEN}"


@pytest.mark.parametrize("host", ["0.0.0.0", "127.0.0.1", "localhost"])
def test_a_token_is_made_on_loopback_too_which_all_users_of_a_computer_reach(host: str) -> None:
    with Console(host, 0) as console, Console(host, 0) as other:
        assert len(console.token) > 16
        assert console.token != other.token
        assert console.address.endswith(f"/#token={console.token}")


def test_another_user_of_this_computer_reads_and_drives_nothing(desk: Desk) -> None:
    for path, said in (("/attach", {"do": "attach", "id": 1}), ("/views", {"views": {"link": True}})):
        with desk.web(path) as socket:
            say(socket, said)
            assert json.loads(socket.recv(timeout=PATIENCE))["error"] == "token"
    for path in ("protocol", "log", "recordings", "ports", "document"):
        assert desk.ask(f"/api/{path}", headers={"Authorization": ""})[1]["error"] == "token"
    assert desk.ask("/api/disconnect", {"over": True}, {"Authorization": ""})[0] == 401
    assert desk.server.holder is None


def test_a_server_that_starts_again_has_the_same_token_and_no_other_user_can_read_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    token = kept_token()
    assert kept_token() == token
    path = tmp_path / "wirebond" / "token"
    assert path.stat().st_mode & 0o777 == 0o600 and path.parent.stat().st_mode & 0o777 == 0o700
    path.chmod(0o644)  # others may have read it
    renewed = kept_token()
    assert renewed != token and kept_token() == renewed
    path.unlink()
    (tmp_path / "theirs").write_text(token)
    path.symlink_to(tmp_path / "theirs")
    assert kept_token() not in (token, renewed)
    assert not path.is_symlink()
    path.parent.chmod(0o777)  # where none can be kept, each server has its own
    assert kept_token() != kept_token()


@pytest.mark.parametrize("token", ["", "a b", "tök", "a#b", "a/b"])
def test_a_token_that_an_address_or_a_header_cannot_carry_is_refused(token: str) -> None:
    with pytest.raises(UsageError, match="use only letters, digits"):
        Console(port=0, token=token)


def test_a_port_that_is_taken_is_a_sentence(desk: Desk) -> None:
    with pytest.raises(PortError, match=r"cannot listen at 127\.0\.0\.1:\d+.*choose"):
        Console(port=desk.port)
