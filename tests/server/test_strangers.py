"""Connections that have not shown the token: they keep nobody out, try few tokens, and fill no log."""

from __future__ import annotations

import dataclasses
import json
import logging
import os
import re
import resource
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

import wirebond
from tests.server.conftest import Served
from tests.shared import PROTOCOLS
from tests.waiting import PATIENCE, Stopwatch, wait_until
from wirebond import PortError
from wirebond.link.attached import words
from wirebond.seldom import Seldom
from wirebond.server import Server
from wirebond.server.strangers import DELAY, LONG, MOST, Strangers, WrongTokens

pytestmark = pytest.mark.live

LONG_TOKEN = "n" * LONG
DEEP = [900, 990, 1000, 8000]  # levels: the first ones just fit on the stack


# ---- the rules


def test_where_there_are_too_many_strangers_the_one_goes_that_said_nothing_for_longest() -> None:
    found: Strangers[str] = Strangers(3)
    assert [found.enter(who) for who in "abc"] == [None, None, None]
    assert found.enter("a") is None  # it says something
    assert found.enter("d") == "b"
    found.leave("c")
    assert found.enter("e") is None
    assert found.enter("f") == "a"


def test_a_stranger_whose_token_could_be_guessed_makes_way_for_nobody_while_it_waits() -> None:
    found: Strangers[str] = Strangers(2)
    for who in "ab":
        found.enter(who)
        found.wait(who, makes_way=False)
    assert found.enter("c") == "c"
    assert "a" in found and "b" in found and "c" not in found


def test_a_stranger_whose_long_token_is_wrong_goes_first() -> None:
    found: Strangers[str] = Strangers(3)
    for who in "abc":
        found.enter(who)
    found.wait("c", makes_way=True)
    found.wait("b", makes_way=True)
    assert [found.enter(who) for who in "defg"] == ["b", "c", "a", "d"]


def test_a_token_waits_after_a_wrong_one_from_the_same_address_for_some_time() -> None:
    for token, delay_of_right in (("short", DELAY), (LONG_TOKEN, 0.0)):
        wrong = WrongTokens(token)
        assert wrong.delay("here", 0.0, is_right=False) == 0.0
        wrong.note("here", 0.0)
        assert wrong.delay("here", 1.0, is_right=False) == DELAY
        assert wrong.delay("here", 1.0, is_right=True) == delay_of_right
        assert wrong.delay("there", 1.0, is_right=False) == 0.0
        assert wrong.delay("here", 100.0, is_right=False) == 0.0


def test_addresses_that_tried_are_bounded() -> None:
    wrong = WrongTokens(LONG_TOKEN)
    for number in range(5000):
        wrong.note(str(number), 0.0)
    assert wrong.delay("0", 1.0, is_right=False) == 0.0
    assert wrong.delay("4999", 1.0, is_right=False) == DELAY
    assert len(wrong._last) <= 1024


def test_one_report_a_second_passes_and_says_how_many_did_not() -> None:
    seldom = Seldom()
    assert seldom.passes(0.0) == 0
    assert [seldom.passes(0.1 * n) for n in range(1, 10)] == [None] * 9
    assert seldom.passes(1.0) == 9
    assert seldom.passes(2.5) == 0


# ---- at TCP


def tcp(served: Served) -> socket.socket:
    found = socket.create_connection(("127.0.0.1", served.server.port or 0), PATIENCE)
    found.settimeout(PATIENCE)
    return found


def tcp_address(served: Served, token: str | None = None) -> str:
    return f"wirebond://127.0.0.1:{served.server.port}?token={token or served.server.token}"


def test_idle_connections_keep_no_program_out(served: Served) -> None:
    with ExitStack() as stack:
        idle = [stack.enter_context(tcp(served)) for _ in range(300)]  # more than a server takes clients
        with wirebond.open(served.codec, tcp_address(served)) as link, served.attach() as other:
            assert (link.state, other.state) == ("stale", "stale")
            for one in idle:  # each is closed, the newest after 2 s
                while True:
                    try:
                        if not one.recv(4096):
                            break
                    except ConnectionResetError:
                        break
            assert link.state == "stale"


@pytest.fixture
def guessable(served: Served) -> Iterator[Served]:
    """Serve the same link with a token that could be guessed."""
    with Server(served.link, tcp=("127.0.0.1", 0), token="robot") as server:
        yield dataclasses.replace(served, server=server)


@pytest.mark.parametrize("which", ["served", "guessable"])
def test_after_a_wrong_token_each_wrong_one_waits_and_the_right_one_still_opens(
    which: str, request: pytest.FixtureRequest
) -> None:
    served: Served = request.getfixturevalue(which)
    with pytest.raises(PortError, match="the token is missing or wrong"):
        wirebond.open(served.codec, tcp_address(served, "wrong"))
    watch = Stopwatch()
    with wirebond.open(served.codec, tcp_address(served)) as link:
        assert which == "served" or watch.seconds >= DELAY
        assert link.state == "stale"
    watch = Stopwatch()
    with pytest.raises(PortError, match="the token is missing or wrong"):
        wirebond.open(served.codec, tcp_address(served, "wrong"))
    assert watch.seconds >= DELAY


def test_a_flood_of_wrong_tokens_keeps_no_program_out(served: Served) -> None:
    wrong = words.json_message(words.Attach(id=1, token="wrong"))
    with ExitStack() as stack:
        for _ in range(2 * MOST):
            stack.enter_context(tcp(served)).sendall(wrong)
        with wirebond.open(served.codec, tcp_address(served)) as link:
            assert link.state == "stale"


@pytest.mark.parametrize("token", [r"\ud800", "\u20ac", "\x00", "a" * 10_000])
def test_a_token_of_any_characters_is_a_sentence(served: Served, token: str, caplog: pytest.LogCaptureFixture) -> None:
    with tcp(served) as raw:
        raw.sendall(words.framed(words.JSON, f'{{"do": "attach", "id": 1, "token": "{token}"}}'.encode()))
        said = b""
        while data := raw.recv(65536):
            said += data
        assert b"not_understood" in said or b'"token"' in said
    assert not [record for record in caplog.records if record.levelno >= logging.WARNING]


def test_a_stranger_cannot_make_the_server_keep_a_mebibyte(served: Served) -> None:
    with tcp(served) as raw:
        raw.sendall((1 << 20).to_bytes(4, "little") + b"\x00")
        said = raw.recv(65536)
        assert b"not_understood" in said
        assert raw.recv(1) == b""
    with tcp(served) as raw:  # who has shown the token may say as much
        raw.sendall(words.json_message(words.Attach(id=1, token=served.server.token or "", messages="none")))
        raw.sendall(words.json_message(words.Annotate(id=2, recording="none", text="x" * 1_000_000)))
        splitter, answers = words.Splitter(words.MOST_TO_CLIENT), list[int]()
        while 2 not in answers:
            said_all = [json.loads(body) for _, body in splitter.feed(raw.recv(65536))]
            answers += [one["re"] for one in said_all if "re" in one]


def test_requests_that_follow_a_token_which_waits_are_answered_in_their_order(guessable: Served) -> None:
    served = guessable
    with pytest.raises(PortError):
        wirebond.open(served.codec, tcp_address(served, "wrong"))
    first = words.json_message(words.Attach(id=1, token=served.server.token or "", messages="none"))
    asked = [words.json_message(words.Ask(id=number, what="state")) for number in range(2, 6)]
    with tcp(served) as raw:
        raw.sendall(first + b"".join(asked[:2]) + asked[2][:7])
        raw.sendall(asked[2][7:] + asked[3])
        splitter, answers = words.Splitter(words.MOST_TO_CLIENT), list[int]()
        while len(answers) < 5:
            said = [json.loads(body) for _, body in splitter.feed(raw.recv(65536))]
            answers += [one["re"] for one in said if "re" in one]
        assert answers == [1, 2, 3, 4, 5]


@pytest.mark.parametrize("depth", DEEP)
def test_deep_json_before_the_token_is_a_sentence(served: Served, depth: int, caplog: pytest.LogCaptureFixture) -> None:
    nested = b"[" * depth + b"]" * depth
    for body in (nested, b'{"do": "attach", "x": ' + nested + b"}", b'{"do": "attach", "token": ' + nested + b"}"):
        with tcp(served) as raw:
            raw.sendall(words.framed(words.JSON, body))
            said = b""
            while data := raw.recv(65536):
                said += data
            assert b"not_understood" in said or b'"token"' in said
    assert not [record for record in caplog.records if record.levelno >= logging.ERROR]


# ---- a whole server


@dataclass
class Running:
    """A process of ``wirebond serve`` with a page and a TCP port."""

    process: subprocess.Popen[bytes]
    log: Path
    page: str  # host and port
    page_token: str
    tcp: str  # address, with the token

    def said(self) -> str:
        return self.log.read_text()

    def open_files(self) -> int:
        return sum(1 for _ in Path(f"/proc/{self.process.pid}/fd").iterdir())

    def ask(self, path: str, token: str = "") -> bytes:
        request = urllib.request.Request(f"http://{self.page}{path}", headers={"Authorization": f"Bearer {token}"})
        with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
            return bytes(answer.read())


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Running]:
    log = tmp_path / "log"
    command = [str(Path(sys.executable).with_name("wirebond")), "serve", str(PROTOCOLS / "diffdrive.yaml"), "sim:"]
    more = ["--web", "127.0.0.1:0", "--no-browser", "--tcp", "127.0.0.1:0"]
    environment = {**os.environ, "XDG_RUNTIME_DIR": str(tmp_path), "COLUMNS": "200"}
    with log.open("wb") as file, subprocess.Popen([*command, *more], stderr=file, env=environment) as process:
        try:
            wait_until(lambda: "http://" in log.read_text() or process.poll() is not None, "the server's address")
            told = log.read_text()
            page = re.search(r"http://(\S+?)/#token=(\S+)", told)
            other = re.search(r"wirebond://127\S+", told)
            assert page is not None and other is not None, told
            yield Running(process, log, page[1], page[2], other[0])
        finally:
            process.terminate()


@contextmanager
def many_files() -> Iterator[None]:
    """This process may open as many files as the test needs."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and hard < 4096:
        pytest.skip("the system lets a process open too few files")
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, 4096), hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.mark.parametrize("at", ["page", "tcp"])
def test_eleven_hundred_idle_connections_lock_nobody_out_and_fill_no_log(running: Running, at: str) -> None:
    host, _, port = (running.page if at == "page" else running.tcp.split("//")[1].split("?")[0]).rpartition(":")
    most_files = 0
    with many_files(), ExitStack() as stack:
        for number in range(1100):
            stack.enter_context(socket.create_connection((host, int(port)), PATIENCE))
            if number % 100 == 99:
                most_files = max(most_files, running.open_files())
        assert b"<!doctype html>" in running.ask("/").lower()
        assert json.loads(running.ask("/api/protocol", running.page_token))["name"] == "diffdrive"
        with wirebond.open(running.tcp) as link:
            assert link.request("status_query", timeout=PATIENCE)
        assert most_files < 600  # of 1 024, so that the port can be opened again
    wait_until(lambda: running.open_files() < 100, "the connections end")
    assert "Traceback" not in running.said()
    assert len(running.said()) < 10_000
