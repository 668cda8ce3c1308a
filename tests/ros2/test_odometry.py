"""Ticks to a pose: exact on arcs, whatever the numbers of the robot."""

from __future__ import annotations

import math

import pytest

from tests.shared import PROTOCOLS
from wirebond.codec import load
from wirebond.ros2.mapping import load_mapping
from wirebond.ros2.mapping.model import OdometryMapping
from wirebond.ros2.odometry import Odometry

STAMP = {"sec": 1, "nanosec": 2}
TURN = 1024  # ticks of one turn of a wheel
RADIUS, SEPARATION = 0.0325, 0.30


@pytest.fixture
def mapping() -> OdometryMapping:
    whole = load_mapping(PROTOCOLS / "ros2" / "diffdrive.yaml", load(PROTOCOLS / "diffdrive.yaml").model)
    assert whole.odometry is not None
    return whole.odometry


def drive(pose: Odometry, left: float, right: float, steps: int = 100) -> None:
    for step in range(steps):
        pose.take({"left_ticks": left / steps, "right_ticks": right / steps}, t=step * 0.05)


def test_wheels_that_turn_alike_go_straight(mapping: OdometryMapping) -> None:
    pose = Odometry(mapping, 0.05)
    drive(pose, 10 * TURN, 10 * TURN)
    assert (pose.x, pose.y, pose.heading) == pytest.approx((20 * math.pi * RADIUS, 0, 0))
    assert pose.speed == pytest.approx(20 * math.pi * RADIUS / 5.0)  # 100 periods of 50 ms
    assert pose.angles == pytest.approx([20 * math.pi] * 2)


def test_wheels_that_turn_against_each_other_turn_on_the_spot(mapping: OdometryMapping) -> None:
    pose = Odometry(mapping, 0.05)
    quarter = math.pi / 2 * SEPARATION / 2 / (2 * math.pi * RADIUS) * TURN
    drive(pose, -quarter, quarter)
    assert (pose.x, pose.y, pose.heading) == pytest.approx((0, 0, math.pi / 2), abs=1e-9)


@pytest.mark.parametrize("steps", [4, 400])
def test_arc_is_exact_however_coarse_its_steps_are(mapping: OdometryMapping, steps: int) -> None:
    pose = Odometry(mapping, 0.05)
    length = 2 * math.pi * 0.5  # a circle around a point 0.5 m to the left
    ticks = [length * (0.5 + side * SEPARATION / 2) / 0.5 / (2 * math.pi * RADIUS) * TURN for side in (-1, 1)]
    drive(pose, ticks[0] / 2, ticks[1] / 2, steps)
    assert (pose.x, pose.y) == pytest.approx((0, 1.0), abs=1e-9)
    assert abs(pose.heading) == pytest.approx(math.pi)


def test_late_message_has_the_time_that_passed(mapping: OdometryMapping) -> None:
    pose = Odometry(mapping, 0.05)
    for t in (0.0, 0.052):
        pose.take({"left_ticks": TURN / 20, "right_ticks": TURN / 20}, t)
    assert pose.speed == pytest.approx(2 * math.pi * RADIUS)  # jitter of the line is no change of speed
    pose.take({"left_ticks": TURN / 20, "right_ticks": TURN / 20}, 0.252)
    assert pose.speed == pytest.approx(2 * math.pi * RADIUS / 4)


def test_wheels_may_change_while_it_runs(mapping: OdometryMapping) -> None:
    pose = Odometry(mapping, 0.05)
    mapping.wheels.radius = 2 * RADIUS
    drive(pose, TURN, TURN)
    assert pose.x == pytest.approx(4 * math.pi * RADIUS)


def test_messages_say_pose_speed_and_how_sure_they_are(mapping: OdometryMapping) -> None:
    pose = Odometry(mapping, 0.05)
    drive(pose, 0, TURN)
    odometry = pose.odometry(STAMP)
    (transform,) = pose.transform(STAMP)["transforms"]
    assert odometry["header"] == transform["header"] == {"stamp": STAMP, "frame_id": "odom"}
    assert odometry["child_frame_id"] == transform["child_frame_id"] == "base_link"
    turned = 2 * math.atan2(transform["transform"]["rotation"]["z"], transform["transform"]["rotation"]["w"])
    assert turned == pytest.approx(2 * math.pi * RADIUS / SEPARATION)
    covariance = odometry["pose"]["covariance"]
    assert (len(covariance), covariance[0], covariance[35]) == (36, pytest.approx(0.05**2), pytest.approx(0.1**2))
    assert pose.joint_states(STAMP)["position"] == pytest.approx([0, 2 * math.pi])
