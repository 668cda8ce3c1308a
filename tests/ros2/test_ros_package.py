"""The package `ros2/wirebond_ros`: colcon builds it, its manifest is valid, and its node does what the bridge asks for,
over a real rclpy: a process with it runs `rclpy_cases.py`."""

from __future__ import annotations

import ast
import os
import py_compile
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from catkin_pkg.package import parse_package

from tests.ros2.domains import own_domain
from tests.ros2.over_rclpy import rclpy_environment
from tests.shared import ROOT

pytestmark = pytest.mark.live

PACKAGE = ROOT / "ros2" / "wirebond_ros"
CASES = Path(__file__).with_name("rclpy_cases.py")
NAMES = [
    node.name
    for node in ast.parse(CASES.read_text()).body
    if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
]


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    """Return why each case failed, for each of its parameters; empty: it passed."""
    report = tmp_path_factory.mktemp("cases") / "report.xml"
    environment = rclpy_environment() | {"ROS_DOMAIN_ID": str(own_domain())}
    environment["PYTHONPATH"] += f"{os.pathsep}{ROOT}"
    command = [sys.executable, "-m", "pytest", str(CASES), "-q", "-p", "no:cacheprovider", f"--junitxml={report}"]
    done = subprocess.run(command, env=environment, cwd=ROOT, check=False, capture_output=True, text=True, timeout=600)
    assert report.is_file(), done.stdout + done.stderr
    found: dict[str, list[str]] = {}
    for case in ElementTree.parse(report).iter("testcase"):
        name = case.attrib["name"].partition("[")[0]
        found.setdefault(name, []).append("".join(text for part in case for text in part.itertext()))
    return found


@pytest.mark.parametrize("name", NAMES)
def test_node_over_rclpy(name: str, outcomes: dict[str, list[str]]) -> None:
    assert outcomes[name]
    assert not any(outcomes[name]), "\n".join(outcomes[name])


def test_manifest_is_valid_and_lists_every_package_of_messages() -> None:
    manifest = parse_package(str(PACKAGE))
    manifest.validate()
    assert (manifest.name, manifest.get_build_type()) == ("wirebond_ros", "ament_python")
    needed = {depend.name for depend in manifest.exec_depends}
    assert {"rclpy", "std_msgs", "nav_msgs", "tf2_msgs", "diagnostic_msgs", "sensor_msgs"} <= needed


def test_colcon_builds_it(tmp_path: Path) -> None:
    shutil.copytree(PACKAGE, tmp_path / "src" / "wirebond_ros", ignore=shutil.ignore_patterns("__pycache__"))
    bin_folder = Path(sys.executable).parent
    environment = os.environ | {"PATH": f"{bin_folder}:{os.environ['PATH']}", "COLCON_HOME": str(tmp_path / "home")}

    def colcon(*arguments: str) -> str:
        command = [str(bin_folder / "colcon"), *arguments]
        return subprocess.run(
            command, cwd=tmp_path, env=environment, check=True, capture_output=True, text=True, timeout=120
        ).stdout

    assert "(ros.ament_python)" in colcon("list")  # with a bad manifest colcon takes it for plain Python, and is silent
    assert "1 package finished" in colcon("build", "--executor", "sequential")
    installed = tmp_path / "install" / "wirebond_ros"
    assert (installed / "lib" / "wirebond_ros" / "bridge").is_file()
    assert (installed / "share" / "ament_index" / "resource_index" / "packages" / "wirebond_ros").is_file()
    for name in ("bridge", "bridges"):
        path = installed / "share" / "wirebond_ros" / "launch" / f"{name}.launch.py"
        py_compile.compile(str(path), str(tmp_path / "x"), doraise=True)
