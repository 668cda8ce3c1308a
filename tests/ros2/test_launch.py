"""The launch files, over a stand-in of ROS's launch: which nodes they start."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from tests.shared import ROOT

PACKAGE = ROOT / "ros2" / "wirebond_ros"
TWO = """\
links:
  base: {protocol: diffdrive.yaml, port: /dev/ttyUSB0, namespace: /robot1, baud: 115200}
  arm: {port: "wirebond://arm", mapping: /etc/arm.yaml, remappings: {joint_states: arm/joint_states}}
"""


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Runs a launch file with arguments; the keywords of each node that it starts."""

    def run(name: str, **arguments: str) -> list[dict[str, Any]]:
        def add(module: str, **names: Any) -> None:
            made = ModuleType(module)
            vars(made).update(names)
            monkeypatch.setitem(sys.modules, module, made)

        class Configuration:
            def __init__(self, key: str) -> None:
                self.key = key

            def perform(self, _: object) -> str:
                return arguments[self.key]

        keep = lambda *given, **named: SimpleNamespace(given=given, **named)  # noqa: E731
        add("launch", LaunchDescription=lambda entities: entities)
        add("launch.actions", DeclareLaunchArgument=keep, OpaqueFunction=keep)
        add("launch.substitutions", LaunchConfiguration=Configuration)
        add("launch_ros")
        add("launch_ros.actions", Node=dict)
        found = runpy.run_path(str(PACKAGE / "launch" / name))["generate_launch_description"]()
        nodes = [one for one in found if isinstance(one, dict)]
        for one in found:
            if hasattr(one, "function"):
                nodes += one.function(None)
        return nodes

    return run


def test_one_link_is_a_node_with_its_parameters(launched: Any) -> None:
    (node,) = launched("bridge.launch.py")
    assert (node["package"], node["executable"], node["name"]) == ("wirebond_ros", "bridge", "wirebond")
    assert set(node["parameters"][0]) == {"protocol", "port", "mapping"}


def test_each_link_of_a_file_is_a_node(launched: Any, tmp_path: Path) -> None:
    (tmp_path / "links.yaml").write_text(TWO)
    base, arm = launched("bridges.launch.py", links=str(tmp_path / "links.yaml"))
    assert (base["name"], base["namespace"]) == ("base", "/robot1")
    protocol = str(tmp_path / "diffdrive.yaml")
    assert base["parameters"] == [{"protocol": protocol, "port": "/dev/ttyUSB0", "baud": 115200}]
    assert (arm["name"], arm["namespace"]) == ("arm", "")
    assert arm["parameters"] == [{"port": "wirebond://arm", "mapping": "/etc/arm.yaml"}]
    assert arm["remappings"] == [("joint_states", "arm/joint_states")]


def test_example_of_the_package_starts_two_nodes(launched: Any) -> None:
    nodes = launched("bridges.launch.py", links=str(PACKAGE / "config" / "links.yaml"))
    assert [node["name"] for node in nodes] == ["base", "arm"]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "has no links; write for example"),
        ("links: {base: {protocol: a.yaml}}", "the link `base` has no port"),
        ("links: {base: {port: /dev/x, prot: a.yaml}}", "has the key `prot`; possible: protocol, mapping, port"),
    ],
)
def test_a_mistake_of_the_file_is_a_sentence(launched: Any, tmp_path: Path, text: str, sentence: str) -> None:
    (tmp_path / "links.yaml").write_text(text)
    with pytest.raises(RuntimeError, match=re.escape(sentence)):
        launched("bridges.launch.py", links=str(tmp_path / "links.yaml"))
