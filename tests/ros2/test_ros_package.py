"""The package `ros2/wirebond_ros`: colcon builds it, its manifest is valid, and its node does what the bridge asks for.

Here the node runs over a stand-in, which looks at its calls. `test_rover` runs it over rclpy.
"""

from __future__ import annotations

import importlib
import os
import py_compile
import queue
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from catkin_pkg.package import parse_package

from tests.ros2 import stand_in_rclpy
from tests.shared import PROTOCOLS, ROOT
from wirebond.errors import UsageError
from wirebond.ros2.cdr import encode
from wirebond.ros2.node import LATCHED, Parameter, Qos
from wirebond.ros2.types import RosType, ros_type, service_type

PACKAGE = ROOT / "ros2" / "wirebond_ros"


def known(name: str) -> RosType:
    found = ros_type(name)
    assert found is not None
    return found


TWIST = known("geometry_msgs/Twist")


@contextmanager
def package(patch: pytest.MonkeyPatch, *, has_take: bool = True) -> Iterator[Any]:
    """The module with the node."""
    stand_in_rclpy.install(patch, has_take=has_take)
    patch.syspath_prepend(str(PACKAGE))
    yield importlib.import_module("wirebond_ros.node")
    for name in [name for name in sys.modules if name.split(".")[0] == "wirebond_ros"]:
        del sys.modules[name]


@pytest.fixture
def adapter(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    with package(monkeypatch) as module:
        yield module


def test_node_publishes_logs_and_has_parameters(adapter: Any) -> None:
    inner = stand_in_rclpy.Node({"odometry.radius": 0.05})
    node = adapter.RclpyNode(inner)
    node.publisher("/estop", known("std_msgs/Bool"), LATCHED).publish({"data": True})
    assert inner.published["/estop"] == [{"data": True}]
    assert vars(inner.profiles["/estop"]) == {"depth": 1, "reliability": "reliable", "durability": "transient local"}

    values: list[float] = []
    node.declare(Parameter("odometry.radius", 0.0325, 1e-6, 10.0, "Radius of a wheel, in metres", values.append))
    assert inner.set_parameters([SimpleNamespace(name="odometry.radius", value=0.06)]).successful
    assert values == [0.05, 0.06]  # what the launch file gave, and what was set later
    assert inner.descriptors["odometry.radius"].floating_point_range[0].to_value == 10.0

    node.log("warning", "the battery is low")
    assert (inner.lines, node.now_ns()) == ([("warning", "the battery is low")], 5_000_000_000)


def test_goals_are_cancelled_where_their_action_is_there(adapter: Any) -> None:
    inner = stand_in_rclpy.Node()
    cancel = adapter.RclpyNode(inner).canceller("/navigate_to_pose")
    cancel()
    assert inner.asked == []
    inner.services.add("/navigate_to_pose/_action/cancel_goal")
    cancel()
    assert inner.asked == ["/navigate_to_pose/_action/cancel_goal"]


def test_services_answer(adapter: Any) -> None:
    inner, type_ = stand_in_rclpy.Node(), service_type("std_srvs/Trigger")
    assert type_ is not None
    adapter.RclpyNode(inner).serve("/recover", type_, lambda request: {"success": request == {}, "message": "sent"})
    assert vars(inner.served["/recover"]()) == {"success": True, "message": "sent"}
    with pytest.raises(UsageError, match=r"this ROS 2 has no std_srvs/SetBool; .* apt install ros-jazzy-std-srvs"):
        adapter.RclpyNode(inner).serve("/x", service_type("std_srvs/SetBool"), lambda request: request)


def test_parameter_that_is_refused_stays_and_one_that_has_changed_is_not_set_again(adapter: Any) -> None:
    inner = stand_in_rclpy.Node()
    node = adapter.RclpyNode(inner)
    taken: list[float] = []

    def take(value: float) -> None:
        if value > 2:
            raise UsageError("the MCU refused it")
        taken.append(value)

    for name in ("mcu.kp", "mcu.ki"):
        node.declare(Parameter(name, 1.0, None, None, "gain", take))
    kp, ki, kp_refused = (
        SimpleNamespace(name=n, value=v) for n, v in (("mcu.kp", 2.0), ("mcu.ki", 0.5), ("mcu.kp", 3.0))
    )
    assert inner.set_parameters([kp]).successful
    assert vars(inner.set_parameters([kp_refused])) == {"successful": False, "reason": "the MCU refused it"}
    assert not inner.set_parameters([kp, ki]).successful
    node.update("mcu.kp", 1.5)
    assert taken == [2.0]


def test_messages_are_taken_in_a_loop_from_the_start_on(adapter: Any) -> None:
    inner = stand_in_rclpy.Node()
    node = adapter.RclpyNode(inner)
    taken: queue.Queue[float] = queue.Queue()
    node.subscribe("/cmd_vel", TWIST, Qos(reliable=False), lambda values: taken.put(values["linear"]["x"]))
    assert inner.profiles["/cmd_vel"].reliability == "best effort"
    subscription = inner.subscriptions["/cmd_vel"]
    subscription.waiting.append(encode(TWIST, {"linear": {"x": 0.1}}))
    node.start()  # what waits at the start is old
    subscription.waiting += [
        encode(TWIST, {"linear": {"x": 0.2}}),
        b"no message",
        encode(TWIST, {"linear": {"x": 0.3}}),
    ]
    assert [taken.get(timeout=20), taken.get(timeout=20)] == [0.2, 0.3]
    assert node.undecodable == {"/cmd_vel": 1}
    node.close()


def test_executor_serves_subscriptions_where_rclpy_has_no_take(monkeypatch: pytest.MonkeyPatch) -> None:
    with package(monkeypatch, has_take=False) as adapter:
        inner = stand_in_rclpy.Node()
        node = adapter.RclpyNode(inner)
        taken: list[Any] = []
        node.subscribe("/cmd_vel", TWIST, Qos(), taken.append)
        inner.callbacks["/cmd_vel"](encode(TWIST, {"linear": {"x": 0.1}}))
        node.start()
        inner.callbacks["/cmd_vel"](encode(TWIST, {"linear": {"x": 0.2}}))
        assert [values["linear"]["x"] for values in taken] == [0.2]


def test_type_that_is_not_installed_has_a_sentence(adapter: Any) -> None:
    missing = replace(TWIST, name="nav2_msgs/msg/SpeedLimit")
    with pytest.raises(UsageError, match=r"this ROS 2 has no nav2_msgs/SpeedLimit; .* apt install ros-jazzy-nav2-msgs"):
        adapter.RclpyNode(stand_in_rclpy.Node()).publisher("/x", missing, Qos())


@pytest.mark.parametrize(
    ("parameters", "code"),
    [({"protocol": str(PROTOCOLS / "diffdrive.yaml"), "port": "sim:"}, 0), ({"port": "/dev/ttyUSB7"}, 1)],
)
def test_executable_runs_the_bridge(monkeypatch: pytest.MonkeyPatch, parameters: dict[str, str], code: int) -> None:
    nodes = stand_in_rclpy.install(monkeypatch)
    monkeypatch.syspath_prepend(str(PACKAGE))
    nodes.append(node := stand_in_rclpy.Node(parameters))
    executable = importlib.import_module("wirebond_ros.bridge")
    assert executable.main(["bridge"]) == code
    for name in [name for name in sys.modules if name.split(".")[0] == "wirebond_ros"]:
        del sys.modules[name]
    if code == 0:
        assert node.published["/robot1/odom"][0]["header"]["frame_id"] == "odom"
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
    for name in ("bridge", "bridges"):
        path = installed / "share" / "wirebond_ros" / "launch" / f"{name}.launch.py"
        py_compile.compile(str(path), str(tmp_path / "x"), doraise=True)
