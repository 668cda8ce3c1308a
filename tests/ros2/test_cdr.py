"""Messages of ROS 2 as bytes: the same bytes as rosbags writes, and nothing from the network is believed."""

from __future__ import annotations

import random
import struct
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from wirebond.ros2.cdr import decode, encode, places_of
from wirebond.ros2.types import Kind, RosField, RosType, ros_type, type_names

STORE = get_typestore(Stores.ROS2_JAZZY)
# One of each shape: nested, strings, sequences of messages, fixed arrays, every width.
NAMES = [
    "diagnostic_msgs/DiagnosticArray", "geometry_msgs/Twist", "nav_msgs/Odometry", "rcl_interfaces/Log",
    "rmw_dds_common/ParticipantEntitiesInfo", "sensor_msgs/BatteryState", "sensor_msgs/Imu", "sensor_msgs/JointState",
    "sensor_msgs/NavSatFix", "std_msgs/Bool", "std_msgs/Empty", "std_msgs/Int64MultiArray", "std_msgs/String",
    "std_msgs/UInt8MultiArray", "tf2_msgs/TFMessage", "trajectory_msgs/JointTrajectory",
]  # fmt: skip


def known(name: str) -> RosType:
    found = ros_type(name)
    assert found is not None
    return found


def drawn(type_: RosType, draw: random.Random) -> dict[str, Any]:
    """Any message of this type."""
    return {field.name: drawn_field(field, draw) for field in type_.fields}


def drawn_field(field: RosField, draw: random.Random) -> Any:
    if field.kind == Kind.ONE:
        return drawn_one(field, draw)
    return [drawn_one(field, draw) for _ in range(field.count or draw.randrange(4))]


def drawn_one(field: RosField, draw: random.Random) -> Any:
    if field.of is not None:
        return drawn(field.of, draw)
    if field.base == "string":
        return "".join(draw.choice("aß漢 /") for _ in range(draw.randrange(9)))
    if field.base == "bool":
        return draw.random() < 0.5
    if field.base.startswith("float"):
        return struct.unpack("f", struct.pack("f", draw.uniform(-1e6, 1e6)))[0]
    return draw.randrange(128)


def as_object(type_: RosType, values: dict[str, Any]) -> Any:
    """The message as rosbags has it."""
    return STORE.types[type_.name](*(object_field(f, values[f.name]) for f in type_.fields))


def object_field(field: RosField, value: Any) -> Any:
    if field.of is not None:
        return as_object(field.of, value) if field.kind == Kind.ONE else [as_object(field.of, one) for one in value]
    if field.kind == Kind.ONE or field.base == "string":
        return value
    return np.array(value, dtype={"byte": "uint8", "char": "uint8"}.get(field.base, field.base))


def plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: plain(one) for key, one in value.items()}
    return [plain(one) for one in value] if isinstance(value, list | tuple) else value


@pytest.mark.parametrize("name", NAMES)
def test_bytes_are_those_of_rosbags_and_come_back(name: str) -> None:
    type_, draw = known(name), random.Random(name)
    for _ in range(5):
        values = drawn(type_, draw)
        data = encode(type_, values)
        assert data == bytes(STORE.serialize_cdr(as_object(type_, values), type_.name))
        assert plain(decode(type_, data)) == values


def test_big_endian_messages_are_read() -> None:
    type_, values = known("sensor_msgs/Imu"), drawn(known("sensor_msgs/Imu"), random.Random(1))
    data = bytes(STORE.serialize_cdr(as_object(type_, values), type_.name, little_endian=False))
    assert plain(decode(type_, data)) == values


def test_missing_members_have_the_default_of_ros() -> None:
    pose = decode(known("geometry_msgs/Pose"), encode(known("geometry_msgs/Pose"), {"position": {"y": 2.0}}))
    assert pose["position"] == {"x": 0.0, "y": 2.0, "z": 0.0}
    assert pose["orientation"] == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}


@pytest.mark.parametrize("name", NAMES)
def test_damaged_bytes_are_refused_or_read_and_never_more(name: str) -> None:
    type_, draw = known(name), random.Random(name)
    for _ in range(20):
        data = bytearray(encode(type_, drawn(type_, draw)))
        for _ in range(3):
            data[draw.randrange(len(data))] = draw.choice((0, 0x7F, 0xFF))
        with suppress(ValueError):
            decode(type_, bytes(data[: draw.randrange(len(data) + 1)]))


@pytest.mark.parametrize("name", NAMES)
def test_numbers_lie_where_they_are_said_to_lie(name: str) -> None:
    type_, draw = known(name), random.Random(name)
    values = drawn(type_, draw)
    data, places = bytearray(encode(type_, values)), places_of(type_, values)
    assert places.keys() == set(numbers(type_, values, ()))
    for steps, (at, code) in places.items():
        put(values, steps, value := draw.randrange(2))
        struct.pack_into(f"<{code}", data, at, value)
    assert data == encode(type_, values)


def numbers(type_: RosType, values: dict[str, Any], path: tuple[Any, ...]) -> list[tuple[Any, ...]]:
    """Return the numbers in the message, each by its path."""
    found = []
    for field in type_.fields:
        value, steps = values[field.name], (*path, field.name)
        ones = [(steps, value)] if field.kind == Kind.ONE else [((*steps, i), one) for i, one in enumerate(value)]
        for place, one in ones:
            if field.of is not None:
                found += numbers(field.of, one, place)
            elif field.base != "string":
                found.append(place)
    return found


def put(values: Any, steps: tuple[Any, ...], value: Any) -> None:
    for step in steps[:-1]:
        values = values[step]
    values[steps[-1]] = value


def test_array_of_another_size_is_refused() -> None:
    with pytest.raises(ValueError, match="covariance has 3 values; expected 36"):
        encode(known("geometry_msgs/PoseWithCovariance"), {"covariance": [1, 2, 3]})


def test_every_message_type_of_ros_is_known() -> None:
    assert len(type_names()) > 100
    assert known("geometry_msgs/msg/Twist") is known("geometry_msgs/Twist")
    assert ros_type("geometry_msgs/Twits") is None
    # As `ros2 topic info --verbose` prints it on Jazzy.
    assert known("geometry_msgs/Twist").hash.startswith("RIHS01_9c45bf16fe0983d8")
