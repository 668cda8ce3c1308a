"""The executable `bridge`: a link, a mapping, and a node of rclpy between which the bridge runs; or several of each."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import rclpy
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.utilities import remove_ros_args

import wirebond
from wirebond.ros2.bridge import Bridge
from wirebond.ros2.serving import mapping_for
from wirebond_ros.node import RclpyNode

PARAMETERS: dict[str, tuple[Any, str]] = {
    "protocol": ("", "Protocol file (YAML); not needed where the port is wirebond://NAME"),
    "port": ("", "A tty such as /dev/ttyUSB0, tcp://HOST:PORT, or wirebond://NAME of a running `wirebond serve`"),
    "mapping": ("", "Mapping file; empty: ros2/FILE beside the protocol if it is there, else JSON"),
    "baud": (0, "Bits per second; 0: the protocol's"),
}


_LOOK_EVERY = 1.0  # seconds between two looks whether ROS has ended


def main(arguments: list[str] | None = None) -> int:
    """Until Ctrl-C, or until ROS ends. 1: a parameter or a file is wrong, and the log says what.

    :param arguments: of the command line, its name first. What is not for ROS are names of nodes: each has parameters
        and a link of its own. Without names there is one, ``wirebond``.
    """
    given = sys.argv if arguments is None else arguments
    rclpy.init(args=given)
    executor = SingleThreadedExecutor()
    try:
        with ExitStack() as stack:
            for name in remove_ros_args(args=given)[1:] or ["wirebond"]:
                node = rclpy.create_node(name)
                stack.callback(node.destroy_node)
                try:
                    stack.enter_context(_bridge(node))
                except wirebond.WirebondError as error:
                    node.get_logger().fatal(str(error))
                    return 1
                executor.add_node(node)
            while rclpy.ok():
                # A signal that comes while the executor begins to wait does not always wake it.
                executor.spin_once(timeout_sec=_LOOK_EVERY)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except Exception:
        if rclpy.ok():
            raise
        # ROS has ended while a node was being made: each call of rclpy says so in its own way.
    finally:
        rclpy.try_shutdown()
    return 0


@contextmanager
def _bridge(node: Any) -> Iterator[None]:
    settings = {}
    for name, (default, text) in PARAMETERS.items():
        descriptor = ParameterDescriptor()
        descriptor.description, descriptor.read_only = text, True
        settings[name] = node.declare_parameter(name, default, descriptor).value
    with _open(settings) as link:
        mapping = mapping_for(link.codec, Path(settings["mapping"]) if settings["mapping"] else None)
        # Name and namespace are those that ROS gave the node, by a launch file or on its command line.
        mapping = replace(mapping, node=node.get_name(), namespace=node.get_namespace())
        face = RclpyNode(node)
        bridge = Bridge(link, face, mapping)
        thread = threading.Thread(target=_run, args=[bridge], name=f"bridge of {mapping.node}", daemon=True)
        thread.start()
        try:
            yield
        finally:
            bridge.close()
            thread.join(5.0)
            face.close()


def _run(bridge: Bridge) -> None:
    try:
        bridge.run()
    except Exception:
        if rclpy.ok():
            raise
        # ROS has ended, and the bridge was about to publish.


def _open(settings: dict[str, Any]) -> wirebond.Link:
    if settings["port"].startswith("wirebond://") and not settings["protocol"]:
        return wirebond.open(settings["port"])
    if not settings["protocol"] or not settings["port"]:
        raise wirebond.UsageError("the parameters `protocol` and `port` are needed; set them in the launch file")
    return wirebond.open(settings["protocol"], settings["port"], settings["baud"] or None, wait_for_port=True)


if __name__ == "__main__":
    sys.exit(main())
