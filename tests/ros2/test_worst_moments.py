"""`wirebond_ros` over a real rclpy, and `wirebond serve --ros2`, at the worst moments: stopped and continued, killed,
on a full disk, beside another bridge, and when the server restarts; each with a press of the emergency stop."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

import wirebond
from tests.patient_servers import be_patient
from tests.ros2.domains import own_domain
from tests.ros2.over_rclpy import rclpy_environment
from tests.ros2.peer import Peer, message, twist
from tests.ros2.test_over_rclpy import DIFFDRIVE, domain, drives, presses, program, releases, stands
from tests.ros2.test_rover import WIREBOND, diagnosed, said
from tests.shared import PROTOCOLS
from tests.suspended import Suspended
from tests.waiting import PATIENCE, let_pass
from wirebond.server import Server
from wirebond.sim import rover

pytestmark = pytest.mark.live

__all__ = ["domain", "program"]  # fixtures
FAST = "aa 55 01 20 03"  # how a frame of `velocity` with 0.8 m/s begins
TOO_OLD = 1.0  # seconds; a bridge takes what has waited for half of it for old
EMPTY = message("std_msgs/Empty")


@pytest.fixture(autouse=True)
def kept_stops(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A stop that a test leaves is none for another one, whose port may have the same name."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))


@contextmanager
def running(
    adapter: str, port: str, folder: Path, namespace: str = "", full_disk: bool = False
) -> Iterator[tuple[subprocess.Popen[str], Peer]]:
    """The bridge as a process, and a program that has found its topics. It is killed at the end."""
    mapping = folder / "mapping.yaml"
    text = (PROTOCOLS / "ros2" / "diffdrive.yaml").read_text()
    mapping.write_text(text.replace("  joints:", "  tf: false\n  joints:"))  # the wheels of rclpy have no tf2_msgs
    given = {"protocol": DIFFDRIVE, "port": port, "mapping": mapping}
    options = [word for name, value in given.items() for word in ("-p", f"{name}:={value}")]
    names = ["-r", "__node:=diffdrive", "-r", f"__ns:={namespace or '/'}"]
    commands = {
        "rclpy": [sys.executable, "-m", "wirebond_ros.bridge", "--ros-args", *names, *options],
        "dds": [WIREBOND, "serve", str(DIFFDRIVE), port, "--ros2", "--name", f"worst-{os.getpid()}", "--mapping",
                str(mapping)],
    }  # fmt: skip
    command = commands[adapter]
    if full_disk:
        command = ["sh", "-c", 'ulimit -f 0 && exec "$@" 2>/dev/full', "sh", *command]
    process = subprocess.Popen(
        command, env=rclpy_environment() if adapter == "rclpy" else None, stderr=subprocess.DEVNULL, text=True
    )
    try:
        peer = Peer(own_domain())
        peer.listen("/odom" if not namespace else f"{namespace}/odom", "nav_msgs/Odometry")
        peer.listen("/diagnostics", "diagnostic_msgs/DiagnosticArray")
        peer.listen("/rosout", "rcl_interfaces/Log", latched=True)
        peer.listen(f"{namespace}/serial_tx_hex", "std_msgs/String")
        topics = {"/cmd_vel": "geometry_msgs/Twist", "/emergency_stop": "std_msgs/Bool"}
        topics["/diffdrive/parameter/send"] = "std_msgs/String"
        if port.startswith("wirebond:") or adapter == "dds":
            topics["/diffdrive/take_control"] = "std_msgs/Empty"
        for topic, type_name in topics.items():
            peer.advertise(namespace + topic, type_name)
        for topic in topics:
            peer.wait(lambda topic=topic: peer.is_heard(namespace + topic))
        peer.wait(lambda: peer.seen["/diagnostics"])  # now it runs: what came before is dropped
        yield process, peer
    finally:
        process.kill()
        process.wait(PATIENCE)


def sent(peer: Peer) -> list[str]:
    peer.look()
    return [one.data for one in peer.seen["/serial_tx_hex"]]


def takes_control(peer: Peer, namespace: str) -> bool:
    peer.publish(f"{namespace}/diffdrive/take_control", EMPTY)
    return bool(said(peer, "this node is in control of the robot"))


@pytest.mark.parametrize("adapter", ["rclpy", "dds"])
def test_bridge_that_was_stopped_and_continued_acts_on_no_old_command(
    adapter: str, program: Path, tmp_path: Path
) -> None:
    with rover.RoverProcess(program) as robot, running(adapter, robot.port, tmp_path) as (process, peer):
        pause = None
        while pause is None or pause.has_run:
            if pause is not None and adapter == "dds":
                peer.wait(lambda: takes_control(peer, ""))
            drives(peer)
            before = len(sent(peer))
            with Suspended(process.pid) as pause:
                peer.publish("/cmd_vel", twist(0.8, 0.0))
                let_pass(TOO_OLD)
                peer.publish("/emergency_stop", message("std_msgs/Bool", False))
        peer.wait(lambda: said(peer, "velocity was not sent: it may have waited while this node was held up"))
        peer.wait(lambda: said(peer, "the emergency stop was not released: it may have waited"))
        peer.wait(lambda: diagnosed(peer, "commands").get("refused", "0") != "0")
        assert not [frame for frame in sent(peer)[before:] if FAST in frame]
        if adapter == "dds":  # its server has heard nothing from it for too long
            peer.wait(lambda: takes_control(peer, ""))
        drives(peer)  # once the stall is over
        with Suspended(process.pid):
            peer.publish("/emergency_stop", message("std_msgs/Bool", True))
            let_pass(TOO_OLD)
        peer.wait(lambda: said(peer, "emergency stop: messages that move"))  # it is never too late
        stands(peer)


def test_emergency_stop_outlives_a_bridge_that_is_killed_also_on_a_full_disk(program: Path, tmp_path: Path) -> None:
    with rover.RoverProcess(program) as robot:
        with running("rclpy", robot.port, tmp_path, full_disk=True) as (_, peer):
            drives(peer)
            presses(peer)
            peer.wait(lambda: said(peer, "emergency stop: messages that move"))
        with running("rclpy", robot.port, tmp_path) as (_, peer):
            peer.wait(lambda: said(peer, "an emergency stop still holds"))

            def is_refused() -> list[str]:
                peer.publish("/cmd_vel", twist(0.8, 0.0))
                return said(peer, "velocity was not sent: an emergency stop holds velocity")

            peer.wait(is_refused)
            stands(peer)
            assert not [frame for frame in sent(peer) if FAST in frame]
            releases(peer, lambda: said(peer, "the emergency stop is released"))
            drives(peer)


def test_two_bridges_share_a_server_that_restarts(
    program: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    be_patient(monkeypatch)
    address, socket = f"wirebond://{tmp_path}/rover.sock", tmp_path / "rover.sock"
    with rover.RoverProcess(program) as robot, wirebond.open(DIFFDRIVE, robot.port) as own, ExitStack() as stack:
        server = stack.enter_context(Server(own, socket))
        (tmp_path / "other").mkdir()
        process, peer = stack.enter_context(running("rclpy", address, tmp_path))
        _, other = stack.enter_context(running("rclpy", address, tmp_path / "other", namespace="/other"))
        drives(peer)
        take = "end its control there, then take it: ros2 topic pub --once /other/diffdrive/take_control"

        def is_refused() -> list[str]:
            other.publish("/other/cmd_vel", twist(0.8, 0.0))  # the first may come before its odometry
            return said(other, take)

        line, *_ = other.wait(is_refused)
        assert re.search(rf"ROS node /diffdrive \(\d+\) is in control of the robot; {take}", line)
        other.publish("/other/emergency_stop", message("std_msgs/Bool", True))  # anybody may stop
        peer.wait(lambda: own.stopped)
        stands(peer)
        line, *_ = releases(peer, lambda: said(peer, "the emergency stop still holds"))  # the other one stopped it
        over = "look at the robot, then publish to /emergency_stop/release_over"
        assert re.search(rf"ROS node /other/diffdrive \(\d+\) stopped the robot; {over}", line)
        releases(other, lambda: not own.stopped, "/other/emergency_stop")
        assert not [frame for frame in sent(peer) if FAST in frame]

        server.close()
        peer.wait(lambda: said(peer, "no server runs at"))
        presses(peer)
        peer.wait(lambda: said(peer, "emergency stop: NOT confirmed, trying again until false comes"))
        stack.enter_context(Server(own, socket))
        peer.wait(lambda: own.stopped)
        peer.wait(lambda: said(peer, "emergency stop: messages that move"))
        releases(peer, lambda: not own.stopped)
        drives(peer)

        process.kill()  # while it drives

        def stands_for_other() -> bool:
            return all(one.twist.twist.linear.x == 0 for one in other.seen["/other/odom"][-3:])

        other.next("/other/odom")
        other.wait(stands_for_other)
