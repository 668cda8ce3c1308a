"""The published schema of mapping files: up to date, and of one mind with the reader."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from ruamel.yaml import YAML

from tests.shared import PROTOCOLS
from wirebond.codec import load
from wirebond.errors import ProtocolFileError
from wirebond.ros2.mapping import read_mapping
from wirebond.ros2.mapping.schema import json_schema

ROVER = load(PROTOCOLS / "diffdrive.yaml").model
VALIDATOR = Draft202012Validator(json_schema())
FILE = """\
wirebond_ros2: 1
node: rover
publish:
  - {message: status, topic: volts, type: std_msgs/Float64, qos: {depth: 1}, at_most: 10 Hz, fields: {data: battery}}
  - {message: status, topic: cells, type: std_msgs/Float64, fields: {data: {from: battery, scale: 0.3}}}
subscribe:
  - topic: cmd_vel
    type: geometry_msgs/Twist
    message: velocity
    stale: 500 ms
    fields: {linear: linear.x, angular: 0.5}
poll: [status_query]
"""


def tree(text: str) -> Any:
    return YAML(typ="safe", pure=True).load(text)


def test_schema_is_a_schema_whose_keys_are_described() -> None:
    schema = json_schema()
    Draft202012Validator.check_schema(schema)
    bare = [
        f"{name}.{key}"
        for name, part in {"": schema, **schema["$defs"]}.items()
        for key, entry in part.get("properties", {}).items()
        if "description" not in entry
    ]
    assert bare == []


@pytest.mark.parametrize("path", sorted((PROTOCOLS / "ros2").glob("*.yaml")), ids=lambda path: path.stem)
def test_every_mapping_of_the_project_is_valid(path: Path) -> None:
    assert [error.message for error in VALIDATOR.iter_errors(tree(path.read_text(encoding="utf-8")))] == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("wirebond_ros2: 1", "wirebond_ros2: 2"),
        ("node: rover", "node: my rover"),
        ("node:", "nodes:"),
        ("topic: volts, ", ""),
        ("topic: volts", "topic: vol ts"),
        ("{depth: 1}", "{depth: 0}"),
        ("{depth: 1}", "{depth: 1, durability: latched}"),
        ("10 Hz", "10"),
        ("500 ms", "500"),
        ("{data: battery}", "{data: }"),
        ("{data: battery}", "{data: [battery]}"),
        ("{data: battery}", "{data: 12 V}"),
        ("from: battery, ", ""),
        ("scale: 0.3", "factor: 0.3"),
        ("scale: 0.3", "scale: third"),
        ("poll: [status_query]", "poll: status_query"),
    ],
)
def test_the_reader_refuses_all_that_the_schema_refuses(old: str, new: str) -> None:
    assert VALIDATOR.is_valid(tree(FILE))
    assert read_mapping(FILE, ROVER).node == "rover"
    wrong = FILE.replace(old, new)
    assert not VALIDATOR.is_valid(tree(wrong))
    with pytest.raises(ProtocolFileError):
        read_mapping(wrong, ROVER)
