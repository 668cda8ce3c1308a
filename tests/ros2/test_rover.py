"""One suite over both adapters: `wirebond serve --ros2` as a process, and `wirebond_ros` over a real rclpy. Behind each
is the simulated rover on a pty, and this process is the ROS 2 network.

The DDS between them is real, on the loopback interface, in a domain of its own.
"""

from __future__ import annotations

import math
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.ros2.domains import own_domain
from tests.ros2.over_rclpy import rclpy_environment
from tests.ros2.peer import Calls, Peer, message, twist
from tests.shared import PROTOCOLS, rover_program
from tests.waiting import PATIENCE, Stopwatch, let_pass, rounds_for, wait_until
from wirebond.generate.code.ros2 import ros2_files
from wirebond.protocol import load
from wirebond.ros2.dds import LOOPBACK
from wirebond.ros2.types import ros_type, types_from
from wirebond.sim import rover

pytestmark = pytest.mark.live

DIFFDRIVE = PROTOCOLS / "diffdrive.yaml"
TOPICS = {
    "/odom": "nav_msgs/Odometry", "/tf": "tf2_msgs/TFMessage", "/joint_states": "sensor_msgs/JointState",
    "/battery_state": "sensor_msgs/BatteryState", "/diagnostics": "diagnostic_msgs/DiagnosticArray",
    "/serial_rx_data": "std_msgs/UInt8MultiArray", "/serial_rx_hex": "std_msgs/String",
    "/serial_tx_hex": "std_msgs/String", "/status": "diffdrive_msgs/Status",
}  # fmt: skip
# What only `serve --ros2` publishes here. The wheels of rclpy have neither tf2_msgs nor the package of the rover's
# types, which tests/ros2/test_built_messages.py builds.
DDS_ONLY = ("/tf", "/status")
# Types of the package that `wirebond gen --lang ros2` writes, from its files.
GENERATED = {
    type_.short: type_
    for type_ in types_from(
        {
            f"diffdrive_msgs/msg/{Path(name).stem}": text
            for name, text in ros2_files(load(DIFFDRIVE)).items()
            if name.startswith("msg/")
        }
    ).values()
}
WIREBOND = str(Path(sys.executable).with_name("wirebond"))
NOTHING = b"\0\1\0\0\0"  # std_srvs/Trigger_Request
TAKE_CONTROL = "/diffdrive/take_control"
LATCHED = {"/estop": "std_msgs/Bool", "/navigation_ok": "std_msgs/Bool", "/rosout": "rcl_interfaces/Log"}


class Served:
    """A running bridge."""

    def __init__(self, command: list[str], environment: dict[str, str] | None = None) -> None:
        environment = (environment or os.environ) | {"PYTHONFAULTHANDLER": "1"}
        self._process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
        self._lines: queue.Queue[str] = queue.Queue()
        self._collecting = threading.Thread(target=self._collect, daemon=True)
        self._collecting.start()

    @classmethod
    def over_dds(cls, port: str, name: str, *options: str) -> Served:
        """`wirebond serve --ros2`."""
        environment = os.environ | {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}
        return cls([WIREBOND, "serve", str(DIFFDRIVE), port, "--ros2", "--name", name, *options], environment)

    @classmethod
    def over_rclpy(cls, parameters: dict[str, str], node: str, environment: dict[str, str] | None = None) -> Served:
        """The executable of `wirebond_ros`."""
        given = [text for name, value in parameters.items() for text in ("-p", f"{name}:={value}")]
        command = [sys.executable, "-m", "wirebond_ros.bridge", "--ros-args", "-r", f"__node:={node}", *given]
        return cls(command, environment or rclpy_environment())

    def _collect(self) -> None:
        assert self._process.stderr is not None
        for line in self._process.stderr:
            self._lines.put(line)

    def wait_for(self, text: str) -> str:
        """The next line with this text."""
        while True:
            line = self._lines.get(timeout=PATIENCE)
            if text in line:
                return line

    def close(self) -> None:
        """End it. If it does not end, say where its threads are."""
        self._process.terminate()
        try:
            code = self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.send_signal(signal.SIGABRT)
            self._process.wait(PATIENCE)
            self._collecting.join(PATIENCE)
            raise AssertionError("".join(self._lines.get() for _ in range(self._lines.qsize()))) from None
        assert code == 0


@pytest.fixture(scope="module")
def domain() -> Iterator[int]:
    """A domain that no other process has, on this computer alone."""
    number = own_domain()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(number))
        patch.setenv("CYCLONEDDS_URI", LOOPBACK)
        patch.delenv("ROS_LOCALHOST_ONLY", raising=False)
        yield number


@pytest.fixture(scope="module")
def program() -> Path:
    return rover_program()


@pytest.fixture(scope="module")
def robot(program: Path) -> Iterator[rover.RoverProcess]:
    with rover.RoverProcess(program) as running:
        yield running


@pytest.fixture(scope="module", params=["dds", "rclpy"])
def adapter(request: pytest.FixtureRequest) -> str:
    name: str = request.param
    return name


@pytest.fixture(scope="module")
def served(
    adapter: str, domain: int, robot: rover.RoverProcess, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Served]:
    mapping = tmp_path_factory.mktemp("mapping") / "rover.yaml"
    text = (PROTOCOLS / "ros2" / "diffdrive.yaml").read_text()
    if adapter == "dds":
        typed = "\n  - {message: status, topic: status, type: diffdrive_msgs/Status}"
        mapping.write_text(text.replace("publish:", f"publish:{typed}"))
        process = Served.over_dds(robot.port, f"ros-{os.getpid()}", "--mapping", str(mapping))
    else:
        mapping.write_text(text.replace("  joints:", "  tf: false\n  joints:"))
        parameters = {"protocol": str(DIFFDRIVE), "port": robot.port, "mapping": str(mapping)}
        process = Served.over_rclpy(parameters, "diffdrive")
    try:
        yield process
    finally:
        process.close()


@pytest.fixture(scope="module")
def topics(adapter: str) -> dict[str, str]:
    """Return the bridge's topics."""
    return {topic: name for topic, name in TOPICS.items() if adapter == "dds" or topic not in DDS_ONLY}


@pytest.fixture(scope="module")
def peer(served: Served, adapter: str, domain: int, topics: dict[str, str]) -> Peer:
    made = Peer(domain, GENERATED)
    for topic, type_name in topics.items():
        made.listen(topic, type_name)
    for topic, type_name in LATCHED.items():
        made.listen(topic, type_name, latched=True)
    made.listen("discovery", "rmw_dds_common/ParticipantEntitiesInfo", latched=True, raw="ros_discovery_info")
    made.advertise("/cmd_vel", "geometry_msgs/Twist")
    made.advertise("/serial_tx_data", "std_msgs/UInt8MultiArray")
    made.advertise("/diffdrive/parameter/send", "std_msgs/String")
    if adapter == "dds":  # it is attached to its own server, so another program could be in control
        made.advertise(TAKE_CONTROL, "std_msgs/Empty")
        made.wait(lambda: made.is_heard(TAKE_CONTROL))
    for topic in ("/cmd_vel", "/serial_tx_data", "/diffdrive/parameter/send"):
        made.wait(lambda topic=topic: made.is_heard(topic))
    made.wait(lambda: made.seen["/odom"] and made.seen["/diagnostics"] and made.seen["/battery_state"])
    return made


@pytest.fixture
def driving(peer: Peer) -> Peer:
    """It has left its safe mode."""
    end_stall(peer)
    return peer


def take_control(peer: Peer) -> None:
    """A node that the machine held up for too long has lost it."""
    if peer.is_advertised(TAKE_CONTROL):
        peer.publish(TAKE_CONTROL, message("std_msgs/Empty"))


def end_stall(peer: Peer) -> None:
    """Do what an operator does after the machine, with the rover in it, has stood still: take control, end the safe
    mode."""
    take_control(peer)
    peer.publish("/diffdrive/parameter/send", message("std_msgs/String", '{"name": "clear_safe_mode", "value": 0}'))


def command(peer: Peer, linear: float, angular: float = 0.0) -> None:
    take_control(peer)
    peer.publish("/cmd_vel", twist(linear, angular))


def is_driving(peer: Peer) -> bool:
    """Command it to drive, again and again. Does it, fast?"""
    end_stall(peer)
    peer.publish("/cmd_vel", twist(0.5, 0.0))
    return bool(peer.seen["/odom"]) and peer.seen["/odom"][-1].twist.twist.linear.x == pytest.approx(0.5, rel=0.1)


def said(peer: Peer, text: str) -> list[str]:
    return [line.msg for line in peer.seen["/rosout"] if text in line.msg]


def diagnosed(peer: Peer, what: str, message: str = "") -> dict[str, str]:
    """The newest values of this status, with such a message; empty: there was none."""
    statuses = [s for array in peer.seen["/diagnostics"] for s in array.status if s.name == f"diffdrive: {what}"]
    found = [status for status in statuses if message in status.message]
    return {pair.key: pair.value for pair in found[-1].values} if found else {}


def heading(orientation: Any) -> float:
    return 2 * math.atan2(orientation.z, orientation.w)


def drive(peer: Peer, linear: float, angular: float, seconds: float) -> None:
    """Command it as a program of ROS does, at 20 Hz. A pause of the machine may have brought it into its safe mode."""
    end_stall(peer)
    for _ in rounds_for(seconds):
        command(peer, linear, angular)
        peer.look()
        let_pass(0.05)


def stand_still(peer: Peer) -> Any:
    """Wait until its wheels stand; the odometry of that moment."""
    peer.publish("/cmd_vel", twist(0.0, 0.0))
    peer.next("/odom")

    def stands() -> bool:
        last = [abs(o.twist.twist.linear.x) + abs(o.twist.twist.angular.z) for o in peer.seen["/odom"][-4:]]
        return max(last) == 0

    peer.next("/odom")
    peer.wait(stands)
    return peer.seen["/odom"][-1]


def is_called(peer: Peer, service: Calls, answer: str) -> bool:
    """Call it again, unless it says that the call may have waited, or that this node has lost control."""
    command(peer, 0.0)
    is_done, told = service.call(NOTHING) or (False, "")
    assert (is_done, told) == (True, answer) or "held up" in told or "lost control" in told, told
    return is_done


def distance(odometry: Any) -> float:
    """From where the odometry began, in metres."""
    return math.hypot(odometry.pose.pose.position.x, odometry.pose.pose.position.y)


def pose_of_body(robot: rover.RoverProcess) -> list[float]:
    robot.events()
    robot.tell("pose")
    while True:
        for line in robot.events(timeout=PATIENCE):
            _, what, *numbers = line.split(" ")
            if what == "pose":
                return [float(number) for number in numbers]


def test_ros_sees_a_node_with_its_topics_and_the_hashes_of_their_types(peer: Peer, topics: dict[str, str]) -> None:
    def of_the_bridge() -> list[Any]:
        """Return the bridge's log; ROS forgets the bridges that tests have killed only after a while."""
        told = [one for one in peer.seen["discovery"] if len(one.node_entities_info_seq) == 1]
        nodes = [(one.node_entities_info_seq[0], bytes(one.gid.data)) for one in told]
        return [one for one in nodes if (one[0].node_namespace, one[0].node_name) == ("/", "diffdrive")]

    _, participant = peer.wait(of_the_bridge)[-1]
    found, keys = {}, {}

    def are_known() -> bool:
        for endpoint in peer.publications.take(100):
            if bytes(endpoint.participant_key.bytes) == participant:
                data = next((policy.data for policy in endpoint.qos if type(policy).__name__ == "Userdata"), b"")
                found[endpoint.topic_name] = endpoint.type_name, data
                keys[endpoint.topic_name] = endpoint.key.bytes
        return found.keys() >= {"ros_discovery_info", *(f"rt{topic}" for topic in topics | LATCHED)}

    peer.wait(are_known)
    del keys["ros_discovery_info"]
    peer.wait(lambda: {*keys.values()} <= {bytes(gid.data) for gid in of_the_bridge()[-1][0].writer_gid_seq})
    told = ros_type("rmw_dds_common/ParticipantEntitiesInfo")
    assert told is not None
    assert found["ros_discovery_info"] == (told.dds_name, f"typehash={told.hash};".encode())
    for topic, type_name in (topics | LATCHED).items():
        type_ = GENERATED.get(type_name) or ros_type(type_name)
        assert type_ is not None
        assert found[f"rt{topic}"] == (type_.dds_name, f"typehash={type_.hash};".encode())


def test_commands_drive_the_rover_and_their_silence_stops_it(driving: Peer) -> None:
    before = driving.next("/odom")
    driving.wait(lambda: is_driving(driving))
    sent = len(driving.seen["/serial_tx_hex"])
    # No command any more: after 500 ms the bridge sends the stop.
    driving.wait(lambda: any("aa 55 01 00 00 00 00" in line.data for line in driving.seen["/serial_tx_hex"][sent:]))
    driving.wait(lambda: driving.seen["/odom"][-1].twist.twist.linear.x < 0.1)
    assert stand_still(driving).pose.pose.position.x > before.pose.pose.position.x
    assert any("aa 55 01 f4 01" in line.data for line in driving.seen["/serial_tx_hex"])


def test_messages_of_the_rover_become_topics(peer: Peer, topics: dict[str, str]) -> None:
    battery = peer.seen["/battery_state"][-1]
    assert 9 < battery.voltage < 13
    assert (battery.header.frame_id, battery.power_supply_status) == ("base_link", 2)
    assert math.isnan(battery.current)
    if "/status" in topics:
        (status,) = peer.wait(lambda: [s for s in peer.seen["/status"] if s.header.stamp == battery.header.stamp])
        assert (status.battery, status.state) == (pytest.approx(battery.voltage), 0)
    odometry, joints = peer.next("/odom"), peer.seen["/joint_states"][-1]
    assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "base_link")
    assert odometry.header.stamp.sec == pytest.approx(time.time(), abs=3600)  # it is the time of day
    assert joints.name == ["left_wheel_joint", "right_wheel_joint"]
    if "/tf" in topics:
        assert peer.seen["/tf"][-1].transforms[0].child_frame_id == "base_link"
    received = peer.seen["/serial_rx_data"][-1].data
    assert (len(received), bytes(received[:2]).hex()) == (11, "aa55")
    assert peer.seen["/serial_rx_hex"][-1].data.startswith("RX: aa 55 8")


def test_e_stop_is_latched_and_errors_have_words(peer: Peer, robot: rover.RoverProcess) -> None:
    robot.tell("estop on")
    peer.wait(lambda: peer.seen["/estop"] and peer.seen["/estop"][-1].data)
    late = Peer(own_domain())
    late.listen("/estop", "std_msgs/Bool", latched=True)
    assert late.wait(lambda: late.seen["/estop"])[0].data
    robot.tell("estop off")
    peer.wait(lambda: not peer.seen["/estop"][-1].data)

    def errors() -> list[str]:
        statuses = peer.seen["/diagnostics"][-1].status
        return [s.message for s in statuses if s.name == "diffdrive: status errors" and s.level == 2]

    assert peer.wait(errors) == ["no command in time"]  # no /cmd_vel came for more than a second


def test_commands_that_cannot_be_are_clamped_or_refused_and_counted(driving: Peer) -> None:
    watch = Stopwatch()

    def are_told() -> bool:
        command(driving, math.nan)
        command(driving, 0.0, 40.0)
        return all(said(driving, what) for what in ("linear is nan, not a finite number", "angular = 40 rad/s to 3.14"))

    def are_counted() -> bool:
        are_told()
        counts = diagnosed(driving, "commands")
        return int(counts["refused"]) >= 5 and int(counts["clamped"]) >= 5

    driving.wait(are_told)
    driving.wait(are_counted)
    driving.publish("/cmd_vel", twist(0.0, 0.0))
    assert 1 <= len(said(driving, "linear is nan")) <= watch.seconds + 1  # once a second


def test_frames_of_a_topic_are_sent_under_the_same_rules(driving: Peer) -> None:
    layout = message("std_msgs/MultiArrayLayout", [], 0)

    def send(frame: str) -> None:
        data = np.frombuffer(bytes.fromhex(frame), dtype=np.uint8)
        driving.publish("/serial_tx_data", message("std_msgs/UInt8MultiArray", layout, data))

    def drives() -> bool:
        end_stall(driving)
        send("aa 55 01 f4 01 00 00 00 00 0b 0d")  # again: the first may come before the end of the safe mode
        return bool(driving.seen["/odom"][-1].twist.twist.linear.x > 0.2)

    wrong = 0

    def is_refused() -> list[str]:
        nonlocal wrong
        wrong += 1
        send("aa 55 01 f4 01 00 00 00 00 ff 0d")  # of the specification's examples, whose check is wrong
        return said(driving, "11 of its 11 bytes are not a frame of diffdrive")

    driving.wait(drives)
    driving.wait(is_refused)
    facts = driving.wait(lambda: diagnosed(driving, "serial_tx_data", "in the last second bytes came that are no"))
    assert int(facts["bytes: check mismatch"]) in range(11, 11 * wrong + 1, 11)
    stand_still(driving)


def test_safe_mode_of_the_mcu_is_reported_and_ends_by_a_topic(driving: Peer, robot: rover.RoverProcess) -> None:
    """By the start guide: drive, pause for longer than the deadline, drive on."""
    robot.events()
    driving.wait(lambda: is_driving(driving))
    driving.wait(lambda: any(event.endswith("safe_mode") for event in robot.events()))
    driving.wait(lambda: diagnosed(driving, "commands", "the MCU is in safe_mode and ignores velocity"))
    driving.wait(lambda: said(driving, "to end safe_mode: ros2 topic pub --once /diffdrive/recover std_msgs/msg/Empty"))

    def is_held_back() -> bool:
        command(driving, 0.5)
        return diagnosed(driving, "commands", "ignores velocity")["held back by the MCU"] != "0"

    driving.wait(is_held_back)
    assert driving.seen["/odom"][-1].twist.twist.linear.x == 0
    driving.advertise("/diffdrive/recover", "std_msgs/Empty")
    driving.wait(lambda: driving.is_heard("/diffdrive/recover"))

    def has_recovered() -> bool:
        driving.publish("/diffdrive/recover", message("std_msgs/Empty"))
        command(driving, 0.5)
        return bool(driving.seen["/odom"][-1].twist.twist.linear.x > 0.4)

    driving.wait(has_recovered)
    driving.wait(lambda: said(driving, "safe_mode is over"))
    stand_still(driving)


def test_other_quality_of_service_is_reported(peer: Peer, domain: int) -> None:
    other = Peer(domain)
    other.advertise("/cmd_vel", "geometry_msgs/Twist", reliable=False)
    assert "reliability" in peer.wait(lambda: said(peer, "a publisher of /cmd_vel offers less than is asked for"))[0]
    other.listen("/odom", "nav_msgs/Odometry", latched=True)
    assert "durability" in peer.wait(lambda: said(peer, "a subscriber of /odom asks for more than is offered"))[0]


@pytest.mark.parametrize("adapter", ["dds"], indirect=True)  # over rclpy it is the RMW's to tell
def test_other_type_is_reported(peer: Peer, domain: int) -> None:
    other = Peer(domain)
    other.advertise("/cmd_vel", "geometry_msgs/TwistStamped")
    sends = (
        "a publisher of /cmd_vel sends geometry_msgs/TwistStamped, and geometry_msgs/Twist is expected: they exchange"
    )
    peer.wait(lambda: said(peer, sends))
    other.listen("/odom", "geometry_msgs/PoseStamped")
    expects = (
        "a subscriber of /odom expects geometry_msgs/PoseStamped, and nav_msgs/Odometry is published: they exchange"
    )
    peer.wait(lambda: said(peer, expects))
    assert len(said(peer, sends)) == 1


@pytest.mark.parametrize("adapter", ["dds"], indirect=True)
def test_services_answer_programs_over_rmw_cyclonedds(peer: Peer) -> None:
    recover, reset = (peer.serve_calls(name, "std_srvs/Trigger") for name in ("/recover", "/reset_odometry"))
    peer.wait(lambda: recover.is_offered() and reset.is_offered())
    sent = "parameter was sent; the protocol has no reply to it"
    peer.wait(lambda: is_called(peer, recover, sent))
    peer.wait(lambda: any("aa 55 03 00" in line.data for line in peer.seen["/serial_tx_hex"]))

    def has_moved() -> bool:
        drive(peer, 0.5, 0.0, 0.1)
        return distance(peer.seen["/odom"][-1]) > 0.01

    peer.wait(has_moved)
    stand_still(peer)
    peer.wait(lambda: is_called(peer, reset, "the pose begins at zero again"))
    assert distance(peer.next("/odom")) < 0.001
    assert recover.call(NOTHING, header=False) is None  # as Fast DDS asks
    peer.wait(lambda: said(peer, "/recover was called, and not answered: the caller's RMW is another"))


@pytest.mark.parametrize("adapter", ["dds"], indirect=True)
def test_square_driven_by_topic_has_the_pose_of_the_body(driving: Peer, robot: rover.RoverProcess) -> None:
    """Odometry has the ticks since the one before, so that the pose is wrong by what a stall of the machine loses; then
    the robot drives that side again."""

    def drives_a_side() -> bool:
        """True if it made the turn, and odometry and body agree to 1 % of the path and 1 degree."""
        first, body = stand_still(driving).pose.pose, pose_of_body(robot)
        drive(driving, 0.8, 0.0, 0.75)
        drive(driving, 0.0, math.pi / 2, 1.0)
        last, moved = stand_still(driving).pose.pose, pose_of_body(robot)
        # Both began at their own zero; the bridge's began later. Compare in the frame of the start.
        told = seen_from((first.position.x, first.position.y, heading(first.orientation)), last)
        true = seen_from((body[0], body[1], body[2]), moved)
        is_near = math.dist(told[:2], true[:2]) < 0.01 * 0.8 * 0.75
        is_along = abs(math.remainder(told[2] - true[2], 2 * math.pi)) < math.radians(1)
        return abs(true[2]) > 1.25 and is_near and is_along

    for side in range(1, 5):
        wait_until(drives_a_side, f"side {side} of a square, with a pose that is that of the body", 2 * PATIENCE)


def seen_from(start: tuple[float, float, float], end: Any) -> tuple[float, float, float]:
    """Return the place of something relative to its start."""
    if not isinstance(end, list):
        end = [end.position.x, end.position.y, heading(end.orientation)]
    x, y = end[0] - start[0], end[1] - start[1]
    c, s = math.cos(start[2]), math.sin(start[2])
    return c * x + s * y, c * y - s * x, end[2] - start[2]


def test_bridge_waits_for_its_port(domain: int, program: Path, tmp_path: Path) -> None:
    port = tmp_path / "tty"
    served = Served.over_dds(str(port), f"ros-late-{os.getpid()}", "--mapping", str(named(tmp_path, "late")))
    try:
        served.wait_for("Waiting for it")
        peer = Peer(domain)
        peer.listen("/late/odom", "nav_msgs/Odometry")
        peer.listen("/late/navigation_ok", "std_msgs/Bool", latched=True)
        assert not peer.wait(lambda: peer.seen["/late/navigation_ok"])[-1].data
        with rover.RoverProcess(program) as robot:
            port.symlink_to(robot.port)
            peer.wait(lambda: peer.seen["/late/odom"])
            peer.wait(lambda: peer.seen["/late/navigation_ok"][-1].data)
    finally:
        served.close()


def named(folder: Path, name: str) -> Path:
    """The shipped mapping in a namespace of its own."""
    text = (PROTOCOLS / "ros2" / "diffdrive.yaml").read_text()
    file = folder / f"{name}.yaml"
    file.write_text(text.replace("node: diffdrive", f"node: diffdrive\nnamespace: /{name}"))
    return file
