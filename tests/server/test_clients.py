"""Many clients, slow ones, hostile ones: each hurts itself alone, and the link is never disturbed."""

from __future__ import annotations

import errno
import json
import os
import random
import select
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

import wirebond
from tests.server.conftest import Served
from tests.shared import PROTOCOLS, ROOT, account_closes, few_or_many
from tests.suspended import Suspended, stalled
from tests.waiting import PATIENCE, let_pass, wait_until
from wirebond import LinkDownError, NotInControlError, PortError, UsageError
from wirebond.link.attached import attached_link, words
from wirebond.link.attached.attached_link import AttachedLink
from wirebond.server import Server
from wirebond.server.strangers import WITHIN
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live

READER = """
import sys, wirebond
with wirebond.open(sys.argv[1]) as link:
    print("reads", flush=True)
    for message in link:
        print(message["left_ticks"], flush=True)
"""


class JsonClient:
    """As a client in another language is: a socket, lengths, JSON."""

    def __init__(self, served: Served, **attach: Any) -> None:
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.connect(served.server.path or "")
        self._socket.settimeout(PATIENCE)
        self._splitter = words.Splitter(words.MOST_TO_CLIENT)
        self._waiting: list[dict[str, Any]] = []
        self.send({"do": "attach", "id": 1, "messages": "json", **attach})

    def send(self, value: dict[str, Any]) -> None:
        body = json.dumps(value).encode()
        self._socket.sendall(struct.pack("<IB", len(body) + 1, 0) + body)

    def next(self, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        while True:
            while self._waiting:
                found = self._waiting.pop(0)
                if wanted(found):
                    return found
            data = self._socket.recv(65536)
            assert data, "the server closed the connection"
            self._waiting += [json.loads(body) for _, body in self._splitter.feed(data)]

    def ask(self, **request: Any) -> dict[str, Any]:
        self.send({"id": 77, **request})
        return self.next(lambda said: said.get("re") == 77)

    def close(self) -> None:
        self._socket.close()


@contextmanager
def json_client(served: Served, **attach: Any) -> Iterator[JsonClient]:
    client = JsonClient(served, **attach)
    try:
        yield client
    finally:
        client.close()


def odometry(served: Served, first: int, count: int) -> None:
    for n in range(first, first + count):
        served.pty.write(served.codec.encode("odometry", left_ticks=n, right_ticks=0))


def take(link: wirebond.Link, count: int) -> list[int]:
    found: list[int] = []
    wait_until(
        lambda: len(found) >= count or found.extend(m["left_ticks"] for m in link.receive(0.1)),
        lambda: f"{count} messages; there are {len(found)}",
    )
    return found


@few_or_many(5, 48)
def test_one_stopped_and_one_killed_client_harm_nobody(number: int, served: Served) -> None:
    def reader() -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-c", READER, served.address], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        assert process.stdout is not None
        assert process.stdout.readline() == "reads\n"
        return process

    stopped, killed = reader(), reader()
    links = [served.attach() for _ in range(number)]
    try:
        odometry(served, 0, 50)
        killed.kill()
        with Suspended(stopped.pid):
            for n in range(50, 2000, 50):
                odometry(served, n, 50)
                wait_until(lambda n=n: served.link.stats.receive.frames >= n + 50)
            for link in links:
                assert take(link, 2000) == list(range(2000))
                assert link.stats.dropped_messages == 0
            wait_until(lambda: served.server.client_count == number + 1, "the killed one is gone")
        assert account_closes(served.link.stats.receive)
    finally:
        for link in links:
            link.close()
        for process in (stopped, killed):
            process.kill()
            process.wait()
            assert process.stdout is not None
            process.stdout.close()


def test_a_slow_client_loses_its_own_messages_and_learns_how_many(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wirebond.server.client.MOST_WAITING", 4096)
    with served.attach() as fast, json_client(served) as slow:
        slow.next(lambda said: said.get("re") == 1)
        for n in range(0, 10_000, 100):  # more than sockets hold
            odometry(served, n, 100)
            wait_until(lambda n=n: served.link.stats.receive.frames >= n + 100)
        assert take(fast, 10_000) == list(range(10_000))
        got, lost = [], 0
        while len(got) + lost < 10_000:
            said = slow.next(lambda said: said.get("event") in ("message", "lost", "tick"))
            lost += said.get("messages", 0)
            got += [said["fields"]["left_ticks"]] if said["event"] == "message" else []
        assert lost > 0
        assert got == sorted(set(got))
        assert len(got) + lost == 10_000


# ---- a client in another language


def test_a_client_needs_only_a_socket_and_json(served: Served) -> None:
    with json_client(served, name="shell script") as client:
        welcome = client.next(lambda said: said.get("re") == 1)["ok"]
        assert welcome["protocol"] == "diffdrive"
        assert wirebond.Codec(wirebond.protocol.loads(welcome["text"])).hash == int(welcome["hash"], 16)
        odometry(served, 5, 1)
        message = client.next(lambda said: said.get("event") == "message")
        assert (message["name"], message["fields"]) == ("odometry", {"left_ticks": 5, "right_ticks": 0})
        tick = client.next(lambda said: said.get("event") == "tick")["tick"]
        sent = client.ask(do="send", message="velocity", fields={"linear": 0.5, "angular": 0}, tick=tick)
        assert sent == {"re": 77, "ok": None}
        assert [m["linear"] for m in served.sent()] == [0.5]
        assert served.server.holder == "shell script"
        refused = client.ask(do="send", message="velocity", fields={"linear": 99, "angular": 0}, tick=tick)
        assert refused["error"] == "message"
        assert "velocity.linear = 99 m/s is outside" in refused["text"]


KEYS = """
wirebond: 1
protocol: keys
frame: [magic: 0xA5, length: u8, id: u8, payload: by_length, check: crc-16/modbus]
messages:
  keys:
    id: 1
    sender: host
    fields:
      own:    {type: bytes, size: 2}
      others: {group: {count: to_end, max: 4, fields: {key: {type: bytes, size: 1}}}}
"""


def test_bytes_in_json_are_hexadecimal_digits(tmp_path: Path) -> None:
    proto, pty = wirebond.Codec(wirebond.protocol.loads(KEYS)), PtyPort()
    with wirebond.open(proto, pty.path) as link, Server(link, tmp_path / "s.sock") as server:
        served = Served(proto, pty, link, server, "")
        with json_client(served) as client:
            fields = {"own": "01ff", "others": [{"key": "A0"}, {"key": "a1"}]}
            assert client.ask(do="send", message="keys", fields=fields) == {"re": 77, "ok": None}
            found: list[wirebond.Message] = []
            wait_until(lambda: found.extend(served.sent()) or found)
            assert found[0].fields == {"own": b"\x01\xff", "others": [{"key": b"\xa0"}, {"key": b"\xa1"}]}
            wrong = client.ask(do="send", message="keys", fields={**fields, "own": "0g"})
            assert wrong["text"] == "keys: own is '0g'; expected bytes as hexadecimal digits"
            assert "十六进制" in wrong["text_zh"]
    pty.close()


def test_the_client_in_the_manual_compiles_and_shows_messages(served: Served, tmp_path: Path) -> None:
    text = (ROOT / "docs" / "server.md").read_text()
    (tmp_path / "watch.c").write_text(text.partition("```c client\n")[2].partition("```")[0])
    flags = ["-std=c11", "-D_POSIX_C_SOURCE=200809L", "-Wall", "-Wextra", "-Werror"]
    subprocess.run(["cc", *flags, "watch.c", "-o", "watch"], cwd=tmp_path, check=True)
    with subprocess.Popen([tmp_path / "watch", served.server.path or ""], stdout=subprocess.PIPE) as watch:
        wait_until(lambda: served.server.client_count == 1)
        odometry(served, 5, 1)
        assert watch.stdout is not None
        message = json.loads(watch.stdout.readline())
        assert (message["name"], message["fields"]) == ("odometry", {"left_ticks": 5, "right_ticks": 0})
        watch.kill()


def test_a_request_in_json_gets_its_reply(served: Served) -> None:
    with json_client(served) as client:
        client.send({"do": "send", "id": 9, "message": "status_query", "reply": 10})
        wait_until(lambda: any(m.name == "status_query" for m in served.sent()))
        served.pty.write(served.codec.encode("status", battery=12.0, errors=[], state=[]))
        offset = client.next(lambda said: said.get("event") == "reply" and said["request"] == 9)["offset"]
        reply = client.next(lambda said: said.get("event") == "message")
        assert (reply["name"], reply["offset"]) == ("status", offset)


# ---- refused, each with its sentence


@pytest.mark.parametrize(
    ("body", "sentence"),
    [
        (b"{", "this is not a request that the server knows"),
        (b"[]", "this is not a request that the server knows"),
        (b'{"do": "fly"}', "this is not a request that the server knows"),
        (b'{"do": "beat", "tick": "soon"}', "this is not a request that the server knows"),
        (b"\xff\xfe", "this is not a request that the server knows"),
        (b'{"do": "beat"}', "the first message must be"),
    ],
)
def test_a_first_message_that_is_none_is_refused(served: Served, body: bytes, sentence: str) -> None:
    with socket.socket(socket.AF_UNIX) as raw:
        raw.connect(served.server.path or "")
        raw.settimeout(PATIENCE)
        raw.sendall(words.framed(words.JSON, body))
        data = b"".join(iter(lambda: raw.recv(65536), b""))
        assert sentence.encode() in data


def test_a_browser_and_rubbish_get_no_further(served: Served) -> None:
    for data in (b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", bytes(64), os.urandom(64) + b"\xff" * 4):
        with socket.create_connection(("127.0.0.1", served.server.port or 0)) as raw:
            raw.settimeout(PATIENCE)
            raw.sendall(data)
            said = b"".join(iter(lambda: raw.recv(65536), b""))
            assert b"not_understood" in said or b"attach" in said


@few_or_many(400, 40_000)
def test_fuzzed_messages_disturb_nobody(number: int, served: Served, caplog: pytest.LogCaptureFixture) -> None:
    source = random.Random(number)
    good = [msgspec.json.encode(kind()) for kind in words.Request.__args__]
    with served.attach() as watcher:
        for n in range(number):
            with socket.socket(socket.AF_UNIX) as raw:
                raw.connect(served.server.path or "")
                bodies = [msgspec.json.encode(words.Attach())] * source.choice([0, 1, 1])
                for _ in range(source.randrange(1, 6)):
                    body = bytearray(source.choice(good))
                    for _ in range(source.choice([0, 0, 1, 3])):
                        body[source.randrange(len(body))] = source.randrange(256)
                    bodies.append(bytes(body))
                stream = bytearray(b"".join(words.framed(words.JSON, body) for body in bodies))
                if source.random() < 0.2:
                    stream[source.randrange(len(stream))] ^= 1 << source.randrange(8)
                raw.sendall(stream[: source.choice([len(stream), source.randrange(len(stream))])])
            if n % 100 == 0:
                if watcher.stopped:  # anybody may
                    watcher.release_stop()
                odometry(served, n % 30_000, 1)
                assert take(watcher, 1)[-1:] == [n % 30_000]
        wait_until(lambda: served.server.client_count == 1)
    assert [record for record in caplog.records if record.name == "asyncio"] == []


@pytest.mark.parametrize(
    "request_",
    [
        {"do": "set_address", "address": -1},
        {"do": "recover", "action": 10**30},
        {"do": "stop_repeating", "message": "velocity", "address": -5},
        {"do": "end_safely", "message": "velocity", "address": 10**30},
        {"do": "take_tap", "tap": 10**30},
        {"do": "note", "text": "[]"},
        {"do": "send", "message": "odometry"},
        {"do": "send", "message": "nothing"},
        {"do": "repeat", "message": "velocity", "fields": {"linear": 0, "angular": 0}, "hold": 1e9, "tick": 0},
    ],
)
def test_a_request_that_cannot_be_is_refused_and_the_client_stays(served: Served, request_: dict[str, Any]) -> None:
    with json_client(served) as client:
        answer = client.ask(**request_)
        assert answer["error"] in ("refused", "message")
        assert client.ask(do="ask", what="state") == {"re": 77, "ok": "stale"}


def test_after_a_leave_nothing_comes(served: Served) -> None:
    with json_client(served) as client:
        assert client.ask(do="leave") == {"re": 77, "ok": "left"}
        client.send({"do": "beat", "tick": 1})
        assert client.ask(do="ask", what="state")["ok"] == "stale"


def test_silent_clients_are_closed(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wirebond.server.owner.WITHIN", 0.05)
    with socket.socket(socket.AF_UNIX) as raw:
        raw.connect(served.server.path or "")
        raw.settimeout(PATIENCE)
        assert b"did not come within" in b"".join(iter(lambda: raw.recv(65536), b""))


def test_a_stall_of_the_server_is_no_silence_of_its_clients(served: Served) -> None:
    owner = served.server._owner
    with socket.socket(socket.AF_UNIX) as raw:
        raw.connect(served.server.path or "")
        raw.settimeout(PATIENCE)
        wait_until(lambda: owner.waiting, "the server has the connection")
        with stalled(owner.loop):
            let_pass(WITHIN + 0.2)
        with json_client(served) as other:  # what was due after the stall is done
            assert other.ask(do="ask", what="state")["ok"] == "stale"
        body = json.dumps({"do": "attach", "id": 1, "messages": "json"}).encode()
        raw.sendall(struct.pack("<IB", len(body) + 1, 0) + body)
        said = b""
        while b'"ok"' not in said:
            came = raw.recv(65536)
            assert came, said
            said += came


def test_too_many_clients_get_a_sentence(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wirebond.server.owner.MOST_CLIENTS", 3)
    links = [served.attach() for _ in range(3)]
    try:
        with pytest.raises(PortError, match="as many clients as it takes"):
            served.attach()
    finally:
        for link in links:
            link.close()


@few_or_many(300, 10_000)
def test_connections_that_do_nothing_leave_the_clients_alone(number: int, served: Served) -> None:
    with served.attach() as watcher:
        waiting = []
        try:
            for _ in range(number):
                raw = socket.socket(socket.AF_UNIX)
                raw.settimeout(PATIENCE)
                wait_until(
                    lambda raw=raw: raw.connect_ex(served.server.path or "") != errno.EAGAIN, "space in the queue"
                )
                waiting.append(raw)
                if len(waiting) > 300:
                    waiting.pop(0).close()
            odometry(served, 7, 1)
            assert take(watcher, 1) == [7]
            watcher.send("velocity", linear=0.5, angular=0.0)
        finally:
            for raw in waiting:
                raw.close()


@pytest.mark.parametrize("token", ["", "wrong", "señor"])
def test_a_wrong_token_is_refused(served: Served, tmp_path: Path, token: str) -> None:
    with Server(served.link, tcp=("127.0.0.1", 0), token="right") as server:
        address = f"wirebond://127.0.0.1:{server.port}"
        with pytest.raises(PortError, match="the token is missing or wrong"):
            wirebond.open(f"{address}?token={token}" if token else address)
        with wirebond.open(f"{address}?token=right") as link:
            assert link.state == "stale"


@pytest.mark.parametrize("host", ["0.0.0.0", "127.0.0.1"])
def test_a_token_is_made_for_tcp_on_loopback_too(served: Served, host: str) -> None:
    with Server(served.link, tcp=(host, 0)) as server:
        assert len(server.token or "") > 16
        with pytest.raises(PortError, match="the token is missing or wrong"):
            wirebond.open(f"wirebond://127.0.0.1:{server.port}")
        with wirebond.open(f"wirebond://127.0.0.1:{server.port}?token={server.token}") as link:
            assert link.state == "stale"


@pytest.mark.parametrize(
    ("address", "sentence"),
    [
        ("wirebond://", "has no valid server name"),
        ("wirebond://a b", "has no valid server name"),
        ("wirebond://host:port", "has no valid server name"),
        ("wirebond://name/else", "has a path after"),
        ("wirebond:///x?speed=1", "has more than a server's name"),
        ("wirebond:///" + "x" * 200, "is too long for a socket"),
        ("wirebond:///run/a\0b", "has a zero byte"),
    ],
)
def test_an_invalid_address_is_refused(address: str, sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence):
        wirebond.open(address)


@pytest.mark.usefixtures("real_ages")
def test_a_missing_server_is_reported(tmp_path: Path) -> None:
    with pytest.raises(PortError, match=r"no server runs at .*start one with `wirebond serve FILE PORT`"):
        wirebond.open(f"wirebond://{tmp_path}/none.sock")
    with socket.create_server(("127.0.0.1", 0)) as other:
        other.settimeout(PATIENCE)
        with pytest.raises(PortError, match="does not answer within"):
            wirebond.open(f"wirebond://127.0.0.1:{other.getsockname()[1]}")


def test_a_server_of_another_protocol_is_reported(served: Served) -> None:
    with pytest.raises(UsageError, match="attach with the file that the server was given"):
        wirebond.open(PROTOCOLS / "pid_tuner.yaml", served.address)


def test_two_servers_do_not_share_a_socket(served: Served) -> None:
    with pytest.raises(PortError, match="another server listens at"):
        Server(served.link, served.server.path)


def test_a_reply_whose_answer_leaves_before_it_comes_reaches_the_client(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The link's thread says first whose a reply is, and then gives it; the server's thread may write in between."""
    owner = served.server._owner
    note = owner.note_answer

    def note_and_give(*answer: Any) -> None:
        note(*answer)
        given = threading.Event()
        owner.loop.call_soon_threadsafe(lambda: (owner.give(), given.set()))
        assert given.wait(PATIENCE)

    monkeypatch.setattr(owner, "note_answer", note_and_give)
    with served.attach() as link:
        wait = link.begin_request("status_query", {}, PATIENCE)
        wait_until(served.sent, "the request leaves")
        served.pty.write(served.codec.encode("status", battery=12.0, errors=[], state=[]))
        assert wait()["battery"] == 12


def test_a_program_that_stood_still_does_not_take_that_for_the_servers_silence(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As behind a suspended computer: the time for the answer is over, and the answer lies in the socket."""

    class AsBehindAStall(threading.Event):
        stood_still = False

        def wait(self, timeout: float | None = None) -> bool:
            if not self.stood_still and timeout is not None:
                self.stood_still = True
                return False
            return super().wait(timeout)

    class Call(attached_link._Call):
        def __init__(self) -> None:
            super().__init__()
            self.done = AsBehindAStall()

    with wirebond.open(served.address) as link:
        monkeypatch.setattr(attached_link, "_Call", Call)
        assert link.stats.send.sent == 0
        link.take_control()
        link.internals.engine.send_all([(0, served.codec.encode("velocity", linear=0, angular=0))])
        assert link.stats.send.sent >= 1


def test_an_attached_link_comes_back_when_the_server_does(tmp_path: Path) -> None:
    proto, pty = wirebond.load(PROTOCOLS / "diffdrive.yaml"), PtyPort()
    path = tmp_path / "server.sock"
    with wirebond.open(proto, pty.path) as own:
        first = Server(own, path)
        with wirebond.open(f"wirebond://{path}") as link:
            link.send("velocity", linear=0.5, angular=0.0)
            first.close()
            wait_until(lambda: link.state == "down")
            assert "no server runs" in link.why or "is gone" in link.why
            with pytest.raises(LinkDownError, match=r"velocity was not sent: .*wirebond serve"):
                link.send("velocity", linear=0.5, angular=0.0)
            with Server(own, path):
                wait_until(lambda: link.state != "down")
                assert link.control.holder is None
                with pytest.raises(NotInControlError, match=r"take_control\(\)"):
                    link.send("velocity", linear=0.25, angular=0.0)
                link.take_control()
                link.send("velocity", linear=0.25, angular=0.0)
    pty.close()


def test_a_connection_that_a_writer_finds_broken_before_the_reader_is_made_anew(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    with served.attach() as link:
        engine = link.internals.engine
        assert isinstance(engine, AttachedLink)
        broken = threading.Event()

        def poll() -> select.poll:
            if not broken.is_set():
                broken.set()
                engine._disconnect("a write failed")
            return select.poll()

        monkeypatch.setattr(attached_link, "select", SimpleNamespace(poll=poll, POLLIN=select.POLLIN))
        assert broken.wait(PATIENCE)
        wait_until(lambda: link.state != "down", "the link comes back")
        served.pty.write(served.codec.encode("odometry", left_ticks=3, right_ticks=-3))
        assert [message.name for message in link.receive(timeout=PATIENCE)] == ["odometry"]


def test_two_programs_tune_parameters_at_once_and_get_their_own_answers(tmp_path: Path) -> None:
    with wirebond.open(PROTOCOLS / "native.yaml", "sim:") as own, Server(own, tmp_path / "s.sock") as server:
        links = [wirebond.open(own.codec, f"wirebond://{server.path}") for _ in range(2)]
        try:
            names = list(links[0].parameters.list())[:2]
            assert len(names) == 2
            found: dict[int, list[float]] = {0: [], 1: []}

            def tune(n: int) -> None:
                for step in range(20):
                    links[n].parameters.set(names[n], float(step % 3))
                    found[n].append(links[n].parameters.get(names[n]))

            threads = [threading.Thread(target=tune, args=(n,)) for n in range(2)]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            assert found == {n: [float(step % 3) for step in range(20)] for n in range(2)}
        finally:
            for link in links:
                link.close()


def test_a_command_cannot_be_sent_under_another_name(served: Served) -> None:
    """A client without control cannot move the robot by giving its frame a harmless name."""
    with served.attach() as driver, json_client(served) as other:
        driver.send("velocity", linear=0.5, angular=0.0)
        frame = served.codec.encode("velocity", linear=1.0, angular=0.0)
        encoded = msgspec.json.decode(msgspec.json.encode(frame))
        answer = other.ask(do="send", message="status_query", frame=encoded, tick=1)
        assert answer["error"] == "message"
        both = msgspec.json.decode(msgspec.json.encode(served.codec.encode("status_query") + frame))
        assert other.ask(do="send", message="status_query", frame=both, tick=1)["error"] == "message"
        assert [m["linear"] for m in served.sent(0.1) if m.name == "velocity"] == [0.5]
