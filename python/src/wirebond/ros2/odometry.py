"""Computes a pose from wheel ticks: only arithmetic, and the messages of ROS 2 for it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from wirebond.ros2.mapping.model import OdometryMapping

_SLOWEST = 1.5  # a message later than this many periods has its measured time between


class Odometry:
    """The pose of a robot with two driven wheels, from (0, 0, 0) on. One thread at a time."""

    def __init__(self, mapping: OdometryMapping, every: float | None) -> None:
        """``every``: the rhythm of the ticks, in seconds, where the protocol says it."""
        self.x = self.y = self.heading = 0.0
        self.speed = self.turn = 0.0  # m/s and rad/s
        self.angles = [0.0, 0.0]  # of the left and the right wheel, in rad
        self.rates = [0.0, 0.0]
        self._mapping = mapping
        self._every = every
        self._last_t: float | None = None
        self._is_to_reset = False

    def reset(self) -> None:
        """Return to (0, 0, 0) before the next ticks. Any thread."""
        self._is_to_reset = True

    def take(self, fields: Mapping[str, Any], t: float) -> None:
        """Add the ticks since the previous message. ``t``: seconds of any clock."""
        mapping, wheels = self._mapping, self._mapping.wheels
        if self._is_to_reset:
            self._is_to_reset = False
            self.x = self.y = self.heading = 0.0
        angles = [2 * math.pi * fields[side] / wheels.ticks_per_turn for side in (mapping.left, mapping.right)]
        left, right = (wheels.radius * angle for angle in angles)
        forward, turned = (left + right) / 2, (right - left) / wheels.separation
        # Both speeds are constant between two messages: the path is an arc, and its chord points half the turn ahead.
        chord = forward * (math.sin(turned / 2) / (turned / 2) if turned else 1.0)
        self.x += chord * math.cos(self.heading + turned / 2)
        self.y += chord * math.sin(self.heading + turned / 2)
        self.heading = math.remainder(self.heading + turned, 2 * math.pi)
        self.angles = [before + angle for before, angle in zip(self.angles, angles, strict=True)]
        between = self._between(t)
        self.speed, self.turn = forward / between, turned / between
        self.rates = [angle / between for angle in angles]

    def _between(self, t: float) -> float:
        """Return the seconds between the ticks: the protocol's period, which does not jitter, unless one is missing."""
        last, self._last_t = self._last_t, t
        measured = self._every or 0.05 if last is None else max(t - last, 1e-4)
        return measured if self._every is None or measured > _SLOWEST * self._every else self._every

    # ---- as messages

    def odometry(self, stamp: Mapping[str, int]) -> dict[str, Any]:
        """Return the nav_msgs/Odometry."""
        x, y, heading = (deviation**2 for deviation in self._mapping.pose_deviation)
        speed, turn = (deviation**2 for deviation in self._mapping.twist_deviation)
        return {
            "header": {"stamp": stamp, "frame_id": self._mapping.frame},
            "child_frame_id": self._mapping.child_frame,
            "pose": {
                "pose": {"position": {"x": self.x, "y": self.y}, "orientation": self._orientation()},
                "covariance": _diagonal(x, y, _NEVER, _NEVER, _NEVER, heading),
            },
            "twist": {
                "twist": {"linear": {"x": self.speed}, "angular": {"z": self.turn}},
                "covariance": _diagonal(speed, _STILL, _NEVER, _NEVER, _NEVER, turn),
            },
        }

    def transform(self, stamp: Mapping[str, int]) -> dict[str, Any]:
        """Return the tf2_msgs/TFMessage."""
        moved = {"translation": {"x": self.x, "y": self.y}, "rotation": self._orientation()}
        header = {"stamp": stamp, "frame_id": self._mapping.frame}
        return {"transforms": [{"header": header, "child_frame_id": self._mapping.child_frame, "transform": moved}]}

    def joint_states(self, stamp: Mapping[str, int]) -> dict[str, Any]:
        """Return the sensor_msgs/JointState."""
        return {
            "header": {"stamp": stamp},
            "name": self._mapping.joints,
            "position": self.angles,
            "velocity": self.rates,
        }

    def _orientation(self) -> dict[str, float]:
        return {"z": math.sin(self.heading / 2), "w": math.cos(self.heading / 2)}


_NEVER = 1e6  # the variance of values that wheels cannot measure, as filters such as robot_localization expect it
_STILL = 1e-9  # of the sideways speed: wheels do not slip sideways


def _diagonal(*variances: float) -> list[float]:
    covariance = [0.0] * 36
    covariance[::7] = variances
    return covariance
