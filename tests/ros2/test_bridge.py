"""The bridge between a link and a node in memory: topics with JSON, deadlines, stops, parameters."""

from __future__ import annotations

import json
import os
import threading
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import wirebond
from tests.ros2.fake_node import FakeNode
from tests.shared import PROTOCOLS
from tests.waiting import PATIENCE, Stopwatch, moments, wait_until
from wirebond.link.stop_file import StopFile
from wirebond.protocol import loads
from wirebond.protocol.model import FieldKind
from wirebond.ros2.bridge import Bridge
from wirebond.ros2.mapping import BridgeMapping, default_mapping, read_mapping
from wirebond.sim.pty_port import PtyPort
from wirebond.sim.pty_port import run as serve
from wirebond.sim.virtual_mcu import VirtualMcu

pytestmark = pytest.mark.live

# The rover's deadlines ten times as fast: a test waits for them.
FAST = (PROTOCOLS / "diffdrive.yaml").read_text().replace("after: 3 s, then: warn", "after: 300 ms, then: warn")
FAST = FAST.replace("after: 5 s, then: stop_navigation", "after: 500 ms, then: stop_navigation")
ROVER = wirebond.Codec(loads(FAST))
MAPPING = read_mapping((PROTOCOLS / "ros2" / "diffdrive.yaml").read_text(), ROVER.model)


class Bench:
    """A bridge that runs, with the MCU's end of its line."""

    def __init__(
        self,
        mapping: BridgeMapping,
        codec: wirebond.Codec = ROVER,
        line: PtyPort | None = None,
        node: FakeNode | None = None,
        kept_stop: StopFile | None = None,
    ) -> None:
        self.line = line or PtyPort()
        self.link = wirebond.open(codec, self.line.path)
        self.node = node or FakeNode()
        self.bridge = Bridge(self.link, self.node, mapping, kept_stop)
        self._heard = ROVER.decoder(sender="host")
        self._came: list[wirebond.Message] = []
        self._thread = threading.Thread(target=self.bridge.run, daemon=True)
        self._thread.start()
        self.node.is_started.wait(PATIENCE)

    def mcu_sends(self, message: str, **fields: Any) -> None:
        self.line.write(ROVER.encode(message, fields))

    def heard(self) -> list[wirebond.Message]:
        """Return the messages that the MCU has received since the last call."""
        found = self._came + self._heard.feed(self.line.read(0.05), t=0.0)
        self._came = []
        return found

    def mcu_hears(self, message: str) -> dict[str, Any]:
        """The next such message that the host sent."""
        for _ in moments(f"the message {message} at the MCU"):
            while self._came:
                heard = self._came.pop(0)
                if heard.name == message:
                    return dict(heard.fields)
            self._came += self._heard.feed(self.line.read(0.05), t=0.0)
        raise AssertionError

    def navigates(self) -> None:
        """Odometry comes, and navigation goes on."""
        wait_until(
            lambda: self.mcu_sends("odometry", left_ticks=10, right_ticks=10) or self.newest("/navigation_ok"),
            "navigation goes on",
        )

    def newest(self, topic: str) -> Any:
        newest = self.node.newest(topic)
        return None if newest is None else newest["data"]

    def close(self) -> None:
        self.bridge.close()
        self._thread.join(PATIENCE)
        self.link.close()
        self.line.close()


@pytest.fixture
def rover() -> Iterator[Bench]:
    bench = Bench(MAPPING)
    yield bench
    bench.close()


@pytest.fixture
def plain() -> Iterator[Bench]:
    bench = Bench(default_mapping(ROVER.model))
    yield bench
    bench.close()


def test_without_a_mapping_messages_are_json_both_ways(plain: Bench) -> None:
    plain.mcu_sends("status", battery=12.1, errors=["encoder"], state=[])
    plain.node.wait(lambda: plain.node.published["/diffdrive/status"])
    assert json.loads(plain.newest("/diffdrive/status")) == {"battery": 12.1, "errors": ["encoder"], "state": []}
    plain.node.take["/diffdrive/velocity/send"]({"data": '{"linear": 0.5, "angular": 9}'})
    assert plain.mcu_hears("velocity") == {"linear": 0.5, "angular": 3.14}
    assert plain.node.types["/diffdrive/status"] == plain.node.types["/diffdrive/velocity/send"] == "std_msgs/String"


def test_protocol_without_deadlines_has_its_topics() -> None:
    codec = wirebond.load(PROTOCOLS / "enterprize.yaml")
    bench = Bench(default_mapping(codec.model), codec)
    bench.line.write(codec.encode("chassis_msg", x_vel=0.5, y_vel=0, w_vel=0))
    bench.node.wait(lambda: bench.node.published["/enterprize/chassis_msg"])
    bench.close()


@pytest.mark.parametrize("text", ["", "[1]", '{"linear": "fast"}', '{"up": 1}', "{" * 10_000, '{"linear": NaN}'])
def test_json_that_is_no_message_is_refused_and_said(plain: Bench, text: str) -> None:
    plain.node.take["/diffdrive/velocity/send"]({"data": text})
    ((level, line),) = plain.node.lines
    assert (level, line.startswith("velocity was not sent: ")) == ("warning", True)
    assert plain.bridge.commands.counts["refused"] == 1


def test_odometry_that_stays_away_stops_navigation_until_it_is_back(rover: Bench) -> None:
    node = rover.node
    command = {"linear": {"x": 0.5}, "angular": {"z": 0.0}}
    assert rover.newest("/navigation_ok") is False  # before the first odometry
    node.take["/cmd_vel"](command)
    assert rover.bridge.commands.counts["refused"] == 1
    for _ in moments("the command at the MCU"):
        rover.navigates()
        node.take["/cmd_vel"](command)  # refused, where a pause of the machine came between
        if any(m.name == "velocity" and m["linear"] == 0.5 for m in rover.heard()):
            break
    node.wait(lambda: not rover.newest("/navigation_ok"))
    wait_until(lambda: rover.mcu_hears("velocity")["linear"] == 0.0, "the safe value")
    assert ("warning", "stop_navigation: no odometry for 0.5 s") in node.lines
    node.take["/cmd_vel"](command)
    assert any("navigation is stopped, because there was no odometry for 0.5 s" in text for _, text in node.lines)
    rover.navigates()
    assert node.qos["/navigation_ok"].latched
    stops = ("warning", "stop_navigation: no odometry for 0.5 s")
    node.wait(lambda: node.cancelled == ["/navigate_to_pose"] * node.lines.count(stops))


def test_status_that_stays_away_is_a_warning_and_is_asked_for(rover: Bench) -> None:
    assert rover.mcu_hears("status_query") == {}
    rover.node.wait(lambda: ("warning", "warn: no status for 0.3 s") in rover.node.lines)
    rover.mcu_sends("status", battery=12.1, errors=[], state=["estop"])
    rover.node.wait(lambda: ("info", "warn: over") in rover.node.lines)
    rover.node.wait(lambda: rover.newest("/estop") is True)


def test_emergency_stop_is_a_topic(rover: Bench) -> None:
    rover.navigates()
    rover.node.take["/emergency_stop"]({"data": True})
    assert rover.mcu_hears("velocity") == {"linear": 0.0, "angular": 0.0}
    assert rover.link.stopped
    rover.node.take["/emergency_stop"]({"data": False})
    assert not rover.link.stopped


def test_a_stop_outlives_a_bridge_with_a_port_of_its_own(tmp_path: Path) -> None:
    mapping = replace(MAPPING, navigation=None)
    first = Bench(mapping, kept_stop=StopFile(tmp_path / "stop"))
    first.node.take["/emergency_stop"]({"data": True})
    first.close()  # a kill leaves the same file
    second = Bench(mapping, kept_stop=StopFile(tmp_path / "stop"))
    try:
        assert second.mcu_hears("velocity") == {"linear": 0.0, "angular": 0.0}
        assert any(
            "an emergency stop still holds" in text and "/emergency_stop" in text for _, text in second.node.lines
        )
        second.node.take["/cmd_vel"]({"linear": {"x": 0.5}, "angular": {"z": 0.0}})
        assert second.bridge.commands.counts["sent"] == 0
        second.node.take["/emergency_stop"]({"data": False})
        assert not second.link.stopped
    finally:
        second.close()
    third = Bench(mapping, kept_stop=StopFile(tmp_path / "stop"))
    assert not third.link.stopped
    third.close()


def commands_status(bench: Bench) -> tuple[int, str, dict[str, str]]:
    published = bench.node.published["/diagnostics"]
    if not published:
        return -1, "", {}
    statuses = published[-1]["status"]
    status = next(s for s in statuses if s["name"] == "diffdrive: commands")
    return status["level"], status["message"], {pair["key"]: pair["value"] for pair in status["values"]}


def test_messages_held_back_by_the_mcu_are_reported_until_a_topic_ends_it() -> None:
    rover = Bench(replace(MAPPING, navigation=None))
    node = rover.node
    node.take["/cmd_vel"]({"linear": {"x": 0.5}, "angular": {"z": 0.0}})
    text = "no velocity was sent for 3 s: the MCU is in safe_mode and ignores velocity; to end safe_mode: "
    text += "ros2 topic pub --once /diffdrive/recover std_msgs/msg/Empty"
    node.wait(lambda: ("warning", text) in node.lines)
    node.wait(lambda: commands_status(rover)[:2] == (1, text))
    node.take["/cmd_vel"]({"linear": {"x": 0.5}, "angular": {"z": 0.0}})
    node.wait(lambda: int(commands_status(rover)[2]["held back by the MCU"]) > 0)
    node.wait(lambda: node.lines.count(("warning", text)) > 1)
    assert node.types["/diffdrive/recover"] == "std_msgs/Empty"
    node.take["/diffdrive/recover"]({})
    assert rover.mcu_hears("parameter") == {"name": "clear_safe_mode", "reserved": 0, "value": 0.0}
    node.wait(lambda: ("info", "safe_mode is over: the MCU acts on velocity again") in node.lines)
    node.wait(lambda: commands_status(rover)[0] == 0)
    rover.close()


def test_messages_held_back_by_the_mcu_from_its_start_are_reported() -> None:
    text = FAST.replace("then: safe_mode,       recover: explicit,", "then: safe_mode, start: held, recover: explicit,")
    assert text != FAST
    rover = Bench(replace(MAPPING, navigation=None), wirebond.Codec(loads(text)))
    node = rover.node
    told = "the MCU starts in safe_mode (`start: held`) and ignores velocity unless somebody ended that; to end "
    node.wait(lambda: commands_status(rover)[0] == 1 and commands_status(rover)[1].startswith(told))
    node.take["/cmd_vel"]({"linear": {"x": 0.5}, "angular": {"z": 0.0}})
    node.wait(lambda: int(commands_status(rover)[2]["held back by the MCU"]) > 0)
    node.take["/diffdrive/recover"]({})
    node.wait(lambda: ("info", "safe_mode is over: the MCU acts on velocity again") in node.lines)
    rover.close()


def test_diagnostics_name_the_flags_and_the_deadlines(rover: Bench) -> None:
    rover.mcu_sends("status", battery=9.9, errors=["left_motor", "low_battery"], state=[])

    def worst() -> dict[str, str]:
        statuses = [s for message in rover.node.published["/diagnostics"][-1:] for s in message["status"]]
        return {s["name"]: s["message"] for s in statuses if s["level"]}

    wanted = ("diffdrive: status errors", "left motor fault, battery voltage too low")
    rover.node.wait(lambda: wanted in worst().items())
    rover.node.wait(lambda: "no odometry for 0.5 s" in worst().get("diffdrive: deadlines", ""))


def test_diagnostics_name_topics_whose_messages_cannot_be_read(rover: Bench) -> None:
    def topics() -> tuple[int, str, dict[str, str]] | None:
        newest = rover.node.newest("/diagnostics")
        if newest is None:
            return None
        status = next(s for s in newest["status"] if s["name"] == "diffdrive: topics")
        return status["level"], status["message"], {pair["key"]: pair["value"] for pair in status["values"]}

    rover.node.undecodable["/cmd_vel"] += 3
    facts = {"/cmd_vel: messages not of its type": "3"}
    rover.node.wait(lambda: topics() == (1, "a message on /cmd_vel was not of its type", facts))
    rover.node.wait(lambda: topics() == (0, "all messages are of their types", facts))


def test_wheels_are_parameters(rover: Bench) -> None:
    radius = rover.node.parameters["odometry.radius"]
    assert (radius.value, radius.maximum) == (0.0325, 10.0)
    radius.set(0.065)
    rover.mcu_sends("odometry", left_ticks=1024, right_ticks=1024)
    rover.node.wait(lambda: rover.node.published["/odom"])
    assert rover.node.published["/odom"][0]["pose"]["pose"]["position"]["x"] == pytest.approx(0.4084, abs=1e-4)
    radius.set(0.0325)


def test_topics_lie_in_the_namespace() -> None:
    bench = Bench(replace(MAPPING, namespace="/robot1", node="base"))
    bench.close()
    assert {"/robot1/cmd_vel", "/robot1/base/parameter/send"} <= bench.node.take.keys()
    assert {"/robot1/odom", "/tf", "/diagnostics"} <= bench.node.types.keys()


def test_rate_of_a_topic_is_bounded() -> None:
    mapping = read_mapping(
        """
wirebond_ros2: 1
publish:
  - {message: odometry, topic: left, type: std_msgs/Int16, fields: {data: left_ticks}}
  - {message: odometry, topic: slow, type: std_msgs/Int16, fields: {data: left_ticks}, at_most: 60 s}
""",
        ROVER.model,
    )
    bench = Bench(mapping)
    for number in range(3):
        bench.mcu_sends("odometry", left_ticks=number, right_ticks=0)
        bench.node.wait(lambda number=number: bench.newest("/left") == number)
    bench.close()
    assert [one["data"] for one in bench.node.published["/slow"]] == [0]


def test_missing_port_is_in_the_diagnostics(tmp_path: Path) -> None:
    node = FakeNode()
    with wirebond.open(ROVER, os.fspath(tmp_path / "tty"), wait_for_port=True) as link:
        bridge = Bridge(link, node, MAPPING)
        thread = threading.Thread(target=bridge.run, daemon=True)
        thread.start()
        node.wait(lambda: node.published["/diagnostics"])
        bridge.close()
        thread.join(PATIENCE)
    status = node.published["/diagnostics"][0]["status"][0]
    assert (status["level"], "there is no port" in status["message"]) == (2, True)


class SlowPort(PtyPort):
    """A virtual MCU's port that holds each `state` back for a while; answers about the clock leave at once."""

    HELD = 0.06  # seconds

    def __init__(self, codec: wirebond.Codec) -> None:
        super().__init__()
        self._decoder = codec.decoder("mcu")
        self._held: deque[tuple[Stopwatch, bytes]] = deque()

    def write(self, data: bytes) -> None:
        for message in self._decoder.feed(data):
            if message.name == "state":
                self._held.append((Stopwatch(), message.raw))
            else:
                super().write(message.raw)

    def read(self, timeout: float) -> bytes:
        while self._held and self._held[0][0].seconds >= self.HELD:
            super().write(self._held.popleft()[1])
        return super().read(timeout)


class MonotonicNode(FakeNode):
    """Its clock is that of the link."""

    def now_ns(self) -> int:
        return time.monotonic_ns()


def test_topics_have_the_mcus_time_of_measurement() -> None:
    axis = wirebond.load(PROTOCOLS / "linear_axis.yaml")
    mapping = read_mapping(
        """
wirebond_ros2: 1
json_topics: none
publish:
  - {message: state, topic: axis, type: geometry_msgs/PointStamped, fields: {point.x: measured}}
""",
        axis.model,
    )
    bench = Bench(mapping, axis, SlowPort(axis), MonotonicNode())
    mcu, over = VirtualMcu(axis, time.monotonic(), clock_drift=400.0), threading.Event()  # ppm

    def run() -> None:
        while not over.is_set():
            serve(mcu, bench.line, time.monotonic() + 0.05, lambda _: None)

    thread = threading.Thread(target=run)
    thread.start()
    published = bench.node.published["/axis"]
    bench.node.wait(lambda: published and bench.link.clock is not None)
    before = len(published)
    bench.node.wait(lambda: len(published) >= before + 30)
    over.set()
    thread.join(PATIENCE)
    bench.close()
    for message in published[before + 10 :]:  # the first ones may have come before the clock was known
        stamp = message["header"]["stamp"]
        true = mcu.start + message["point"]["x"] / (1e6 + 400.0)
        assert abs(stamp["sec"] + stamp["nanosec"] * 1e-9 - true) < SlowPort.HELD / 3


def test_commands_that_come_faster_than_the_line_are_sent_or_counted() -> None:
    text = (PROTOCOLS / "enterprize.yaml").read_text(encoding="utf-8")
    codec = wirebond.Codec(loads(text))
    commands = [m for m in codec.model.messages if m.name.endswith("_cmd")]
    source: dict[str, Any] = {FieldKind.FLOAT: "x", FieldKind.BOOL: True, FieldKind.INTEGER: 1}
    topics = [
        {
            "topic": m.name,
            "type": "geometry_msgs/Vector3",
            "message": m.name,
            "fields": {f.name: source[f.kind] for f in m.fields},
        }
        for m in commands
    ]
    mapping = read_mapping(json.dumps({"wirebond_ros2": 1, "json_topics": "none", "subscribe": topics}), codec.model)
    line, node = PtyPort(), FakeNode()
    rounds, decoder = 300, codec.decoder("host")
    with wirebond.open(codec, line.path, baud=230_400) as link:
        bridge = Bridge(link, node, mapping)
        for number in range(1, rounds + 1):
            for message in commands:
                node.take[f"/{message.name}"]({"x": float(number), "y": 0.0, "z": 0.0})
        heard: list[wirebond.Message] = []

        def have_left() -> bool:
            heard.extend(decoder.feed(line.read(0.05)))
            stats = link.stats.send
            return not stats.queued and len(heard) >= stats.sent

        wait_until(have_left, "all commands leave")
        send, counts = link.stats.send, bridge.commands.counts
    line.close()
    assert counts == {"sent": rounds * len(commands), "clamped": 0, "refused": 0}
    assert send.sent + send.replaced == counts["sent"] and send.replaced > counts["sent"] / 2
    assert len(heard) == send.sent
    newest = {message.name: max(v for v in dict(message).values()) for message in heard}
    assert newest == dict.fromkeys((m.name for m in commands), rounds)
