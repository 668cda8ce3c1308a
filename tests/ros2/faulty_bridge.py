"""Runs the executable of `wirebond_ros` once for each fault that is named: a part of it raises. Says as JSON with which
code it ended. The log is on standard error."""

from __future__ import annotations

import errno
import importlib
import io
import json
import os
import sys
from contextlib import ExitStack, redirect_stderr
from typing import Any, NoReturn
from unittest import mock

import wirebond_ros.bridge as executable


def fail(*_: Any, **__: Any) -> NoReturn:
    raise ZeroDivisionError("a fault of the test")


def fail_in_a_timer(node: Any, _: Any) -> None:
    node.create_timer(0.01, fail)


class FullDisk(io.StringIO):
    """A disk that accepts no more bytes."""

    def write(self, _: str) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


FAULTS = {
    "topics": ("wirebond_ros.taking", "TakeLoop._wait", fail),
    "subscriber": ("wirebond.ros2.commands", "Commands.send", fail),
    "services": ("wirebond_ros.calls", "_next", fail),
    "publisher": ("wirebond_ros.node", "RclpyPublisher.publish_encoded", fail),
    "diagnostics": ("wirebond.ros2.diagnostics", "Diagnostics.message", fail),
    "handler of the link": ("wirebond.ros2.bridge", "Bridge._on_deadline", fail),
    "parameters": ("wirebond.ros2.mcu_parameters", "McuParameters._reconnects", fail),
    "services of the link": ("wirebond.link.services", "Services._run", fail),
    "executor": ("rclpy.node", "Node.add_on_set_parameters_callback", fail_in_a_timer),
}


def main(given: list[str]) -> None:
    """``given``: faults, and behind ``--ros-args`` what is for ROS. A fault that begins with ``full:`` has a standard
    error on a full disk."""
    executable._LOOK_EVERY = 0.02
    names = given[: given.index("--ros-args")]
    for name in names:
        module, place, stand_in = FAULTS[name.removeprefix("full:")]
        *owner, attribute = place.split(".")
        target: Any = importlib.import_module(module)
        for part in owner:
            target = getattr(target, part)
        with ExitStack() as stack:
            if name.startswith("full:"):
                stack.enter_context(redirect_stderr(FullDisk()))
            stack.enter_context(mock.patch.object(target, attribute, stand_in))
            print(json.dumps([name, executable.main(["bridge", *given[len(names) :]])]), flush=True)


main(sys.argv[1:])
