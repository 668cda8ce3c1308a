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
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.utilities import remove_ros_args

import wirebond
from wirebond.link.attached.attaching import attached_as
from wirebond.link.stop_file import StopFile, stop_file_of
from wirebond.ros2.bridge import Bridge
from wirebond.ros2.failure import Failure
from wirebond.ros2.serving import mapping_for
from wirebond_ros.node import RclpyNode, words_of

PARAMETERS: dict[str, tuple[Any, str]] = {
    "protocol": ("", "Protocol file (YAML); not needed where the port is wirebond://NAME"),
    "port": (
        "",
        "A tty such as /dev/ttyUSB0, tcp://HOST:PORT, sim: (a virtual MCU), or wirebond://NAME of a `wirebond serve`",
    ),
    "mapping": ("", "Mapping file; empty: ros2/FILE beside the protocol if it is there, else JSON"),
    "baud": (0, "Bits per second; 0: the protocol's"),
}


_LOOK_EVERY = 1.0  # seconds between two checks whether ROS has ended, or a thread of the bridge has failed


def main(arguments: list[str] | None = None) -> int:
    """Run until Ctrl-C, or until ROS ends. 1: a parameter or a file is wrong, or a thread failed; the log says what.

    :param arguments: of the command line, its name first. What is not for ROS are names of nodes: each has parameters
        and a link of its own. Without names there is one, ``wirebond``.
    """
    given = sys.argv if arguments is None else arguments
    try:
        rclpy.init(args=given)
    except RuntimeError as error:
        print(f"ROS does not start: {words_of(error)}", file=sys.stderr)
        return 1
    failure = Failure(lambda: not rclpy.ok())
    threading.excepthook = failure.note_thread  # those of the link, too
    try:
        return _run(remove_ros_args(args=given)[1:] or ["wirebond"], failure)
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    except NameValidationException as error:
        get_logger("wirebond").fatal(words_of(error))
        return 1
    except Exception:
        if rclpy.ok():
            raise
        return 0  # ROS has ended while a node was being made: each call of rclpy says so in its own way
    finally:
        rclpy.try_shutdown()


def _run(names: list[str], failure: Failure) -> int:
    """Run a bridge for each of these nodes."""
    executor = SingleThreadedExecutor()
    with ExitStack() as stack:
        failures = [failure]
        for name in names:
            node = rclpy.create_node(name)
            stack.callback(node.destroy_node)
            try:
                failures.append(stack.enter_context(_bridge(node)))
            except (ParameterException, wirebond.WirebondError) as error:
                node.get_logger().fatal(words_of(error))
                return 1
            executor.add_node(node)
        while rclpy.ok():
            try:
                # A signal that comes while the executor begins to wait does not always wake it.
                executor.spin_once(timeout_sec=_LOOK_EVERY)
            except ExternalShutdownException:
                raise
            except Exception as error:
                failure.note("its executor", error)
            if why := next(filter(None, (one.why for one in failures)), ""):
                # If only its topics stopped, the robot would seem to be silent. `respawn` starts a new bridge.
                node.get_logger().fatal(f"the bridge ends: {why}")
                return 1
    return 0


@contextmanager
def _bridge(node: Any) -> Iterator[Failure]:
    settings = {}
    for name, (default, text) in PARAMETERS.items():
        descriptor = ParameterDescriptor()
        descriptor.description, descriptor.read_only = text, True
        settings[name] = node.declare_parameter(name, default, descriptor).value
    name = f"{node.get_namespace().rstrip('/')}/{node.get_name()}"
    with attached_as(f"ROS node {name}"):
        link = _open(settings)
    with link:
        mapping = mapping_for(link.codec, Path(settings["mapping"]) if settings["mapping"] else None)
        # Name and namespace are those that ROS gave the node, by a launch file or on its command line.
        mapping = replace(mapping, node=node.get_name(), namespace=node.get_namespace())
        face = RclpyNode(node)
        bridge = Bridge(link, face, mapping, _kept_stop(link, name))
        thread = bridge.start()
        try:
            yield face.failure
        finally:
            bridge.close()
            thread.join(5.0)
            face.close()


def _kept_stop(link: wirebond.Link, node: str) -> StopFile | None:
    """Return the stop file for the bridge that `respawn` starts. If a server owns the port, it keeps the stop; a
    virtual robot ends with its program."""
    if link.port.startswith(("wirebond://", "sim:")):
        return None
    return stop_file_of(f"ros2{node}", link.port)


def _open(settings: dict[str, Any]) -> wirebond.Link:
    if settings["port"].startswith("wirebond://") and not settings["protocol"]:
        return wirebond.open(settings["port"])
    if not settings["protocol"] or not settings["port"]:
        raise wirebond.UsageError("the parameters `protocol` and `port` are needed; set them in the launch file")
    return wirebond.open(settings["protocol"], settings["port"], settings["baud"] or None, wait_for_port=True)


if __name__ == "__main__":
    sys.exit(main())
