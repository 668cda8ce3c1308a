"""The package that `wirebond gen --lang ros2` writes: colcon builds it with the generators of ROS 2, and a program of
ROS with its classes talks to both bridges, each a process of its own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.ros2.domains import own_domain
from tests.ros2.over_rclpy import build_environment, with_package
from tests.ros2.test_rover import Served
from tests.shared import PROTOCOLS
from wirebond.generate.code import generate_ros2
from wirebond.protocol import load
from wirebond.ros2.dds import LOOPBACK
from wirebond.ros2.mapping.own_types import OwnTypes

pytestmark = [pytest.mark.live, pytest.mark.long]
DIFFDRIVE = PROTOCOLS / "diffdrive.yaml"
MAPPING = "wirebond_ros2: 1\ntyped_topics: all\nserial: true\npoll: [status_query]\n"


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The environment with the built package."""
    workspace = tmp_path_factory.mktemp("ws")
    generate_ros2(load(DIFFDRIVE), workspace / "src" / "diffdrive_msgs")
    environment = build_environment() | {"COLCON_HOME": str(workspace / "home")}
    command = ["colcon", "build", "--executor", "sequential", "--cmake-args", f"-DPython3_EXECUTABLE={sys.executable}"]
    done = subprocess.run(
        command, cwd=workspace, env=environment, check=False, capture_output=True, text=True, timeout=900
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "1 package finished" in done.stdout
    return with_package(environment, workspace / "install" / "diffdrive_msgs")


@pytest.fixture(params=["dds", "rclpy"])
def bridge(
    request: pytest.FixtureRequest, built: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[dict[str, str]]:
    """A bridge runs; the environment of programs that meet it."""
    number = own_domain()
    environment = built | {"ROS_DOMAIN_ID": str(number)}
    (tmp_path / "mapping.yaml").write_text(MAPPING)
    if request.param == "dds":
        monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
        monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
        served = Served.over_dds("sim:", f"typed-{os.getpid()}", "--mapping", str(tmp_path / "mapping.yaml"))
    else:
        parameters = {"protocol": str(DIFFDRIVE), "port": "'sim:'", "mapping": str(tmp_path / "mapping.yaml")}
        served = Served.over_rclpy(parameters, "diffdrive", environment)
    try:
        yield environment
    finally:
        served.close()


def test_program_with_the_built_classes_talks_to_the_bridge(bridge: dict[str, str]) -> None:
    program = [sys.executable, str(Path(__file__).with_name("typed_program.py"))]
    done = subprocess.run(program, env=bridge, check=False, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    type_ = OwnTypes(load(DIFFDRIVE)).of("status")
    assert (told["type"], told["hash"], told["node"]) == ("diffdrive_msgs/msg/Status", type_.hash, "diffdrive")
    assert isinstance(told["battery"], float)
    assert told["errors"] == []
    assert abs(told["age"]) < 60
