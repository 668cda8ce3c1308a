"""Mapping files: what they say, and that every mistake has a sentence at its place."""

# ruff: noqa: E501 in the table of mistakes each has one row
from __future__ import annotations

from pathlib import Path

import pytest

from tests.shared import PROTOCOLS
from wirebond.codec import load
from wirebond.errors import ProtocolFileError
from wirebond.protocol import loads
from wirebond.ros2.cdr import decode, encode
from wirebond.ros2.mapping import BridgeMapping, default_mapping, load_mapping, read_mapping
from wirebond.ros2.serving import mapping_for

ROVER = load(PROTOCOLS / "diffdrive.yaml").model
STAMP = {"sec": 7, "nanosec": 9}
GIMBAL = loads("""
wirebond: 1
protocol: gimbal
frame: [magic: 0xA5, id: u8, length: u8, payload: by_length, check: crc-16/modbus]
types: {rates: {x: {type: i16, scale: 0.001}, y: {type: i16, scale: 0.001}}}
messages:
  imu:
    id: 1
    sender: mcu
    fields:
      q: {type: f32, count: 4}
      rate: {struct: rates}
      mode: {type: u8, enum: {off: 0, track: 1}}
      serial: {type: bytes, size: 3}
      count: {type: u32}
      name: {type: text, size: 4}
  aim: {id: 2, sender: host, fields: {yaw: {type: f32}, pitch: {type: f32, default: 0}, mode: {type: u8, enum: {off: 0, on: 1}}}}
""")


def read(text: str, protocol: object = ROVER) -> BridgeMapping:
    return read_mapping(f"wirebond_ros2: 1\n{text}", protocol)  # type: ignore[arg-type]


def test_without_a_file_every_message_has_a_topic_with_json() -> None:
    mapping = default_mapping(ROVER)
    assert [m.name for m in mapping.json_out] == ["status", "odometry"]
    assert [m.name for m in mapping.json_in] == ["velocity", "status_query", "parameter"]


def test_mapping_beside_the_protocol_is_found() -> None:
    mapping = mapping_for(load(PROTOCOLS / "diffdrive.yaml"), None)
    assert mapping.path == str(PROTOCOLS / "ros2" / "diffdrive.yaml")
    assert {out.topic for out in mapping.publish} == {"battery_state", "estop"}
    assert mapping_for(load(PROTOCOLS / "native.yaml"), None).path == ""


def test_values_go_where_the_file_says() -> None:
    mapping = read(
        """
publish:
  - message: imu
    topic: /tf
    type: tf2_msgs/TFMessage
    frame: chassis
    child_frame: gimbal
    fields:
      transforms.0.transform.rotation.w: q.0
      transforms.0.transform.rotation.x: q.1
      transforms.0.transform.translation.z: {from: rate.y, scale: 2, offset: 1}
  - {message: imu, topic: mode, type: std_msgs/UInt8, fields: {data: {from: mode, values: {off: 3, track: 5}}}}
  - {message: imu, topic: word, type: std_msgs/String, fields: {data: mode}}
  - {message: imu, topic: bytes, type: std_msgs/UInt8MultiArray, fields: {data: serial}}
""",
        GIMBAL,
    )
    fields = {"q": [1.0, 0.5, 0.0, 0.0], "rate": {"x": 0.0, "y": 0.25}, "mode": "track", "serial": b"\1\2\3"}
    tf, mode, word, serial = (decode(o.type, encode(o.type, o.fill(fields, STAMP))) for o in mapping.publish)
    (transform,) = tf["transforms"]
    assert transform["header"] == {"stamp": STAMP, "frame_id": "chassis"}
    assert transform["child_frame_id"] == "gimbal"
    assert transform["transform"]["rotation"] == {"x": 0.5, "y": 0.0, "z": 0.0, "w": 1.0}
    assert transform["transform"]["translation"]["z"] == 1.5
    assert (mode["data"], word["data"], bytes(serial["data"])) == (5, "track", b"\1\2\3")


def test_message_is_read_from_a_topic() -> None:
    (aim,) = read(
        "subscribe: [{topic: a, type: geometry_msgs/Vector3, message: aim, fields: {yaw: z, mode: {text: on}}}]", GIMBAL
    ).subscribe
    assert {name: getter({"x": 1.0, "y": 2.0, "z": 3.0}) for name, getter in aim.values} == {"yaw": 3.0, "mode": "on"}


PUBLISH = "publish: [{{message: {}, topic: t, type: {}, fields: {{{}}}}}]"
SUBSCRIBE = "subscribe: [{{topic: t, type: {}, message: {}, fields: {{{}}}}}]"


@pytest.mark.parametrize(
    ("text", "place", "sentence"),
    [
        ("nodes: rover", (2, 1), "`nodes` is not a key of a mapping file; did you mean `node`?"),
        ("namespace: robot", (2, 12), "`robot` is not a namespace; write `/`, or names such as `/robot1`"),
        (PUBLISH.format("statsu", "std_msgs/Bool", "data: true"), (2, 21), "diffdrive has no message `statsu`; did you mean `status`?"),
        (PUBLISH.format("velocity", "std_msgs/Bool", "data: true"), (2, 21), "velocity is not sent by the mcu"),
        (PUBLISH.format("status", "std_msgs/Boole", "data: true"), (2, 45), "there is no message type `std_msgs/Boole` in ROS 2; did you mean std_msgs/Bool?"),
        (PUBLISH.format("status", "std_msgs/Bool", "date: true"), (2, 69), "std_msgs/Bool has no field `date`; did you mean `data`?"),
        (PUBLISH.format("status", "std_msgs/Bool", "data: state.stop"), (2, 75), "status.state has no flag `stop`"),
        (PUBLISH.format("status", "std_msgs/Bool", "data: batery"), (2, 75), "status has no field `batery`; did you mean `battery`?"),
        (PUBLISH.format("status", "std_msgs/Bool", "data: battery"), (2, 75), "battery is a number, and data takes true or false; map another field"),
        (PUBLISH.format("status", "std_msgs/Int8", "data: 200"), (2, 75), "200 is out of the range of data; write -128 to 127"),
        (PUBLISH.format("odometry", "std_msgs/Int8", "data: left_ticks"), (2, 77), "left_ticks is an integer, and data takes an integer from -128 to 127"),
        (PUBLISH.format("status", "std_msgs/String", "data: 4"), (2, 77), "4 is not possible for data; write a text"),
        (PUBLISH.format("status", "geometry_msgs/Twist", "linear: battery"), (2, 75), "linear is geometry_msgs/Vector3; map its fields: x, y, z"),
        (PUBLISH.format("status", "geometry_msgs/Twist", "linear.x.y: battery"), (2, 75), "x of geometry_msgs/Vector3 is float64, and has no `y`"),
        (PUBLISH.format("status", "std_msgs/UInt8", "data: {from: state.estop, values: {true: ON, false: 0}}"), (2, 76), "there is no constant `ON` for data; its type has none: write a number"),
        (PUBLISH.format("status", "std_msgs/UInt8", "data: {from: state.estop, values: {true: 1}}"), (2, 76), "`values` says nothing of false; write a value for each"),
        (SUBSCRIBE.format("geometry_msgs/Twist", "velocity", "linear: linear.w"), (2, 87), "geometry_msgs/Vector3 has no field `w`"),
        (SUBSCRIBE.format("geometry_msgs/Twist", "velocity", "up: linear.x"), (2, 79), "velocity has no field `up`"),
        (SUBSCRIBE.format("std_msgs/String", "velocity", "linear: data"), (2, 83), "data is a text, and linear takes a number"),
        (SUBSCRIBE.format("std_msgs/Float32", "parameter", "value: data"), (2, 76), "parameter needs name, without a default; map it here"),
        ("poll: [velocity]", (2, 8), "velocity is not a request with an `every`"),
        ("navigation: {deadline: stop}", (2, 24), "the host has no deadline `stop`"),
        ("diagnostics: [{message: status, field: battery}]", (2, 40), "battery is a number; expected a field with `flags`"),
        ("diagnostics: [{message: status, field: errors, words: {motor: hot}}]", (2, 56), "errors has no flag `motor`"),
        ("odometry: {message: odometry, left: left, right: right_ticks, wheel_radius: 1, wheel_separation: 1, ticks_per_turn: 1}", (2, 37), "odometry has no field `left`; possible: left_ticks, right_ticks"),
        ("odometry: {message: odometry, left: left_ticks, right: right_ticks, wheel_radius: 0, wheel_separation: 1, ticks_per_turn: 1}", (2, 83), "`0` is not more than 0; write the size of the real robot"),
    ],
)  # fmt: skip
def test_mistake_has_its_sentence_at_its_place(text: str, place: tuple[int, int], sentence: str) -> None:
    with pytest.raises(ProtocolFileError) as raised:
        read(text)
    (problem,) = raised.value.problems
    assert problem.sentence.startswith(sentence)
    assert (problem.line, problem.column) == place


def test_all_mistakes_are_said_at_once(tmp_path: Path) -> None:
    file = tmp_path / "wrong.yaml"
    file.write_text("wirebond_ros2: 1\npoll: [a, b]\nnavigation: {deadline: c}\n")
    with pytest.raises(ProtocolFileError) as raised:
        load_mapping(file, ROVER)
    assert [(p.path, p.line) for p in raised.value.problems] == [(str(file), 2), (str(file), 2), (str(file), 3)]
