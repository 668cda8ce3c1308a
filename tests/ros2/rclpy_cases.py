"""The node of `wirebond_ros` over a real rclpy, in one process. `test_ros_package` runs it where there is one."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import rclpy
import wirebond_ros.bridge as executable
import wirebond_ros.taking
from action_msgs.srv import CancelGoal
from geometry_msgs.msg import Twist
from rcl_interfaces.msg import Log
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter as RosParameter
from rclpy.qos import QoSProfile, QoSReliabilityPolicy
from std_msgs.msg import Bool
from std_srvs.srv import Trigger
from wirebond_ros.node import RclpyNode, class_of

from tests.shared import PROTOCOLS
from tests.waiting import PATIENCE, let_pass, moments
from wirebond.codec import load
from wirebond.errors import UsageError
from wirebond.ros2.cdr import encode
from wirebond.ros2.mapping.own_types import OwnTypes
from wirebond.ros2.node import LATCHED, LEVELS, Parameter, Qos
from wirebond.ros2.types import RosType, ros_type, service_type

pytestmark = pytest.mark.live


def known(name: str) -> RosType:
    found = ros_type(name)
    assert found is not None
    return found


TWIST = known("geometry_msgs/Twist")


class Ros:
    """Nodes in a context of their own, which a thread spins."""

    def __init__(self) -> None:
        self._context = rclpy.Context()
        rclpy.init(args=[], context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._is_over = threading.Event()
        self._numbers = itertools.count()
        self.other = self.node()
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def node(self, **parameters: float) -> Any:
        made = rclpy.create_node(
            f"node{next(self._numbers)}",
            context=self._context,
            parameter_overrides=[
                RosParameter(key.replace("__", "."), value=value) for key, value in parameters.items()
            ],
        )
        self._executor.add_node(made)
        return made

    def _spin(self) -> None:
        while not self._is_over.is_set():
            self._executor.spin_once(timeout_sec=0.02)

    def close(self) -> None:
        self._is_over.set()
        self._thread.join(PATIENCE)
        rclpy.shutdown(context=self._context)


@pytest.fixture(scope="module")  # rclpy has its log on /rosout in the first context of a process alone
def ros() -> Iterator[Ros]:
    made = Ros()
    yield made
    made.close()


def wait(what: Callable[[], Any]) -> Any:
    for _ in moments():
        if found := what():
            return found
    raise AssertionError


def test_latched_topic_comes_to_a_late_subscriber(ros: Ros) -> None:
    node = RclpyNode(ros.node())
    node.publisher("/estop", known("std_msgs/Bool"), LATCHED).publish({"data": True})
    seen: list[Bool] = []
    (info,) = wait(lambda: ros.other.get_publishers_info_by_topic("/estop"))
    assert (info.qos_profile.reliability.name, info.qos_profile.durability.name) == ("RELIABLE", "TRANSIENT_LOCAL")
    ros.other.create_subscription(
        Bool, "/estop", seen.append, QoSProfile(depth=1, durability=info.qos_profile.durability)
    )
    assert wait(lambda: seen)[0].data is True


def test_one_node_logs_every_severity(ros: Ros) -> None:
    seen: list[Log] = []
    ros.other.create_subscription(Log, "/rosout", seen.append, QoSProfile(depth=100))
    node = RclpyNode(inner := ros.node())
    wait(lambda: inner.count_subscribers("/rosout"))
    expected = [(number, f"a line of {level}") for level, number in LEVELS.items() if level != "debug"]

    def has_all() -> bool:
        for level in LEVELS:  # one place logs them all, again and again
            node.log(level, f"a line of {level}")
        return {(line.level, line.msg) for line in seen if line.name == inner.get_name()} >= set(expected)

    wait(has_all)


def test_parameter_has_its_range_and_the_value_that_the_user_gave(ros: Ros) -> None:
    node = RclpyNode(inner := ros.node(odometry__radius=0.05))
    values: list[float] = []
    node.declare(Parameter("odometry.radius", 0.0325, 1e-6, 10.0, "Radius of a wheel, in metres", values.append))
    (result,) = inner.set_parameters([RosParameter("odometry.radius", value=0.06)])
    assert result.successful
    assert values == [0.05, 0.06]
    (span,) = inner.describe_parameter("odometry.radius").floating_point_range
    assert (span.from_value, span.to_value) == (1e-6, 10.0)
    (result,) = inner.set_parameters([RosParameter("odometry.radius", value=11.0)])
    assert (result.successful, values) == (False, [0.05, 0.06])


def test_parameter_of_another_type_has_a_sentence_and_stays(ros: Ros) -> None:
    node = RclpyNode(inner := ros.node(mcu__kp=2))
    values: list[float] = []
    with pytest.raises(UsageError, match=r"'mcu.kp' to '2' of type 'INTEGER', .*a number that may have a fraction is"):
        node.declare(Parameter("mcu.kp", 1.0, None, None, "gain", values.append))
    node.update("mcu.kp", 1.5)
    assert (inner.get_parameter("mcu.kp").value, values) == (1.5, [])


def test_parameter_that_is_refused_stays_and_one_that_has_changed_is_not_set_again(ros: Ros) -> None:
    node = RclpyNode(inner := ros.node())
    taken: list[float] = []

    def take(value: float) -> None:
        if value > 2:
            raise UsageError("the MCU refused it")
        taken.append(value)

    for name in ("mcu.kp", "mcu.ki"):
        node.declare(Parameter(name, 1.0, None, None, "gain", take))
    kp, ki, kp_refused = (RosParameter(n, value=v) for n, v in (("mcu.kp", 2.0), ("mcu.ki", 0.5), ("mcu.kp", 3.0)))
    assert inner.set_parameters([kp])[0].successful
    (refused,) = inner.set_parameters([kp_refused])
    assert (refused.successful, refused.reason) == (False, "the MCU refused it")
    assert inner.get_parameter("mcu.kp").value == 2.0
    assert not inner.set_parameters_atomically([kp, ki]).successful
    node.update("mcu.kp", 1.5)
    assert (inner.get_parameter("mcu.kp").value, taken) == (1.5, [2.0])


def test_goals_are_cancelled_where_their_action_is_there(ros: Ros) -> None:
    cancel = RclpyNode(inner := ros.node()).canceller("/navigate_to_pose")
    cancel()  # nobody is there
    asked: list[bool] = []

    def answer(_: Any, response: Any) -> Any:
        asked.append(True)
        return response

    ros.other.create_service(CancelGoal, "/navigate_to_pose/_action/cancel_goal", answer)
    (client,) = inner.clients
    wait(client.service_is_ready)
    cancel()
    wait(lambda: asked)


@pytest.mark.parametrize("has_take", [True, False])
def test_services_answer(ros: Ros, has_take: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wirebond_ros.calls._can_take", lambda: has_take)
    node, type_ = RclpyNode(ros.node()), service_type("std_srvs/Trigger")
    assert type_ is not None
    node.serve("/recover", type_, lambda request: {"success": request == {}, "message": "sent"})
    node.start()
    client = ros.other.create_client(Trigger, "/recover")
    wait(client.service_is_ready)
    future = client.call_async(Trigger.Request())
    wait(future.done)
    assert (future.result().success, future.result().message) == (True, "sent")
    node.close()


def test_type_that_is_not_installed_has_a_sentence(ros: Ros) -> None:
    node, trigger = RclpyNode(ros.node()), service_type("std_srvs/Trigger")
    missing = replace(TWIST, name="nav2_msgs/msg/SpeedLimit")
    with pytest.raises(UsageError, match=r"this ROS 2 has no nav2_msgs/SpeedLimit; .* apt install ros-jazzy-nav2-msgs"):
        node.publisher("/x", missing, Qos())
    assert trigger is not None
    with pytest.raises(UsageError, match=r"this ROS 2 has no nav_srvs/Go; .* apt install ros-jazzy-nav-srvs"):
        node.serve("/x", replace(trigger, name="nav_srvs/Go"), lambda request: request)


def test_package_of_types_that_is_not_built_has_a_sentence() -> None:
    codec = load(PROTOCOLS / "diffdrive.yaml")
    with pytest.raises(UsageError, match=r"no diffdrive_msgs/Status; write its package by `wirebond gen --lang ros2`"):
        class_of(OwnTypes(codec.model).of("status"))


@pytest.mark.parametrize("has_take", [True, False])
def test_messages_are_taken_from_the_start_on(ros: Ros, has_take: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where rclpy lacks the calls of the loop, and its executor serves the subscriptions."""
    monkeypatch.setattr(wirebond_ros.taking, "_can_take", lambda: has_take)
    node = RclpyNode(inner := ros.node())
    topic, taken = f"/cmd_vel/{has_take}", list[float]()
    node.subscribe(topic, TWIST, Qos(reliable=False), lambda values: taken.append(values["linear"]["x"]))
    (info,) = inner.get_subscriptions_info_by_topic(topic)
    assert info.qos_profile.reliability == QoSReliabilityPolicy.BEST_EFFORT
    publisher = ros.other.create_publisher(Twist, topic, 10)
    wait(publisher.get_subscription_count)

    def publish(data: bytes) -> None:
        publisher.publish(data)

    publish(encode(TWIST, {"linear": {"x": 0.1}}))
    let_pass(0.1)  # it may have come by now, and is dropped all the same
    node.start()
    ends = [encode(TWIST, {"linear": {"x": 0.2}}), b"\0\1\0\0no message", encode(TWIST, {"linear": {"x": 0.3}})]

    def has_come() -> bool:
        if not taken:
            publish(ends[0])
        return bool(taken)

    wait(has_come)
    for data in ends[1:]:
        publish(data)
    wait(lambda: taken[-1] == 0.3)
    assert set(taken) == {0.2, 0.3}
    assert node.undecodable == {topic: 1}
    assert node.stalls.why_old == ""
    node.close()


EXAMPLES = {
    "no port": ([], "the parameters `protocol` and `port` are needed"),
    "port that YAML reads as true": (["-p", "port:=y"], "'port' to 'True' of type 'BOOL', expecting type 'STRING'"),
    "port that YAML reads as a mapping": (["-p", "port:=sim:"], "needs quotes: -p port:=\"'sim:'\""),
    "baud rate in words": (["-p", "baud:=fast"], "'baud' to 'fast' of type 'STRING', expecting type 'INTEGER'"),
    "radius without a point": (["-p", "odometry.radius:=1"], "a number that may have a fraction is 1.0, not 1"),
    "negative radius": (["-p", "odometry.radius:=-1.0"], "odometry.radius out of range"),
    "unknown quality of service": (
        ["-p", "qos_overrides./odom.publisher.reliability:=x"],
        "/odom: Unexpected QoS override for policy `reliability`: `x`; correct its qos_overrides",
    ),
    "file that is not there": (["-p", "mapping:=/nope"], "/nope: there is no such file; check the path"),
    "name that is none": (["-r", "__node:=bad-name"], "bad-name"),
}


@pytest.mark.parametrize("example", EXAMPLES)
def test_mistake_of_the_user_has_a_sentence(example: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text(
        "wirebond_ros2: 1\n"
        "odometry: {message: odometry, left: left_ticks, right: right_ticks, tf: false,\n"
        "  wheel_radius: 0.0325, wheel_separation: 0.30, ticks_per_turn: 1024}\n"
    )
    given, sentence = EXAMPLES[example]
    right = {"protocol": PROTOCOLS / "diffdrive.yaml", "port": "'sim:'", "mapping": mapping} if given else {}
    options = [word for name, value in right.items() for word in ("-p", f"{name}:={value}")]
    assert executable.main(["bridge", "--ros-args", *options, *given]) == 1
    said = capfd.readouterr().err
    assert sentence in said
    assert "Traceback" not in said


def test_log_folder_that_cannot_be_has_a_sentence(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(rclpy, "init", _no_log_folder)
    assert executable.main(["bridge"]) == 1
    assert capfd.readouterr().err == "ROS does not start: failed to initialize logging: there is no folder\n"


def _no_log_folder(**_: Any) -> None:
    raise RuntimeError("failed to initialize logging: there is no folder")
