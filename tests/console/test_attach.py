"""`/attach`: the protocol of docs/server.md over a WebSocket, with the rules of control."""

from __future__ import annotations

import json
import random
import socket as sockets
import time
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed

import wirebond
from tests.console.conftest import Desk, hear, say
from tests.waiting import PATIENCE, wait_until
from wirebond.console import attach_socket
from wirebond.link.attached import words

pytestmark = pytest.mark.live

SAFE = {"linear": 0.0, "angular": 0.0}


def over_unix(desk: Desk, requests: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The answers to these requests at the Unix socket."""
    answers = []
    with sockets.socket(sockets.AF_UNIX) as found:
        found.connect(str(desk.server.path))
        found.settimeout(PATIENCE)
        splitter = words.Splitter(words.MOST_TO_CLIENT)
        for request in requests:
            found.sendall(words.json_message(request))
            while not any(answer.get("re") == request["id"] for answer in answers):
                data = found.recv(1 << 16)
                assert data
                answers += [json.loads(body) for kind, body in splitter.feed(data) if kind == words.JSON]
    return [answer for answer in answers if "re" in answer]


def over_web(desk: Desk, requests: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Send the same requests over a WebSocket."""
    answers = []
    with desk.web("/attach") as socket:
        for request in requests:
            say(socket, request)
            answers.append(hear(socket, lambda said, id=request["id"]: said.get("re") == id))
    return answers


@pytest.mark.usefixtures("real_ages")
def test_the_answers_are_those_of_the_unix_socket(desk: Desk) -> None:
    asked: list[dict[str, Any]] = [
        {"do": "attach", "messages": "none", "name": "a"},
        {"do": "ask", "what": "why"},
        {"do": "ask", "what": "peer"},
        {"do": "ask", "what": "line"},
        {"do": "take"},
        {"do": "send", "message": "velocity", "fields": SAFE, "tick": 0},
        {"do": "send", "message": "nothing", "fields": {}},
        {"do": "send", "message": "status_query", "fields": {"no": 1}},
        {"do": "take_tap", "tap": 9},
        {"do": "release"},
        {"do": "recordings"},
        {"do": "leave"},
    ]
    asked[0]["token"] = desk.token  # the Unix socket needs none
    wait_until(
        lambda: desk.server._owner.book.ticks.newest * words.TICK_EVERY > 2 * words.OLDEST_COMMAND, "tick 0 is old"
    )
    requests = [{"id": number + 1, **request} for number, request in enumerate(asked)]
    for mine, its in zip(over_web(desk, requests), over_unix(desk, requests), strict=True):
        for answer in (mine, its):  # what differs by its time
            for key in ("t", "tick"):
                answer.pop(key, None)
            if isinstance(answer.get("ok"), dict):
                answer["ok"].pop("client", None)
            if answer.get("error") == "late":
                answer["text"] = answer["text_zh"] = ""
        assert mine == its


def test_records_of_frames_come_as_binary_messages(desk: Desk) -> None:
    with desk.attach(messages="frames") as socket:
        hear(socket, lambda said: said.get("re") == 1)
        desk.send("odometry", left_ticks=7, right_ticks=-7)
        while not isinstance(record := socket.recv(timeout=PATIENCE), bytes):
            pass
        assert desk.codec.encode("odometry", left_ticks=7, right_ticks=-7) in record


def test_an_invalid_request_ends_the_connection_with_a_sentence(desk: Desk) -> None:
    nothing = json.dumps({"do": "nothing", "token": desk.token})
    for wrong in ["", "[]", "1", "{", nothing, "\ud800".encode("utf-8", "surrogatepass"), b"\0\1"]:
        with desk.web("/attach") as socket:
            socket.send(wrong)
            said = json.loads(socket.recv(timeout=PATIENCE))
            assert said["error"] in ("not_understood", "attach_first") and said["text"]
            with pytest.raises(ConnectionClosed):
                socket.recv(timeout=PATIENCE)
    assert desk.server.client_count == 0


def test_a_silent_client_gets_a_sentence_and_is_closed(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(attach_socket, "WITHIN", 0.05)
    with desk.web("/attach") as socket:
        assert json.loads(socket.recv(timeout=PATIENCE))["error"] == "silent"


def drive(desk: Desk, socket: Any) -> int:
    """Take control and drive. The last tick that was seen."""
    tick = hear(socket, lambda said: said.get("event") == "tick")["tick"]
    say(socket, {"do": "take", "id": 2})
    assert "ok" in hear(socket, lambda said: said.get("re") == 2)
    fields = {"linear": 1.0, "angular": 0.0}
    say(socket, {"do": "repeat", "id": 3, "message": "velocity", "fields": fields, "tick": tick, "hold": 60.0})
    assert "ok" in hear(socket, lambda said: said.get("re") == 3)
    wait_until(lambda: any(message.fields == fields for message in desk.sent()), "the command leaves")
    return int(tick)


def last_velocity(messages: list[wirebond.Message]) -> dict[str, Any]:
    return dict([m for m in messages if m.name == "velocity"][-1].fields)


@pytest.mark.timed(tolerance=0.03)
@pytest.mark.usefixtures("real_ages")
def test_a_page_that_falls_silent_stops_the_robot_within_350_ms(desk: Desk) -> None:
    """Its packets are dropped without a close: nothing comes any more, and the connection stays."""
    with desk.attach(name="page") as socket:
        drive(desk, socket)
        tick = hear(socket, lambda said: said.get("event") == "tick")["tick"]
        say(socket, {"do": "beat", "tick": tick})
        beat = time.monotonic()
        sent = desk.sent(0.2)
        wait_until(lambda: last_velocity(sent) == SAFE or sent.extend(desk.sent()), "the safe value")
        stopped = next(m.t for m in sent if m.name == "velocity" and m.fields == SAFE)
        assert stopped - beat <= 0.35
        assert desk.server.holder is None


def test_a_page_that_is_closed_stops_the_robot_at_once(desk: Desk) -> None:
    with desk.attach(name="page") as socket:
        drive(desk, socket)
        assert desk.server.holder == "page"
    wait_until(lambda: desk.server.holder is None, "control ends")
    sent = desk.sent(0.05)
    wait_until(lambda: (sent and last_velocity(sent) == SAFE) or sent.extend(desk.sent()), "the safe value")


def test_two_pages_have_one_control_between_them(desk: Desk) -> None:
    with desk.attach(name="first") as first, desk.attach(name="second") as second:
        drive(desk, first)
        say(second, {"do": "take", "id": 9})
        assert hear(second, lambda said: said.get("re") == 9)["error"] == "not_in_control"
        say(second, {"do": "take", "id": 10, "over": True})
        assert "ok" in hear(second, lambda said: said.get("re") == 10)
        lost = hear(first, lambda said: said.get("event") == "control" and not said["yours"] and said["holder"])
        assert lost["holder"] == "second"
        assert desk.ask("/api/log")[1]["commands"][-1]["do"] == "take"


def test_fuzzed_messages_end_at_most_their_own_connection(desk: Desk) -> None:
    random.seed(7)
    whole = json.dumps(
        {"do": "attach", "id": 1, "token": desk.token, "messages": "json", "views": {"plots": [{"id": "a"}]}}
    )
    for path in ("/attach", "/views"):
        for _ in range(30):
            data = bytearray(whole.encode())
            for _ in range(random.randint(1, 6)):
                data[random.randrange(len(data))] = random.randrange(256)
            with desk.web(path) as socket:
                try:
                    socket.send(bytes(data).decode("latin-1"))
                    socket.send(bytes(data))
                    socket.recv(timeout=PATIENCE)
                except ConnectionClosed:
                    pass
    with desk.attach() as socket:
        assert "ok" in hear(socket, lambda said: said.get("re") == 1)
