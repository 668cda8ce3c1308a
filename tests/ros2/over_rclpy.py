"""Where the tests find a real rclpy: that of a sourced ROS 2, or the wheels that `make build/rclpy.stamp` installs."""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path

import pytest

from tests.shared import ROOT

PACKAGE = ROOT / "ros2" / "wirebond_ros"
_WHEELS = ROOT / "build" / "rclpy" / "lib"
_SITE = _WHEELS / f"python{sys.version_info.major}.{sys.version_info.minor}" / "site-packages"


def rclpy_environment() -> dict[str, str]:
    """The environment of a process that runs `wirebond_ros` over rclpy, on this computer alone. Without rclpy the test
    is skipped."""
    if importlib.util.find_spec("rclpy") is not None:
        paths, libraries = [PACKAGE], list[Path]()
    elif (_SITE / "rclpy" / "__init__.py").is_file():
        paths, libraries = [_SITE, PACKAGE], [_WHEELS, *sorted(_SITE.glob("ros_*.libs"))]
    else:
        pytest.skip("no rclpy: source ROS 2, or make build/rclpy.stamp")
    return os.environ | {
        "PYTHONPATH": _before("PYTHONPATH", paths),
        "LD_LIBRARY_PATH": _before("LD_LIBRARY_PATH", libraries),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }


def _before(variable: str, paths: list[Path]) -> str:
    return os.pathsep.join([*map(str, paths), *filter(None, [os.environ.get(variable)])])
