"""Commands from ROS: within the protocol's ranges, or refused; every one counted, each thing said once a second."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from tests.shared import PROTOCOLS
from tests.waiting import moments
from wirebond.codec import Codec, load
from wirebond.errors import LinkDownError
from wirebond.link import open_link
from wirebond.protocol import loads
from wirebond.ros2.commands import Commands
from wirebond.ros2.stalls import Stalls
from wirebond.ros2.throttle import Throttle
from wirebond.sim.pty_port import PtyPort


class FakeLink:
    """Notes what is sent, as the link would encode it."""

    def sends_plain(self, _name: str) -> bool:
        return True

    def send_all(self, frames: list[tuple[int, bytes]]) -> list[LinkDownError | None]:
        messages = self.codec.decoder("host").feed(b"".join(frame for _, frame in frames))
        self.sent += [(message.name, dict(message), None) for message in messages if not self.is_down]
        return [LinkDownError("the port is away") if self.is_down else None for _ in frames]

    def __init__(self) -> None:
        self.codec: Codec = load(PROTOCOLS / "diffdrive.yaml")
        self.sent: list[tuple[str, dict[str, Any], float | None]] = []
        self.is_down = False
        self.internals = SimpleNamespace(sender=self)

    def send(self, name: str, values: dict[str, Any], *, header: Any = None) -> None:
        if self.is_down:
            raise LinkDownError("the port is away")
        self.codec.encode(name, values)
        self.sent.append((name, values, None))

    def repeat(self, name: str, values: dict[str, Any], *, hold: float, header: Any = None) -> None:
        self.codec.encode(name, values)
        self.sent.append((name, values, hold))

    def end_safely(self, name: str, header: dict[str, Any]) -> bool:
        assert header == {}
        self.sent.append((name, {"safe": True}, None))
        return True


@pytest.fixture
def link() -> FakeLink:
    return FakeLink()


@pytest.fixture
def said() -> list[str]:
    return []


@pytest.fixture
def commands(link: FakeLink, said: list[str]) -> Commands:
    return Commands(link, lambda level, text: said.append(f"{level}: {text}"))  # type: ignore[arg-type]


def test_command_within_its_range_is_repeated_for_the_time_given(commands: Commands, link: FakeLink) -> None:
    assert commands.send("velocity", {"linear": 0.5, "angular": -1.0}, hold=0.5)
    assert link.sent == [("velocity", {"linear": 0.5, "angular": -1.0}, 0.5)]
    assert commands.counts == {"sent": 1, "clamped": 0, "refused": 0}


def test_command_beyond_its_range_is_clamped_counted_and_said(
    commands: Commands, link: FakeLink, said: list[str]
) -> None:
    assert commands.send("velocity", {"linear": 9, "angular": -4.0}, hold=0.5)
    assert link.sent[0][1] == {"linear": 2.0, "angular": -3.14}
    assert commands.counts == {"sent": 1, "clamped": 1, "refused": 0}
    assert said == ["warning: velocity was clamped: linear = 9 m/s to 2, angular = -4 rad/s to -3.14"]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_command_that_is_not_finite_is_refused(
    commands: Commands, link: FakeLink, said: list[str], value: float
) -> None:
    assert not commands.send("velocity", {"linear": value}, hold=0.5)
    assert link.sent == []
    assert commands.counts == {"sent": 0, "clamped": 0, "refused": 1}
    assert said == [f"warning: velocity was not sent: linear is {value}, not a finite number"]


@pytest.mark.parametrize("values", [{"name": "max_linear", "value": 99.0}, {"name": "stop"}, {"value": 1.0}, {"up": 1}])
def test_refusals_by_the_protocol_are_counted(commands: Commands, link: FakeLink, values: dict[str, Any]) -> None:
    assert not commands.send("parameter", values)
    assert (link.sent, commands.counts["refused"]) == ([], 1)


def test_link_that_is_down_is_said_and_not_raised(commands: Commands, link: FakeLink, said: list[str]) -> None:
    link.is_down = True
    assert not commands.send("status_query", {})
    assert said == ["warning: status_query was not sent: the port is away"]


def test_stop_sends_the_safe_values_and_holds_what_moves_the_robot(commands: Commands, link: FakeLink) -> None:
    commands.stop("no odometry")
    assert link.sent == [("velocity", {"safe": True}, None)]
    assert not commands.send("velocity", {"linear": 0.5}, hold=0.5)
    assert commands.send("status_query", {})
    commands.resume()
    assert commands.send("velocity", {"linear": 0.5}, hold=0.5)


SERVOS = """
wirebond: 1
protocol: servos
frame:
  - magic: 0xAA
  - {field: servo, type: u8, default: 1, address: mcu, broadcast: 0xFE}
  - {field: mode, type: u8, default: 0}
  - length: u8
  - id: u8
  - payload: by_length
  - check: crc-16/mcrf4xx
messages:
  move: {id: 1, sender: host, every: 20 ms, fields: {speed: {type: i8}}}
deadlines: [{message: move, at: mcu, after: 200 ms, then: stop}]
emergency_stop: {message: move, speed: 0, header: {servo: 2, mode: 3}}
"""


@pytest.mark.live
def test_stop_has_the_header_of_the_file_and_goes_to_every_address_that_was_commanded() -> None:
    codec, line = Codec(loads(SERVOS)), PtyPort()
    decoder, heard = codec.decoder("host"), list[tuple[int, int, int]]()

    def hears(*wanted: tuple[int, int, int]) -> None:
        for _ in moments(lambda: f"{wanted}; heard: {heard}"):
            if set(wanted) <= set(heard):
                break
            heard.extend((m.header["servo"], m.header["mode"], m["speed"]) for m in decoder.feed(line.read(0.05)))

    with open_link(codec, line.path) as link:
        commands = Commands(link, lambda *_: None)
        for header in (None, {"servo": 7, "mode": 1}, {"servo": 7}):
            assert commands.send("move", {"speed": 5}, header=header)
        assert not commands.send("move", {"speed": 5}, header={"servo": 999})
        hears((1, 0, 5), (7, 1, 5), (7, 0, 5))
        commands.stop("no odometry")
        hears((1, 3, 0), (2, 3, 0), (7, 3, 0))
        assert commands.counts["refused"] == 1
    line.close()


def test_requests_that_waited_in_a_stall_are_refused_but_for_a_stop(link: FakeLink, said: list[str]) -> None:
    now = [0.0]
    stalls = Stalls(lambda: now[0])
    commands = Commands(link, lambda level, text: said.append(text), why_old=lambda: stalls.why_old)  # type: ignore[arg-type]
    for _ in range(20):  # looks as they are on a busy computer
        now[0] += 0.4
        stalls.look()
        assert commands.send("velocity", {"linear": 0.5, "angular": 0.0}, hold=0.5)
    link.sent.clear()
    now[0] += 3.0  # until here it did not run; its other threads may come before the one that looks
    assert not commands.send("velocity", {"linear": 0.5, "angular": 0.0}, hold=0.5)
    stalls.look()
    assert not commands.send("status_query", {})
    commands.send_frames(*frames_of(link, linear=0.5, angular=0.0))
    commands.send_frames(*frames_of(link, linear=0.0, angular=0.0))
    commands.flush()
    assert commands.send("velocity", {"linear": 0.0, "angular": 0.0})
    assert [values for _, values, _ in link.sent] == 2 * [{"linear": 0.0, "angular": 0.0}]
    assert commands.counts["refused"] == 3
    why = "it may have waited while this node was held up for 3.0 s; publish it again if it is still wanted"
    assert said[0] == f"velocity was not sent: {why}"
    for _ in range(11):
        now[0] += 0.1
        stalls.look()
    assert commands.send("velocity", {"linear": 0.5, "angular": 0.0}, hold=0.5)


def test_the_same_thing_is_said_once_a_second_with_how_often_it_happened() -> None:
    now, said = [0.0], list[str]()
    throttle = Throttle(lambda level, text: said.append(text), clock=lambda: now[0])
    for step in range(25):
        now[0] = step / 10
        throttle.say("warning", "nan", "linear is nan")
    throttle.say("warning", "range", "linear was clamped")
    assert said == [
        "linear is nan",
        "linear is nan (9 more since the last line)",
        "linear is nan (9 more since the last line)",
        "linear was clamped",
    ]


def frames_of(link: FakeLink, **fields: float) -> tuple[int, list[bytes]]:
    return link.codec.tables.indices["velocity"], [link.codec.encode("velocity", fields)]


def test_frames_leave_together_with_the_flush_and_before_what_is_sent_later(commands: Commands, link: FakeLink) -> None:
    for speed in (0.1, 0.2):
        commands.send_frames(*frames_of(link, linear=speed, angular=0.0))
    assert link.sent == []
    commands.send("velocity", {"linear": 0.3, "angular": 0.0})
    assert [round(values["linear"], 3) for _, values, _ in link.sent] == [0.1, 0.2, 0.3]
    commands.flush()
    assert commands.counts == {"sent": 3, "clamped": 0, "refused": 0}


def test_frame_that_waits_when_navigation_stops_is_refused(commands: Commands, link: FakeLink, said: list[str]) -> None:
    commands.send_frames(*frames_of(link, linear=0.5, angular=0.0))
    commands.send_frames(link.codec.tables.indices["status_query"], [link.codec.encode("status_query")])
    commands.stop("no odometry")
    commands.flush()
    assert [name for name, _, _ in link.sent] == ["velocity", "status_query"]
    assert link.sent[0][1] == {"safe": True}
    assert (commands.counts["sent"], commands.counts["refused"]) == (1, 1)
    assert said == ["warning: velocity was not sent: no odometry"]


def test_frames_that_the_link_refuses_are_counted_and_said_once(
    commands: Commands, link: FakeLink, said: list[str]
) -> None:
    link.is_down = True
    for _ in range(3):
        commands.send_frames(*frames_of(link, linear=0.5, angular=0.0))
    commands.flush()
    assert (commands.counts["refused"], link.sent) == (3, [])
    assert said == ["warning: velocity was not sent: the port is away"]
