"""`wirebond demo --ros2`: a rover that stands until a program of ROS drives it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.ros2.domains import own_domain
from tests.ros2.peer import Peer, twist
from tests.waiting import PATIENCE
from wirebond.ros2.dds import LOOPBACK

pytestmark = pytest.mark.live

WIREBOND = str(Path(sys.executable).with_name("wirebond"))


def test_demo_gives_a_rover_to_drive(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(own_domain()))
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    process = subprocess.Popen([WIREBOND, "demo", "--ros2", "--terminal"], stdout=subprocess.PIPE, text=True)
    try:
        peer = Peer(own_domain())
        peer.listen("/odom", "nav_msgs/Odometry")
        peer.advertise("/cmd_vel", "geometry_msgs/Twist")
        peer.wait(lambda: len(peer.seen["/odom"]) > 20 and peer.is_heard("/cmd_vel"))
        assert {one.twist.twist.linear.x for one in peer.seen["/odom"]} == {0.0}

        def drives() -> bool:
            peer.publish("/cmd_vel", twist(0.3, 0.0))
            return bool(peer.seen["/odom"][-1].twist.twist.linear.x == pytest.approx(0.3, rel=0.1))

        peer.wait(drives)
    finally:
        process.terminate()
        said, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0
    assert "ROS 2 node /diffdrive. It does not move until ROS drives it:" in " ".join(said.split())
    assert 'ros2 topic pub -r 10 /cmd_vel geometry_msgs/msg/Twist "{linear: {x: 0.3}, angular: {z: 0.5}}"' in said
