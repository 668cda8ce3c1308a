"""Parameters of the MCU as parameters of the node: a set is the MCU's to take or refuse, and others' sets are seen."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

import wirebond
from tests.ros2.domains import own_domain
from tests.ros2.fake_node import FakeNode
from tests.ros2.over_rclpy import rclpy_environment
from tests.shared import PROTOCOLS
from tests.waiting import PATIENCE
from wirebond.errors import ParameterError
from wirebond.link.parameters import Parameters
from wirebond.ros2.bridge import Bridge
from wirebond.ros2.mapping import default_mapping
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live

AXIS = wirebond.load(PROTOCOLS / "linear_axis.yaml")


READS = """
wirebond_ros2: 1
services:
  - service: ~/travel
    type: std_srvs/Trigger
    message: parameter_read
    fields: {index: {text: travel}}
    answer: {success: {from: result, values: {ok: true, no_such_index: false, out_of_range: false}}, message: result}
"""


BEST_EFFORT = {"qos_overrides": {"/axis/state": {"publisher": {"reliability": "best_effort"}}}}


class Axis:
    """An MCU with three parameters, each from 0 to 10. It answers nothing before it is switched on."""

    def __init__(self) -> None:
        self.line = PtyPort()
        self.values = {"max_speed": 1.5, "acceleration": 0.1, "travel": 0.8}
        self.is_on = threading.Event()
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._answer, daemon=True)
        self._thread.start()

    def _answer(self) -> None:
        decoder = AXIS.decoder("host")
        while not self._closed.is_set():
            for message in decoder.feed(self.line.read(0.05), t=0.0):
                if not self.is_on.is_set() or message.name not in ("parameter_read", "parameter_set"):
                    continue
                index, result = message["index"], "ok"
                if message.name == "parameter_set":
                    if 0 <= message["value"] <= 10:
                        self.values[index] = message["value"]
                    else:
                        result = "out_of_range"
                answer = {"index": index, "value": self.values[index], "result": result}
                self.line.write(AXIS.encode("parameter_value", answer))

    def close(self) -> None:
        self._closed.set()
        self._thread.join(PATIENCE)
        self.line.close()


@pytest.fixture
def axis() -> Iterator[Axis]:
    made = Axis()
    yield made
    made.close()


def test_parameters_are_read_set_and_followed(axis: Axis) -> None:
    node = FakeNode()
    with wirebond.open(AXIS, axis.line.path) as link:
        axis.is_on.set()
        bridge = Bridge(link, node, default_mapping(AXIS.model))
        thread = bridge.start()
        node.wait(lambda: len(node.parameters) == 3)
        assert {name: p.value for name, p in node.parameters.items()} == {
            "mcu.max_speed": 1.5,
            "mcu.acceleration": 0.1,
            "mcu.travel": 0.8,
        }
        node.parameters["mcu.travel"].set(0.7)
        assert axis.values["travel"] == pytest.approx(0.7)
        with pytest.raises(
            ParameterError, match=r"the MCU refused 11\.0 for parameter travel: it is out of range; 0\.7 stays"
        ):
            node.parameters["mcu.travel"].set(11.0)
        link.parameters.set("max_speed", 2.25)  # as another program does
        node.wait(lambda: node.parameters["mcu.max_speed"].value == 2.25)
        bridge.close()
        thread.join(PATIENCE)


def test_an_mcu_that_is_switched_on_later_is_read_then(axis: Axis, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(Parameters.get.__kwdefaults__, "timeout", 0.1)
    monkeypatch.setitem(Parameters.list.__kwdefaults__, "timeout", 0.1)
    node = FakeNode()
    with wirebond.open(AXIS, axis.line.path) as link:
        bridge = Bridge(link, node, default_mapping(AXIS.model))
        thread = bridge.start()
        node.wait(lambda: any("the parameters of the MCU are not known yet" in text for _, text in node.lines))
        assert not node.parameters
        axis.is_on.set()
        node.wait(lambda: len(node.parameters) == 3)
        bridge.close()
        thread.join(PATIENCE)


def test_ros_sets_them_over_rclpy(axis: Axis, tmp_path: Path) -> None:
    """One process has two links, whose nodes have parameters of their own in one file. A service reads one, too.
    Overrides of qualities of service, remaps and namespaces hold."""
    environment = rclpy_environment() | {"ROS_DOMAIN_ID": str(own_domain())}
    axis.is_on.set()
    protocol = PROTOCOLS / "linear_axis.yaml"
    nodes = {
        "axis": {
            "protocol": str(protocol),
            "port": axis.line.path,
            "mapping": str(tmp_path / "mapping.yaml"),
            **BEST_EFFORT,
        },
        "other": {"protocol": str(protocol), "port": "sim:"},
    }
    (tmp_path / "mapping.yaml").write_text(READS)
    file = tmp_path / "two.yaml"
    file.write_text(json.dumps({f"/**/{name}": {"ros__parameters": given} for name, given in nodes.items()}))
    remaps = ("axis:/axis/link_counters:=/axis/counters", "other:__ns:=/robot1")
    options = ["--params-file", str(file), *(text for remap in remaps for text in ("-r", remap))]
    command = [sys.executable, "-m", "wirebond_ros.bridge", *nodes, "--ros-args", *options]
    bridge = subprocess.Popen(command, env=environment)
    try:
        client = [sys.executable, str(Path(__file__).with_name("parameter_client.py")), "mcu.travel", "0.5", "11.0"]
        said = subprocess.run(client, env=environment, check=False, capture_output=True, text=True, timeout=240)
        assert said.returncode == 0, said.stderr
    finally:
        bridge.terminate()
        assert bridge.wait(PATIENCE) == 0
    taken, refused, called, topics, names = map(json.loads, said.stdout.splitlines())
    assert taken == [True, "", 0.5]
    assert refused[0] is False
    assert "the MCU refused 11.0 for parameter travel: it is out of range" in refused[1]
    assert refused[2] == 0.5
    assert called == [True, "ok"]
    assert topics == [["BEST_EFFORT"], 1]
    assert {"/axis", "/robot1/other"} <= set(names)
