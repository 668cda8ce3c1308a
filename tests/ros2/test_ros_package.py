"""The package `ros2/wirebond_ros`: colcon builds it, its manifest is valid, and its node does what the bridge asks for.

Without ROS 2 the node runs over a stand-in; where ROS 2 is sourced, over rclpy.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import py_compile
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from catkin_pkg.package import parse_package

from tests.ros2 import stand_in_rclpy
from tests.shared import PROTOCOLS, ROOT
from wirebond.ros2.node import LATCHED, Parameter, Qos
from wirebond.ros2.types import RosType, ros_type

HAS_ROS = importlib.util.find_spec("rclpy") is not None
over_the_stand_in = pytest.mark.skipif(HAS_ROS, reason="looks into a stand-in of rclpy, and the real one is here")
PACKAGE = ROOT / "ros2" / "wirebond_ros"


def known(name: str) -> RosType:
    found = ros_type(name)
    assert found is not None
    return found


@pytest.fixture
def adapter() -> Iterator[Any]:
    """The module with the node."""
    with pytest.MonkeyPatch.context() as patch:
        if not HAS_ROS:
            stand_in_rclpy.install(patch)
        patch.syspath_prepend(str(PACKAGE))
        yield importlib.import_module("wirebond_ros.node")
        for name in [name for name in sys.modules if name.split(".")[0] == "wirebond_ros"]:
            del sys.modules[name]


VALUES = {
    "diagnostic_msgs/DiagnosticArray": {
        "status": [{"level": 2, "name": "a", "values": [{"key": "k", "value": "v"}]}],
        "header": {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": "f"},
    },
    "std_msgs/UInt8MultiArray": {"data": b"\xaa\x55\x00"},
    "geometry_msgs/Pose": {"position": {"x": 1}},
    "sensor_msgs/JointState": {"name": ("left", "right"), "position": (0.5, 1.5)},
    "std_msgs/Bool": {"data": True},
}


@pytest.mark.parametrize("name", VALUES)
def test_values_become_messages_of_rclpy_and_come_back(adapter: Any, name: str) -> None:
    found = adapter.to_values(known(name), adapter.to_message(known(name), VALUES[name]))

    def holds(given: Any, had: Any) -> bool:
        if isinstance(given, dict):
            return all(holds(value, had[key]) for key, value in given.items())
        if isinstance(given, list | tuple | bytes):
            return len(given) == len(had) and all(map(holds, given, had))
        return bool(given == had)

    assert holds(VALUES[name], found), found
    if name == "geometry_msgs/Pose":
        assert found["orientation"]["w"] == 1.0


def test_unknown_field_is_a_mistake_of_the_caller(adapter: Any) -> None:
    with pytest.raises(ValueError, match="std_msgs/Bool has no field date"):
        adapter.to_message(known("std_msgs/Bool"), {"date": True})


@over_the_stand_in
def test_node_publishes_subscribes_logs_and_has_parameters(adapter: Any) -> None:
    inner = stand_in_rclpy.Node({"odometry.radius": 0.05})
    node = adapter.RclpyNode(inner)
    node.publisher("/estop", known("std_msgs/Bool"), LATCHED).publish({"data": True})
    assert inner.published["/estop"][0].data is True
    assert vars(inner.profiles["/estop"]) == {"depth": 1, "reliability": "reliable", "durability": "transient local"}

    taken: list[dict[str, Any]] = []
    node.subscribe("/cmd_vel", known("geometry_msgs/Twist"), Qos(reliable=False), taken.append)
    twist = adapter.to_message(known("geometry_msgs/Twist"), {"linear": {"x": 0.5}})
    inner.callbacks["/cmd_vel"](twist)
    node.start()
    inner.callbacks["/cmd_vel"](twist)
    assert [one["linear"]["x"] for one in taken] == [0.5]
    assert inner.profiles["/cmd_vel"].reliability == "best effort"

    values: list[float] = []
    node.declare(Parameter("odometry.radius", 0.0325, 1e-6, 10.0, "Radius of a wheel, in metres", values.append))
    assert inner.set_parameters([SimpleNamespace(name="odometry.radius", value=0.06)]).successful
    assert values == [0.05, 0.06]  # what the launch file gave, and what was set later
    assert inner.descriptors["odometry.radius"].floating_point_range[0].to_value == 10.0

    node.log("warning", "the battery is low")
    assert (inner.lines, node.now_ns()) == ([("warning", "the battery is low")], 5_000_000_000)


@over_the_stand_in
@pytest.mark.parametrize(
    ("parameters", "code"),
    [({"protocol": str(PROTOCOLS / "diffdrive.yaml"), "port": "sim:"}, 0), ({"port": "/dev/ttyUSB7"}, 1)],
)
def test_executable_runs_the_bridge(monkeypatch: pytest.MonkeyPatch, parameters: dict[str, str], code: int) -> None:
    nodes = stand_in_rclpy.install(monkeypatch)
    monkeypatch.syspath_prepend(str(PACKAGE))
    nodes.append(node := stand_in_rclpy.Node(parameters))
    executable = importlib.import_module("wirebond_ros.bridge")
    assert executable.main() == code
    for name in [name for name in sys.modules if name.split(".")[0] == "wirebond_ros"]:
        del sys.modules[name]
    if code == 0:
        assert node.published["/robot1/odom"][0].header.frame_id == "odom"
        assert "odometry.radius" in node.descriptors
        assert node.descriptors["port"].read_only
    else:
        assert node.lines[-1][0] == "fatal"


def test_manifest_is_valid_and_lists_every_package_of_messages() -> None:
    manifest = parse_package(str(PACKAGE))
    manifest.validate()
    assert (manifest.name, manifest.get_build_type()) == ("wirebond_ros", "ament_python")
    needed = {depend.name for depend in manifest.exec_depends}
    assert {"rclpy", "std_msgs", "nav_msgs", "tf2_msgs", "diagnostic_msgs", "sensor_msgs"} <= needed


def test_colcon_builds_it(tmp_path: Path) -> None:
    shutil.copytree(PACKAGE, tmp_path / "src" / "wirebond_ros", ignore=shutil.ignore_patterns("__pycache__"))
    bin_folder = Path(sys.executable).parent
    environment = os.environ | {"PATH": f"{bin_folder}:{os.environ['PATH']}", "COLCON_HOME": str(tmp_path / "home")}

    def colcon(*arguments: str) -> str:
        command = [str(bin_folder / "colcon"), *arguments]
        return subprocess.run(
            command, cwd=tmp_path, env=environment, check=True, capture_output=True, text=True, timeout=120
        ).stdout

    assert "(ros.ament_python)" in colcon("list")  # with a bad manifest colcon takes it for plain Python, and is silent
    assert "1 package finished" in colcon("build", "--executor", "sequential")
    installed = tmp_path / "install" / "wirebond_ros"
    assert (installed / "lib" / "wirebond_ros" / "bridge").is_file()
    assert (installed / "share" / "ament_index" / "resource_index" / "packages" / "wirebond_ros").is_file()
    py_compile.compile(str(installed / "share/wirebond_ros/launch/bridge.launch.py"), str(tmp_path / "x"), doraise=True)
