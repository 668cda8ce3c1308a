"""The bridge as a client of a running server: what other clients do, and a server that is lost and comes back."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

import wirebond
from tests.ros2.fake_node import FakeNode
from tests.ros2.test_mcu_parameters import AXIS, Axis
from wirebond.ros2.bridge import Bridge
from wirebond.ros2.mapping import read_mapping
from wirebond.server import Server

MAPPING = """
wirebond_ros2: 1
json_topics: all
serial: true
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
        self.axis.line.write(AXIS.encode("state", measured=1, position=0.5, speed=0.0, stops=[]))
        self.node.wait(lambda: all(len(topic) > count for topic, count in zip(seen, before, strict=True)))
        return True

    def close(self) -> None:
        self.bridge.close()
        self._thread.join(20)
        self.link.close()
        self.server.close()
        self.own.close()
        self.axis.close()


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


def test_lost_server_is_told_and_its_return_too(attached: Attached) -> None:
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
    node.take["/speed"]({"data": 0.25})
    assert attached.bridge.commands.counts["sent"] == sent + 1
    node.wait(lambda: node.parameters["mcu.travel"].value == 0.125)
    node.wait(lambda: any(line["data"].startswith("TX: ") for line in node.published["/serial_tx_hex"][-3:]))
