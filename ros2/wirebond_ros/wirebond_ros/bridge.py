"""The executable `bridge`: a link, a mapping, and a node of rclpy between which the bridge runs."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import rclpy
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.executors import ExternalShutdownException

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


def main(arguments: list[str] | None = None) -> int:
    """Until Ctrl-C, or until the link ends. 1: a parameter or a file is wrong, and the log says what."""
    rclpy.init(args=arguments)
    node = rclpy.create_node("wirebond")
    try:
        return _run(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    except wirebond.WirebondError as error:
        node.get_logger().fatal(str(error))
        return 1
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def _run(node: Any) -> int:
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
        thread = threading.Thread(target=bridge.run, name="bridge", daemon=True)
        thread.start()
        try:
            rclpy.spin(node)
        finally:
            bridge.close()
            thread.join(5.0)
            face.close()
    return 0


def _open(settings: dict[str, Any]) -> wirebond.Link:
    if settings["port"].startswith("wirebond://") and not settings["protocol"]:
        return wirebond.open(settings["port"])
    if not settings["protocol"] or not settings["port"]:
        raise wirebond.UsageError("the parameters `protocol` and `port` are needed; set them in the launch file")
    return wirebond.open(settings["protocol"], settings["port"], settings["baud"] or None, wait_for_port=True)
