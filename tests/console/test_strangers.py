"""A client without the console's token gets a sentence, is slowed down and closed, and does not fill the log."""

from __future__ import annotations

import asyncio
import json
import logging
import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from tests.console.conftest import Desk, hear, make_desk, say
from tests.suspended import stalled
from tests.waiting import PATIENCE, Stopwatch, let_pass, wait_until
from wirebond.console.visitors import Visitors
from wirebond.server import strangers
from wirebond.server.strangers import DELAY, WITHIN

pytestmark = pytest.mark.live

DEEP = [900, 980, 990, 1000, 100_000]  # levels: the first ones just fit on the stack


@pytest.fixture
def locked(tmp_path: Path) -> Iterator[Desk]:
    """A console of this test alone: nobody has tried a wrong token yet."""
    yield from make_desk(tmp_path)


def test_idle_connections_are_closed_and_keep_no_page_out(locked: Desk) -> None:
    with ExitStack() as stack:
        idle = [stack.enter_context(socket.create_connection(("127.0.0.1", locked.port))) for _ in range(300)]
        slow = idle[-1]
        slow.sendall(b"GET / HTTP/1.1\r\nHost: ")  # and never the rest
        assert locked.ask("/api/protocol")[0] == 200
        with locked.attach() as socket_:
            assert "ok" in hear(socket_, lambda said: said.get("re") == 1)
            for one in idle:
                one.settimeout(PATIENCE)
                with suppress(ConnectionResetError):
                    assert one.recv(100) == b""
            say(socket_, {"do": "ask", "id": 2, "what": "state"})  # who has shown the token stays
            assert "ok" in hear(socket_, lambda said: said.get("re") == 2)


def test_a_page_that_was_refused_and_does_not_close_is_closed(locked: Desk) -> None:
    raw = socket.create_connection(("127.0.0.1", locked.port))
    raw.settimeout(PATIENCE)
    upgrade = f"GET /views HTTP/1.1\r\nHost: {locked.host}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
    raw.sendall(f"{upgrade}Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n".encode())
    assert raw.recv(16).startswith(b"HTTP/1.1 101")
    raw.sendall(b"\x81\x82" + bytes(4) + b"{}")  # no token; and no answer to the close frame
    said = b""
    try:
        while data := raw.recv(4096):
            said += data
    except ConnectionResetError:
        pass
    assert b'"token"' in said
    raw.close()


@pytest.fixture
def loop(locked: Desk, monkeypatch: pytest.MonkeyPatch) -> asyncio.AbstractEventLoop:
    """That of the web server."""
    found = []
    enter = Visitors.enter

    def note(visitors: Visitors, transport: asyncio.Transport) -> None:
        found.append(asyncio.get_running_loop())
        enter(visitors, transport)

    monkeypatch.setattr(Visitors, "enter", note)
    assert locked.ask("/api/protocol")[0] == 200
    return found[0]


@pytest.mark.parametrize("says", ["during the stall", "after it"])
def test_a_stall_of_the_server_is_no_silence_of_a_browser(
    locked: Desk, loop: asyncio.AbstractEventLoop, says: str
) -> None:
    request = f"GET /api/protocol HTTP/1.1\r\nHost: {locked.host}\r\nAuthorization: Bearer {locked.token}\r\n\r\n"
    with socket.create_connection(("127.0.0.1", locked.port)) as raw:
        raw.settimeout(PATIENCE)
        assert locked.ask("/api/protocol")[0] == 200  # the server has the connection before this one
        with stalled(loop):
            if says == "during the stall":
                raw.sendall(request.encode())
            let_pass(WITHIN + 0.2)
        assert locked.ask("/api/protocol")[0] == 200  # what was due after the stall is done
        if says == "after it":
            raw.sendall(request.encode())
        assert raw.recv(16).startswith(b"HTTP/1.1 200")


@pytest.mark.parametrize("path", ["/attach", "/views"])
@pytest.mark.parametrize("says", ["during the stall", "after it"])
def test_a_stall_of_the_server_is_no_silence_of_a_program(
    locked: Desk, loop: asyncio.AbstractEventLoop, path: str, says: str
) -> None:
    first = {"do": "attach", "id": 1, "messages": "none", "token": locked.token, "views": {"link": True}}
    with locked.web(path) as found:
        with stalled(loop):
            if says == "during the stall":
                say(found, first)
            let_pass(WITHIN + 0.2)
        assert locked.ask("/api/protocol")[0] == 200  # what was due after the stall is done
        if says == "after it":
            say(found, first)
        assert json.loads(found.recv(timeout=PATIENCE)).get("error") is None


@pytest.mark.parametrize("token_of", ["Console", "short"])
@pytest.mark.parametrize("path", ["/attach", "/views", "/api/protocol"])
def test_after_a_wrong_token_each_wrong_one_waits_and_the_right_one_still_opens(
    tmp_path: Path, path: str, token_of: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wirebond.console.attach_socket.WITHIN", PATIENCE)
    monkeypatch.setattr("wirebond.console.visitors.WITHIN", PATIENCE)
    making = make_desk(tmp_path, **({"token": "robot"} if token_of == "short" else {}))
    locked = next(making)

    def tries(token: str) -> bool:
        if path.startswith("/api"):
            return locked.ask(path, headers={"Authorization": f"Bearer {token}"})[0] == 200
        with locked.web(path) as found:
            say(found, {"do": "attach", "id": 1, "messages": "none", "token": token, "views": {}})
            return json.loads(found.recv(timeout=PATIENCE)).get("error") is None

    assert not tries("wrong")
    for token in (locked.token, "wrong", locked.token):
        watch = Stopwatch()
        assert tries(token) == (token == locked.token)
        if token == "wrong" or token_of == "short":  # one that could be guessed
            assert watch.seconds >= DELAY
    making.close()


@pytest.mark.parametrize("how", ["wait", "leave"])
@pytest.mark.parametrize("is_stalled", [False, True])  # then all of them are found at once
def test_a_flood_of_wrong_tokens_keeps_no_page_out(
    locked: Desk, how: str, is_stalled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(strangers, "DELAY", 30.0)  # as if all of them came within a second
    wrong = f"GET /api/protocol HTTP/1.1\r\nHost: {locked.host}\r\nAuthorization: Bearer wrong\r\n\r\n".encode()
    with ExitStack() as stack:
        if is_stalled:
            goes_on = stall_at_the_next_connection(monkeypatch)
            stack.callback(goes_on.set)
        for _ in range(600):  # more than the web server takes requests at once
            one = socket.create_connection(("127.0.0.1", locked.port))
            one.sendall(wrong)
            if how == "wait":
                stack.enter_context(one)
            else:
                one.close()
        if is_stalled:
            threading.Timer(0.1, goes_on.set).start()  # behind the request
        assert locked.ask("/api/protocol")[0] == 200
        with locked.attach() as page:
            assert "ok" in hear(page, lambda said: said.get("re") == 1)


def stall_at_the_next_connection(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    """The web server stands still there, until this is set."""
    goes_on = threading.Event()
    enter = Visitors.enter

    def wait(visitors: Visitors, transport: asyncio.Transport) -> None:
        assert goes_on.wait(PATIENCE)
        enter(visitors, transport)

    monkeypatch.setattr(Visitors, "enter", wait)
    return goes_on


def test_a_client_with_the_token_does_not_wait_for_the_mistakes_of_others(locked: Desk) -> None:
    visitors = []
    with locked.attach() as page:
        assert "ok" in hear(page, lambda said: said.get("re") == 1)
        assert locked.ask("/api/protocol", headers={"Authorization": "Bearer wrong"})[0] == 401
        for number in range(2, 30):
            say(page, {"do": "ask", "id": number, "what": "state"})
            visitors.append(hear(page, lambda said, id=number: said.get("re") == id))
    assert all("ok" in answer for answer in visitors)


@pytest.mark.parametrize("path", ["/attach", "/views"])
@pytest.mark.parametrize("depth", DEEP)
def test_deep_json_before_the_token_is_a_sentence(
    locked: Desk, path: str, depth: int, caplog: pytest.LogCaptureFixture
) -> None:
    nested = "[" * depth + "]" * depth
    for text in (nested, f'{{"x": {nested}}}', f'{{"token": "{locked.token}", "do": "attach", "x": {nested}}}'):
        with locked.web(path) as found:
            found.send(text)
            said = json.loads(found.recv(timeout=PATIENCE))
            assert said.get("error") in (None, "not_understood", "token")
    assert [record.getMessage() for record in caplog.records if record.levelno >= logging.ERROR] == []


def test_clients_can_make_the_web_server_log_one_line_a_second(locked: Desk, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    watch = Stopwatch()
    for number in range(300):
        with socket.create_connection(("127.0.0.1", locked.port)) as raw:
            raw.settimeout(PATIENCE)
            raw.sendall(b"no http \xff\r\n\r\n" if number % 2 else b"GET / HTTP/1.1\r\nUpgrade: x\r\n\r\n")
            raw.recv(4096)
    with locked.web("/views") as found:
        found.send(b"\xff\xfe", text=True)
        with pytest.raises(ConnectionClosed):
            found.recv(timeout=PATIENCE)
    for _ in range(100):  # pages of another place
        with pytest.raises(InvalidStatus), locked.web("/views", origin="http://elsewhere.example"):
            pass
    seconds = watch.seconds
    for is_news in (True, False):
        lines = [record for record in caplog.records if (record.levelno < logging.WARNING) == is_news]
        assert len([record for record in lines if record.name.startswith("uvicorn")]) <= seconds + 2
    assert "ASGI" not in caplog.text
    wait_until(lambda: locked.ask("/api/protocol")[0] == 200)
