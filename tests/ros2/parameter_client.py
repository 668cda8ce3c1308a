"""A program of ROS that sets parameters of the node /axis and calls its service, and says as JSON what came of it. It
runs over rclpy."""

from __future__ import annotations

import json
import sys
from typing import Any

import rclpy
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from std_srvs.srv import Trigger

PATIENCE = 60.0  # seconds: a bound for slow machines, not an expectation
LOOK_EVERY = 0.1  # seconds


def main() -> None:
    """Wait until the node has what is asked for, set each value, and read it."""
    rclpy.init()
    node = rclpy.create_node("client")
    client = AsyncParameterClient(node, "axis")
    assert client.wait_for_services(PATIENCE)

    def answer(future: Any) -> Any:
        rclpy.spin_until_future_complete(node, future, timeout_sec=PATIENCE)
        return future.result()

    name = sys.argv[1]
    while name not in answer(client.list_parameters(["mcu"], 2)).result.names:
        pass
    for value in map(float, sys.argv[2:]):
        (result,) = answer(client.set_parameters([Parameter(name, value=value)])).results
        (now,) = answer(client.get_parameters([name])).values
        print(json.dumps([result.successful, result.reason, now.double_value]))
    caller = node.create_client(Trigger, "/axis/travel")
    assert caller.wait_for_service(PATIENCE)
    called = answer(caller.call_async(Trigger.Request()))
    while "if it is still wanted" in called.message:  # the node was held up, and the call may have waited
        called = answer(caller.call_async(Trigger.Request()))
    print(json.dumps([called.success, called.message]))

    def names() -> list[str]:
        return [f"{namespace.rstrip('/')}/{name}" for name, namespace in node.get_node_names_and_namespaces()]

    for _ in range(round(PATIENCE / LOOK_EVERY)):  # the graph becomes known step by step
        publishers = node.get_publishers_info_by_topic("/axis/state")
        counters = node.count_publishers("/axis/counters")
        if publishers and counters and {"/axis", "/robot1/other"} <= set(names()):
            break
        rclpy.spin_once(node, timeout_sec=LOOK_EVERY)
    print(json.dumps([[one.qos_profile.reliability.name for one in publishers], counters]))
    print(json.dumps(names()))
    node.destroy_node()
    rclpy.shutdown()


main()
