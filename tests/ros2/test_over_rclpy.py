"""`wirebond_ros` over a real rclpy when its port or its server changes under it, and when one of its threads ends."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import wirebond
from tests.patient_servers import be_patient
from tests.ros2.domains import own_domain
from tests.ros2.over_rclpy import rclpy_environment
from tests.ros2.peer import Peer, message, twist
from tests.ros2.test_rover import Served, diagnosed, is_driving, said
from tests.shared import PROTOCOLS, ROOT, rover_program
from tests.waiting import PATIENCE
from wirebond.ros2.dds import LOOPBACK
from wirebond.ros2.diagnostics import WARN
from wirebond.server import Server
from wirebond.sim import rover

pytestmark = pytest.mark.live

DIFFDRIVE = PROTOCOLS / "diffdrive.yaml"


@pytest.fixture(autouse=True)
def domain(monkeypatch: pytest.MonkeyPatch) -> int:
    """A domain that no other process has, on this computer alone."""
    monkeypatch.setenv("ROS_DOMAIN_ID", str(own_domain()))
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    monkeypatch.delenv("ROS_LOCALHOST_ONLY", raising=False)
    return own_domain()


@pytest.fixture(scope="module")
def program() -> Path:
    return rover_program()


@contextmanager
def bridge(port: Path | str, folder: Path) -> Iterator[Peer]:
    """The executable runs, and this process has found its topics."""
    mapping = folder / "mapping.yaml"
    text = (PROTOCOLS / "ros2" / "diffdrive.yaml").read_text()
    mapping.write_text(text.replace("  joints:", "  tf: false\n  joints:"))  # the wheels of rclpy have no tf2_msgs
    served = Served.over_rclpy({"protocol": str(DIFFDRIVE), "port": str(port), "mapping": str(mapping)}, "diffdrive")
    try:
        peer = Peer(own_domain())
        peer.listen("/odom", "nav_msgs/Odometry")
        peer.listen("/diagnostics", "diagnostic_msgs/DiagnosticArray")
        peer.listen("/rosout", "rcl_interfaces/Log", latched=True)
        peer.advertise("/cmd_vel", "geometry_msgs/Twist")
        peer.advertise("/emergency_stop", "std_msgs/Bool")
        peer.advertise("/diffdrive/parameter/send", "std_msgs/String")
        for topic in ("/cmd_vel", "/emergency_stop", "/diffdrive/parameter/send"):
            peer.wait(lambda topic=topic: peer.is_heard(topic))
        peer.wait(lambda: peer.seen["/diagnostics"])  # now it runs: what came before is dropped
        yield peer
    finally:
        served.close()


def drives(peer: Peer) -> None:
    """Commands of ROS move the wheels, as ROS sees them."""
    peer.wait(lambda: is_driving(peer))


def stands(peer: Peer) -> None:
    """The wheels do not turn, as ROS sees them."""
    peer.next("/odom")
    peer.wait(lambda: all(one.twist.twist.linear.x == 0 for one in peer.seen["/odom"][-3:]))


def presses(peer: Peer) -> None:
    """The button of the robot's operator: it is never too late."""
    peer.publish("/emergency_stop", message("std_msgs/Bool", True))


def releases(peer: Peer, is_done: Callable[[], Any], topic: str = "/emergency_stop") -> Any:
    """The operator lets go, again and again: what may have waited while the machine stood still releases nothing."""

    def ask() -> Any:
        peer.publish(topic, message("std_msgs/Bool", False))
        return is_done()

    return peer.wait(ask)


def test_odometry_and_commands_go_on_after_the_cable_was_pulled(program: Path, tmp_path: Path) -> None:
    port = tmp_path / "tty"
    with rover.RoverProcess(program) as first:
        port.symlink_to(first.port)
        with bridge(port, tmp_path) as peer:
            drives(peer)
            port.unlink()
            first.close()
            peer.wait(lambda: [line for line in peer.seen["/rosout"] if line.level == 40])
            with rover.RoverProcess(program) as second:
                port.symlink_to(second.port)
                peer.wait(lambda: said(peer, "the link is back"))
                peer.next("/odom")
                drives(peer)
                peer.wait(lambda: diagnosed(peer, "link", "messages come")["reconnects"] == "1")


def test_port_that_appears_late_has_odometry(program: Path, tmp_path: Path) -> None:
    port = tmp_path / "tty"
    with bridge(port, tmp_path) as peer:
        peer.wait(lambda: said(peer, str(port)))
        with rover.RoverProcess(program) as robot:
            port.symlink_to(robot.port)
            peer.wait(lambda: said(peer, "the link is back"))
            peer.next("/odom")
            drives(peer)


def test_emergency_stop_is_pressed_released_and_pressed_again(program: Path, tmp_path: Path) -> None:
    with rover.RoverProcess(program) as robot, bridge(robot.port, tmp_path) as peer:
        assert peer.wait(lambda: diagnosed(peer, "link", "messages come"))["tty"] == robot.port
        for count in (1, 2):
            drives(peer)
            presses(peer)
            peer.wait(lambda count=count: len(said(peer, "emergency stop: messages that move")) == count)
            stands(peer)
            releases(peer, lambda count=count: len(said(peer, "the emergency stop is released")) == count)
        drives(peer)


def test_second_press_stops_another_program_that_drives(
    program: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    be_patient(monkeypatch)
    with rover.RoverProcess(program) as robot, wirebond.open(DIFFDRIVE, robot.port) as own:
        address = f"wirebond://{tmp_path}/rover.sock"
        with Server(own, tmp_path / "rover.sock"), wirebond.open(address) as other, bridge(address, tmp_path) as peer:
            presses(peer)
            peer.wait(lambda: said(peer, "emergency stop: messages that move"))
            releases(peer, lambda: said(peer, "the emergency stop is released"))
            other.take_control(over=True)

            def is_driven_by_other() -> bool:
                other.send("parameter", name="clear_safe_mode", value=0)
                other.repeat("velocity", linear=0.5)
                return bool(peer.seen["/odom"]) and peer.seen["/odom"][-1].twist.twist.linear.x > 0.4

            peer.wait(is_driven_by_other)
            presses(peer)

            def is_stopped() -> bool:
                try:
                    other.repeat("velocity", linear=0.5)
                except (wirebond.StoppedError, wirebond.NotInControlError):
                    return own.stopped
                return False

            peer.wait(is_stopped)
            stands(peer)


def test_robot_that_holds_commands_back_after_a_pause_says_so_and_drives_again_by_a_topic(
    program: Path, tmp_path: Path
) -> None:
    how = "to end safe_mode: ros2 topic pub --once /diffdrive/recover std_msgs/msg/Empty"
    with rover.RoverProcess(program) as robot, bridge(robot.port, tmp_path) as peer:
        peer.advertise("/diffdrive/recover", "std_msgs/Empty")
        peer.wait(lambda: peer.is_heard("/diffdrive/recover"))
        drives(peer)
        peer.wait(
            lambda: said(peer, f"no velocity was sent for 3 s: the MCU is in safe_mode and ignores velocity; {how}")
        )

        def is_held_back() -> bool:
            peer.publish("/cmd_vel", twist(0.5, 0.0))
            return int(diagnosed(peer, "commands", how).get("held back by the MCU", "0")) > 0

        peer.wait(is_held_back)
        status = [one for array in peer.seen["/diagnostics"] for one in array.status if how in one.message][-1]
        assert status.level == WARN
        stands(peer)

        def drives_again() -> bool:
            peer.publish("/diffdrive/recover", message("std_msgs/Empty"))
            peer.publish("/cmd_vel", twist(0.5, 0.0))
            return peer.seen["/odom"][-1].twist.twist.linear.x == pytest.approx(0.5, rel=0.1)

        peer.wait(drives_again)
        peer.wait(lambda: said(peer, "safe_mode is over: the MCU acts on velocity again"))


FAULTS = {  # of `faulty_bridge`, and a pattern of what the log names
    "topics": "thread `ROS 2 topics`",
    "subscriber": "thread `ROS 2 topics`",
    "services": "thread `ROS 2 services`",
    "publisher": "(thread `bridge of wirebond`|handler `take`)",  # whichever publishes first
    "diagnostics": "thread `bridge of wirebond`",
    "handler of the link": "handler `fail`",
    "parameters": "thread `parameters of the MCU`",
    "services of the link": "thread `services of sim:`",
    "executor": "executor",
}


def test_bridge_of_which_any_part_fails_exits_with_an_error(tmp_path: Path) -> None:
    """Each thread of it: the executor with its timers, topics and their subscribers, services, publishers, the link,
    functions that the link calls. Also where the log lies on a full disk."""
    protocol = tmp_path / "axis.yaml"
    late = "  - {message: pong, at: host, after: 20 ms, then: never_in_time}\n\nemergency_stop:"
    protocol.write_text((PROTOCOLS / "linear_axis.yaml").read_text().replace("\nemergency_stop:", late))
    (tmp_path / "mapping.yaml").write_text(
        "wirebond_ros2: 1\n"
        "services: [{service: x, type: std_srvs/Trigger, message: parameter_read, fields: {index: {text: travel}}}]\n"
    )
    given = {"protocol": protocol, "port": "'sim:'", "mapping": tmp_path / "mapping.yaml"}
    options = [word for name, value in given.items() for word in ("-p", f"{name}:={value}")]
    faults = [*FAULTS, "full:topics"]
    command = [sys.executable, "-m", "tests.ros2.faulty_bridge", *faults, "--ros-args", *options]
    environment = rclpy_environment()
    environment["PYTHONPATH"] += f"{os.pathsep}{ROOT}"
    log = tmp_path / "log"
    with log.open("w") as file:
        running = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=file, text=True)
    peer = Peer(own_domain())
    peer.advertise("/wirebond/move/send", "std_msgs/String")

    def has_ended() -> bool:
        peer.publish("/wirebond/move/send", message("std_msgs/String", '{"speed": 0.1}'))
        return running.poll() is not None

    try:
        peer.wait(has_ended)
    finally:
        running.kill()
        said, _ = running.communicate()
    assert running.returncode == 0, log.read_text()
    assert [json.loads(line) for line in said.splitlines()] == [[fault, 1] for fault in faults]
    ends = [line for line in log.read_text().splitlines() if "FATAL" in line]
    assert len(ends) == len(faults)
    for fault, line in zip(faults, ends, strict=True):
        named = FAULTS[fault.removeprefix("full:")]
        assert re.search(f"the bridge ends: its {named} failed: ZeroDivisionError", line)


def test_arguments_that_ros_does_not_take_have_a_sentence() -> None:
    command = [sys.executable, "-m", "wirebond_ros.bridge", "--ros-args", "-p", "port:=sim:"]
    done = subprocess.run(
        command, env=rclpy_environment(), check=False, capture_output=True, text=True, timeout=PATIENCE
    )
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert "needs quotes: -p port:=\"'sim:'\"" in done.stderr


@pytest.mark.parametrize("fault", ["dds as m; m.DdsNode._tell_mismatches", "diagnostics as m; m.Diagnostics.message"])
def test_server_whose_bridge_ends_exits_with_an_error(fault: str, tmp_path: Path) -> None:
    program = tmp_path / "faulty.py"
    program.write_text(
        "import sys\n"
        "def fail(*_):\n    raise ZeroDivisionError('a fault of the test')\n"
        f"import wirebond.ros2.{fault} = fail\n"
        "from wirebond.cli.main import main\n"
        "sys.exit(main(sys.argv[1:]))\n"
    )
    name = f"faulty-{os.getpid()}"
    command = [sys.executable, str(program), "serve", str(DIFFDRIVE), "sim:", "--ros2", "--name", name]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 1, done.stderr
    assert "the bridge to ROS 2 ends, and the server with it: its thread" in " ".join(done.stderr.split())
