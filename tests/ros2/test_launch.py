"""The launch files, over a stand-in of ROS's launch: which nodes they start."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
import yaml

from tests.shared import ROOT

PACKAGE = ROOT / "ros2" / "wirebond_ros"
TWO = """\
links:
  base: {protocol: diffdrive.yaml, port: /dev/ttyUSB0, namespace: /robot1, baud: 115200}
  arm: {port: "wirebond://arm", mapping: /etc/arm.yaml, remappings: {joint_states: arm/joint_states}}
"""


class TypedValue:
    """Stands for ParameterValue of launch_ros."""

    def __init__(self, value: Any, value_type: type) -> None:
        self.value, self.value_type = value, value_type


def evaluated(value: Any) -> Any:
    """The value that the node gets, by the rules of launch_ros: a text without a type is read as YAML."""
    text = value.value if isinstance(value, TypedValue) else value
    text = text.perform(None) if hasattr(text, "perform") else text
    if isinstance(value, TypedValue):
        return value.value_type(text)
    if not isinstance(text, str):
        return text
    found = yaml.safe_load(text or "''")
    if not isinstance(found, bool | int | float | str):
        raise TypeError(f"Allowed value types are bytes, bool, int, float, str. Got {type(found)}")
    return found


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
                return arguments.get(self.key, "")

        def node_of(**named: Any) -> dict[str, Any]:
            (parameters,) = named["parameters"]
            return named | {"parameters": {key: evaluated(value) for key, value in parameters.items()}}

        keep = lambda *given, **named: SimpleNamespace(given=given, **named)  # noqa: E731
        add("launch", LaunchDescription=lambda entities: entities)
        add("launch.actions", DeclareLaunchArgument=keep, OpaqueFunction=keep)
        add("launch.substitutions", LaunchConfiguration=Configuration)
        add("launch_ros")
        add("launch_ros.actions", Node=node_of)
        add("launch_ros.parameter_descriptions", ParameterValue=TypedValue)
        found = runpy.run_path(str(PACKAGE / "launch" / name))["generate_launch_description"]()
        nodes = [one for one in found if isinstance(one, dict)]
        for one in found:
            if hasattr(one, "function"):
                nodes += one.function(None)
        return nodes

    return run


def test_one_link_is_a_node_with_its_parameters(launched: Any) -> None:
    (node,) = launched("bridge.launch.py", protocol="/etc/diffdrive.yaml", port="sim:")
    assert (node["package"], node["executable"], node["name"]) == ("wirebond_ros", "bridge", "wirebond")
    assert node["parameters"] == {"protocol": "/etc/diffdrive.yaml", "port": "sim:", "mapping": ""}
    assert (node["respawn"], node["respawn_delay"]) == (True, 1.0)


def test_each_link_of_a_file_is_a_node(launched: Any, tmp_path: Path) -> None:
    (tmp_path / "links.yaml").write_text(TWO)
    base, arm = launched("bridges.launch.py", links=str(tmp_path / "links.yaml"))
    assert (base["name"], base["namespace"]) == ("base", "/robot1")
    protocol = str(tmp_path / "diffdrive.yaml")
    assert base["parameters"] == {"protocol": protocol, "port": "/dev/ttyUSB0", "baud": 115200}
    assert (arm["name"], arm["namespace"]) == ("arm", "")
    assert arm["parameters"] == {"port": "wirebond://arm", "mapping": "/etc/arm.yaml"}
    assert (arm["respawn"], arm["respawn_delay"]) == (True, 1.0)
    assert arm["remappings"] == [("joint_states", "arm/joint_states")]


def test_port_of_a_file_may_be_a_virtual_mcu(launched: Any, tmp_path: Path) -> None:
    (tmp_path / "links.yaml").write_text("links: {base: {protocol: diffdrive.yaml, port: 'sim:'}}")
    (node,) = launched("bridges.launch.py", links=str(tmp_path / "links.yaml"))
    assert node["parameters"]["port"] == "sim:"


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
