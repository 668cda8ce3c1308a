"""Finds a real rclpy for the tests: that of a sourced ROS 2, or the wheels that `make build/rclpy.stamp` installs."""

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
    """As `find_rclpy`. Without rclpy the test is skipped."""
    found = find_rclpy()
    if found is None:
        pytest.skip("no rclpy: source ROS 2, or make build/rclpy.stamp")
    return found


def find_rclpy() -> dict[str, str] | None:
    """The environment of a process that runs `wirebond_ros` over rclpy, on this computer alone; None: there is none."""
    if importlib.util.find_spec("rclpy") is not None:
        paths, libraries = [PACKAGE], list[Path]()
    elif (_SITE / "rclpy" / "__init__.py").is_file():
        paths, libraries = [_SITE, PACKAGE], [_WHEELS, *sorted(_SITE.glob("ros_*.libs"))]
    else:
        return None
    return os.environ | {
        "PYTHONPATH": _before("PYTHONPATH", paths),
        "LD_LIBRARY_PATH": _before("LD_LIBRARY_PATH", libraries),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }


def build_environment() -> dict[str, str]:
    """The environment of a `colcon build` with the generators of ROS 2. Without those the test is skipped."""
    environment = rclpy_environment() | {"PATH": _before("PATH", [Path(sys.executable).parent])}
    if "AMENT_PREFIX_PATH" not in os.environ:
        if not (_WHEELS.parent / "share" / "rosidl_default_generators").is_dir():
            pytest.skip("no generators of ROS 2: make build/rclpy.stamp")
        environment |= dict.fromkeys(("AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH"), str(_WHEELS.parent))
    return environment


def with_package(environment: dict[str, str], prefix: Path) -> dict[str, str]:
    """Return the environment with a package that was installed there."""
    site = prefix / _SITE.relative_to(_WHEELS.parent)
    return environment | {
        name: os.pathsep.join(filter(None, [str(path), environment.get(name, "")]))
        for name, path in (("PYTHONPATH", site), ("LD_LIBRARY_PATH", prefix / "lib"), ("AMENT_PREFIX_PATH", prefix))
    }


def _before(variable: str, paths: list[Path]) -> str:
    return os.pathsep.join([*map(str, paths), *filter(None, [os.environ.get(variable)])])
