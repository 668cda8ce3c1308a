"""The bridge as a client of a running server: what other clients do, and a server that is lost and comes back."""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

import wirebond
from tests.patient_servers import be_patient
from tests.ros2.fake_node import FakeNode
from tests.ros2.test_mcu_parameters import AXIS, Axis
from tests.waiting import PATIENCE, Stopwatch, let_pass, moments
from wirebond.link.attached.words import Control
from wirebond.ros2.bridge import Bridge
from wirebond.ros2.mapping import read_mapping
from wirebond.server import Server

pytestmark = pytest.mark.live

MAPPING = """
wirebond_ros2: 1
json_topics: all
serial: true
emergency_stop: stop
subscribe:
  - {topic: speed, type: std_msgs/Float64, message: move, fields: {speed: data}, stale: 500 ms}
"""


class Attached:
    """An MCU, its link, a path for a server, and a bridge that is attached to it."""

    def __init__(self, path: Path) -> None:
        self.axis, self.node, self.path = Axis(), FakeNode(), path
        self.axis.is_on.set()
        self.own = wirebond.open(AXIS, self.axis.line.path)
        self.server = Server(self.own, path)
        self.link = wirebond.open(f"wirebond://{path}")
        self.bridge = Bridge(self.link, self.node, read_mapping(MAPPING, AXIS.model))
        self._thread = threading.Thread(target=self.bridge.run, daemon=True)
        self._thread.start()
        self.node.wait(lambda: len(self.node.parameters) == 3)

    def link_status(self) -> tuple[int, str]:
        newest = self.node.newest("/diagnostics")
        if newest is None:
            return -1, "nothing published yet"
        status = newest["status"][0]
        return status["level"], status["message"]

    def state_comes(self) -> bool:
        """Something that the MCU sends becomes topics."""
        seen = self.node.published["/linear_axis/state"], self.node.published["/serial_rx_hex"]
        before = [len(topic) for topic in seen]
        for _ in moments("topics of what the MCU sends"):
            self.axis.line.write(AXIS.encode("state", measured=1, position=0.5, speed=0.0, stops=[]))
            let_pass(0.05)
            if all(len(topic) > count for topic, count in zip(seen, before, strict=True)):
                break
        return True

    def close(self) -> None:
        self.bridge.close()
        self._thread.join(PATIENCE)
        self.link.close()
        self.server.close()
        self.own.close()
        self.axis.close()


@pytest.fixture(autouse=True)
def ages(monkeypatch: pytest.MonkeyPatch) -> None:
    be_patient(monkeypatch)


@pytest.fixture
def attached(tmp_path: Path) -> Iterator[Attached]:
    made = Attached(tmp_path / "server.sock")
    yield made
    made.close()


def test_parameter_that_another_client_sets_is_that_of_ros(attached: Attached) -> None:
    with wirebond.open(f"wirebond://{attached.path}") as other:
        other.parameters.set("max_speed", 2.25)
        attached.node.wait(lambda: attached.node.parameters["mcu.max_speed"].value == 2.25)
    attached.own.parameters.set("travel", 0.25)  # as the server's own program does
    attached.node.wait(lambda: attached.node.parameters["mcu.travel"].value == 0.25)
    attached.node.parameters["mcu.travel"].set(0.75)  # as ROS does
    assert attached.axis.values["travel"] == pytest.approx(0.75)


def test_diagnostics_name_the_servers_tty(attached: Attached) -> None:
    statuses = attached.node.wait(lambda: attached.node.published["/diagnostics"])[-1]["status"]
    tty = attached.axis.line.path
    assert {status["hardware_id"] for status in statuses} == {tty}
    assert {"key": "tty", "value": tty} in statuses[0]["values"]


def test_log_names_topics_of_ros_and_no_calls_of_python(attached: Attached) -> None:
    node = attached.node

    def is_told(sentence: str) -> bool:
        return any(sentence in text for _, text in node.lines)

    take = "take it: ros2 topic pub --once /linear_axis/take_control std_msgs/msg/Empty"
    with wirebond.open(f"wirebond://{attached.path}") as other:
        other.take_control()
        node.take["/speed"]({"data": 0.5})
        node.wait(lambda: is_told(f"is in control of the robot; end its control there, then {take}"))
        node.take["/linear_axis/take_control"]({})  # not over another program
        assert other.control.is_own
    node.wait(lambda: attached.link.control.holder is None)
    node.take["/linear_axis/take_control"]({})
    node.wait(lambda: is_told("this node is in control of the robot"))
    assert attached.link.control.is_own

    node.take["/stop"]({"data": True})
    node.take["/speed"]({"data": 0.5})
    node.wait(lambda: is_told("move was not sent: an emergency stop holds move until false comes on /stop"))
    assert not [text for _, text in node.lines if re.search(r"\w\(|over=", text)]


def test_button_that_publishes_false_all_the_time_takes_no_control(attached: Attached) -> None:
    node = attached.node
    for _ in range(3):
        node.take["/stop"]({"data": False})
    assert attached.link.control.holder is None
    assert not [text for _, text in node.lines if "released" in text]


def test_node_that_lost_control_says_how_to_take_it(attached: Attached) -> None:
    node = attached.node
    node.take["/speed"]({"data": 0.5})
    owner = attached.server._owner
    owner.loop.call_soon_threadsafe(owner.end_control, "silent")
    node.wait(lambda: attached.link.control.holder is None)
    node.take["/speed"]({"data": 0.5})
    take = "to take it: ros2 topic pub --once /linear_axis/take_control std_msgs/msg/Empty"
    lost = "this node has lost control of the robot, and no program has it; "
    node.wait(lambda: any(lost + take in text for _, text in node.lines))


def test_topic_that_is_published_all_the_time_takes_no_control_after_a_stop_and_one_message_does(
    attached: Attached,
) -> None:
    node = attached.node
    with wirebond.open(f"wirebond://{attached.path}") as pad:
        pad.emergency_stop()
        node.take["/linear_axis/take_control"]({})
        pad.release_stop()
        name = attached.server.log.commands()[-1].name
        node.wait(lambda: attached.link.control == Control(None, False, name))
        watch = Stopwatch()
        for _ in range(50):
            node.take["/linear_axis/take_control"]({})
        assert attached.server.holder is None
        told = f"{name} released the emergency stop, and no program has been in control since; look at the robot"
        node.wait(lambda: any(told in text and "take_control std_msgs" in text for _, text in node.lines))
        assert len([text for _, text in node.lines if "released the emergency stop" in text]) < 10 + watch.seconds
        attached.bridge._asked = -math.inf  # a person's pause
        node.take["/linear_axis/take_control"]({})
        node.wait(lambda: attached.link.control.is_own)


def test_button_that_is_held_all_the_time_does_not_fill_the_log(attached: Attached) -> None:
    node, watch = attached.node, Stopwatch()
    for _ in range(200):
        node.take["/stop"]({"data": True})
    assert (
        1
        <= len([text for _, text in node.lines if "messages that move the robot are held" in text])
        < 20 + watch.seconds
    )
    for number in range(200):  # a button that bounces
        node.take["/stop"]({"data": number % 2 == 1})
    assert len([text for _, text in node.lines if "the emergency stop is released" in text]) < 50 + watch.seconds


def test_lost_server_is_reported_and_its_return_too(attached: Attached) -> None:
    node = attached.node
    assert attached.state_comes()
    node.take["/speed"]({"data": 0.5})
    attached.server.close()
    node.wait(lambda: attached.link_status()[0] == 2)
    assert "wirebond serve" in attached.link_status()[1]
    node.wait(lambda: any(level == "error" and "wirebond serve" in text for level, text in node.lines))
    refused = attached.bridge.commands.counts["refused"]
    node.take["/speed"]({"data": 0.5})
    assert attached.bridge.commands.counts["refused"] == refused + 1

    attached.axis.values["travel"] = 0.125  # the MCU has changed meanwhile
    attached.server = Server(attached.own, attached.path)
    node.wait(lambda: any(level == "info" and text.startswith("the link is back") for level, text in node.lines))
    assert attached.state_comes()
    sent = attached.bridge.commands.counts["sent"]
    node.take["/speed"]({"data": 0.25})  # nobody is in control after a restart, and no command takes it
    assert attached.bridge.commands.counts["sent"] == sent
    assert any("this node has lost control of the robot, and no program has it" in text for _, text in node.lines)
    node.take["/linear_axis/take_control"]({})
    node.take["/speed"]({"data": 0.25})
    assert attached.bridge.commands.counts["sent"] == sent + 1
    node.wait(lambda: node.parameters["mcu.travel"].value == 0.125)
    node.wait(lambda: any(line["data"].startswith("TX: ") for line in node.published["/serial_tx_hex"][-3:]))
