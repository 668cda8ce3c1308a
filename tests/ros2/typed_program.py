"""A program of ROS with the classes of a built package: it commands the rover, and says as JSON what it received, and
as what the topics are announced. It runs over rclpy."""

from __future__ import annotations

import json
import time
from typing import Any

import rclpy
from diffdrive_msgs.msg import Odometry, Status, Velocity
from std_msgs.msg import String

PATIENCE = 60.0  # seconds: a bound for slow machines, not an expectation
COMMAND = "TX: aa 55 01 f4 01 00 00"  # of 0.5 m/s


def main() -> None:
    """Send until the frame has left, and both messages of the MCU have come."""
    rclpy.init()
    node = rclpy.create_node("reader")
    seen: dict[str, Any] = {}
    sent: list[str] = []
    node.create_subscription(Odometry, "/diffdrive/odometry", lambda message: seen.setdefault("odometry", message), 10)
    node.create_subscription(Status, "/diffdrive/status", lambda message: seen.setdefault("status", message), 10)
    node.create_subscription(String, "/serial_tx_hex", lambda message: sent.append(message.data), 10)
    commands = node.create_publisher(Velocity, "/diffdrive/velocity/send", 10)
    end = time.monotonic() + PATIENCE
    while len(seen) < 2 or not any(frame.startswith(COMMAND) for frame in sent):
        assert time.monotonic() < end, (sorted(seen), sent[-3:])
        commands.publish(Velocity(linear=0.5))
        rclpy.spin_once(node, timeout_sec=0.05)
    (endpoint,) = node.get_publishers_info_by_topic("/diffdrive/status")
    status, odometry = seen["status"], seen["odometry"]
    told = {
        "type": endpoint.topic_type,
        "hash": str(endpoint.topic_type_hash),
        "node": endpoint.node_name,
        "battery": status.battery,
        "errors": [
            name for name in dir(Status) if name.startswith("ERRORS_") and status.errors & getattr(Status, name)
        ],
        "ticks": [odometry.left_ticks, odometry.right_ticks],
        "age": time.time() - odometry.header.stamp.sec,
    }
    print(json.dumps(told))
    node.destroy_node()
    rclpy.shutdown()


main()
