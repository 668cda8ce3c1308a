"""rosidl itself takes every generated message, and computes the hash that the bridge sends."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.ros2.over_rclpy import rclpy_environment
from tests.shared import PROTOCOLS, ROOT
from wirebond.generate.code import generate_ros2
from wirebond.generate.code.ros2_types import interfaces
from wirebond.protocol import load
from wirebond.ros2.mapping.own_types import OwnTypes
from wirebond.ros2.types import ros_type, type_names

pytestmark = pytest.mark.live

GENERATED = ROOT / "tests" / "generate" / "code"
QUICK = [GENERATED / "every_type.yaml"]
ALL = sorted({*PROTOCOLS.glob("*.yaml"), *GENERATED.glob("every_*.yaml")} - set(QUICK))


def share_folder() -> Path:
    """Return the folder that describes the types of ROS: of a sourced ROS 2, or of the wheels."""
    roots = [Path(one) for one in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if one]
    for root in [*roots, ROOT / "build" / "rclpy"]:
        if (root / "share" / "std_msgs" / "msg" / "Header.json").is_file():
            return root / "share"
    pytest.skip("no descriptions of the types of ROS 2")


def test_hashes_of_all_known_types_are_those_of_ros() -> None:
    """Another program warns of an endpoint whose hash is missing or wrong."""
    files = {name: share_folder() / name.replace("/", "/msg/", 1) for name in type_names()}
    described = {name: path.with_suffix(".json") for name, path in files.items() if path.with_suffix(".json").is_file()}
    assert {"std_msgs/Char", "rmw_dds_common/ParticipantEntitiesInfo", "nav_msgs/Odometry"} <= described.keys()
    for name, path in described.items():
        type_ = ros_type(name)
        assert type_ is not None
        own = next(h for h in json.loads(path.read_text())["type_hashes"] if h["type_name"] == type_.name)
        assert (name, type_.hash) == (name, own["hash_string"])


@pytest.mark.parametrize(
    "path", [*QUICK, *(pytest.param(path, marks=pytest.mark.long) for path in ALL)], ids=lambda p: p.stem
)
def test_rosidl_takes_every_message_and_agrees_with_its_hash(path: Path, tmp_path: Path) -> None:
    environment, share = rclpy_environment(), share_folder()
    protocol = load(path)
    package = interfaces(protocol)
    generate_ros2(protocol, tmp_path / package.package)
    program = [sys.executable, str(Path(__file__).with_name("by_rosidl.py"))]
    done = subprocess.run(
        [*program, str(tmp_path / package.package), str(share)],
        env=environment, check=False, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    if "ModuleNotFoundError" in done.stderr:
        pytest.skip("no rosidl: make build/rclpy.stamp")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    own = OwnTypes(protocol)
    assert set(found) == {one.name for one in package.definitions}
    for one in package.definitions:
        type_ = own.named(f"{package.package}/{one.name}")
        assert type_ is not None
        assert found[one.name]["hash"] == type_.hash
        assert found[one.name]["fields"] == [field.name for field in type_.fields]
