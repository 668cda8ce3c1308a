"""The promises of the guides in docs/ hold: the parts of their examples fit each other."""

from __future__ import annotations

import re
import tomllib
from xml.etree import ElementTree

from packaging.requirements import Requirement

from tests.shared import ROOT
from wirebond.codec import Codec
from wirebond.protocol import loads
from wirebond.ros2.cdr import decode, encode
from wirebond.ros2.mapping import read_mapping

CONTROL = (ROOT / "docs" / "ros2-control.md").read_text(encoding="utf-8")


def block(begins: str) -> str:
    """The text of the fenced block that begins so."""
    found = re.search(rf"^```[a-z ]+\n({re.escape(begins)}.*?)^```", CONTROL, re.MULTILINE | re.DOTALL)
    assert found is not None, begins
    return found[1]


def test_ros2_control_and_the_mapping_have_the_same_joints_and_topics() -> None:
    codec = Codec(loads(block("wirebond: 1")))
    mapping = read_mapping(block("wirebond_ros2: 1"), codec.model)
    control = ElementTree.fromstring(block("<ros2_control"))
    parameters = {one.get("name"): one.text for one in control.iter("param")}
    (states,), (commands,) = mapping.publish, mapping.subscribe
    assert states.topic == parameters["joint_states_topic"]
    assert commands.topic == parameters["joint_commands_topic"]

    fields = {"position": [0.5, -0.5], "velocity": [2.0, -2.0]}
    state = decode(states.type, encode(states.type, states.fill(fields, {"sec": 1, "nanosec": 2})))
    joints = [joint.get("name") for joint in control.iter("joint")]
    assert state["name"] == joints
    assert (list(state["position"]), list(state["velocity"])) == ([0.5, -0.5], [2.0, -2.0])

    # As the component sends it: the joints of the URDF in their order, velocities alone.
    command = decode(commands.type, encode(commands.type, {"name": joints, "velocity": [1.5, -1.5]}))
    assert {name: getter(command) for name, getter in commands.values} == {"left": 1.5, "right": -1.5}
    assert commands.stale == 0.2


def test_numpy_of_the_system_that_jazzy_runs_on_is_enough() -> None:
    """pip leaves it alone then, and the messages of ROS meet the NumPy that they were compiled with."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    (numpy,) = (one for one in map(Requirement, project["dependencies"]) if one.name == "numpy")
    assert numpy.specifier.contains("1.26.4")
