"""A client of a server that sends anything: its program gets a sentence, and its link comes back to a real server."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

import wirebond
from tests.server.conftest import Served
from tests.waiting import PATIENCE, wait_until
from wirebond import LinkDownError, PortError
from wirebond.link.attached import attached_link, words

pytestmark = pytest.mark.live

JUNK = [
    b"\xff" * 64,
    words.framed(words.JSON, b"[]"),
    words.framed(words.JSON, b"3"),
    words.framed(words.JSON, b"\xff\xfe"),
    words.framed(words.JSON, b"[" * 100_000),
    words.framed(words.JSON, b'{"event": "tick"}'),
    words.framed(words.JSON, b'{"event": "control", "holder": 1}'),
    words.framed(words.JSON, b'{"event": "taken", "offsets": 3}'),
    words.framed(words.JSON, b'{"event": "change", "kind": 3, "t_us": "x", "action": []}'),
    words.framed(words.JSON, b'{"event": "reply", "offset": [], "request": 1}'),
    words.framed(words.JSON, b'{"event": "lost", "messages": "many"}'),
    words.framed(words.FRAMES, b"\xff\xff\xff\x7f"),
    words.framed(words.FRAMES, b"\x00" * 11),
]


@contextmanager
def hostile(*answers: bytes) -> Iterator[int]:
    """A port whose every client gets these bytes in answer to its first message."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            while True:
                try:
                    client, _ = server.accept()
                except OSError:
                    return
                with client:
                    client.settimeout(PATIENCE)
                    try:
                        client.recv(65536)
                        client.sendall(b"".join(answers))
                        while client.recv(65536):
                            pass
                    except OSError:
                        pass

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield server.getsockname()[1]
        server.shutdown(socket.SHUT_RDWR)
    thread.join(PATIENCE)


@pytest.mark.parametrize(
    "answer",
    [
        {"re": 1},
        {"re": 1, "ok": 3},
        {"re": 1, "ok": {}, "t": 0, "tick": 0},
        {"re": 1, "error": "strange"},
        {"re": 1, "error": 7, "text": [1]},
    ],
    ids=str,
)
def test_a_first_answer_that_is_none_is_a_sentence(answer: object) -> None:
    with hostile(words.json_message(answer)) as port, pytest.raises(PortError, match=f"127.0.0.1:{port}"):
        wirebond.open(f"wirebond://127.0.0.1:{port}?token=x")


@pytest.mark.parametrize("junk", JUNK, ids=range(len(JUNK)))
def test_junk_after_the_answer_takes_the_link_down_with_a_sentence(served: Served, junk: bytes) -> None:
    with socket.socket(socket.AF_UNIX) as client:
        client.connect(served.server.path or "")
        client.sendall(words.json_message(words.Attach(id=1, messages="none")))
        splitter = words.Splitter(words.MOST_TO_CLIENT)
        said = next(body for _, body in splitter.feed(client.recv(1 << 20)) if b'"re"' in body)
    tick = words.json_message({"event": "tick", "tick": json.loads(said)["tick"]})
    with hostile(words.framed(words.JSON, said), tick, junk) as port:
        sentence = "sent bytes that no Wirebond server sends|is not a Wirebond server: it sent"
        with pytest.raises((LinkDownError, PortError), match=sentence):
            wirebond.open(served.codec, f"wirebond://127.0.0.1:{port}?token=x")


@pytest.mark.parametrize("junk", JUNK, ids=range(len(JUNK)))
def test_a_link_that_gets_junk_says_so_and_comes_back(
    served: Served, junk: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    attach, may_attach = attached_link.attach, threading.Event()

    def attach_late(*arguments: Any, **options: Any) -> Any:
        may_attach.wait(PATIENCE)
        return attach(*arguments, **options)

    with served.attach() as link:
        monkeypatch.setattr(attached_link, "attach", attach_late)
        clients = served.server._owner.clients
        number, client = next(iter(clients.items()))
        served.server._owner.loop.call_soon_threadsafe(client.write, junk)
        wait_until(
            lambda: "sent bytes that no Wirebond server sends" in link.why, lambda: f"why it is down; it is {link.why}"
        )
        may_attach.set()
        wait_until(lambda: number not in clients and len(clients) == 1, "it attaches again")
        wait_until(lambda: link.state != "down", link.why)
        link.send("status_query")


def test_a_link_that_is_closed_while_it_attaches_again_leaves_no_connection(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    attach = attached_link.attach
    begun, closed = threading.Event(), threading.Event()
    made: list[socket.socket] = []

    def attach_late(*arguments: Any, **options: Any) -> Any:
        begun.set()
        closed.wait(PATIENCE)
        attached = attach(*arguments, **options)
        made.append(attached[0])
        return attached

    clients = served.server._owner.clients
    with served.attach():
        monkeypatch.setattr(attached_link, "attach", attach_late)
        served.server._owner.loop.call_soon_threadsafe(next(iter(clients.values())).write, JUNK[0])
        assert begun.wait(PATIENCE)
    closed.set()
    wait_until(lambda: made and made[0].fileno() == -1, "the connection is closed")
    wait_until(lambda: not clients, "the server has no client")
