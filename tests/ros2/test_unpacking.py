"""The engine makes a command's frame of a topic's bytes: as the getters, the ranges and `encode` do, or not at all."""

from __future__ import annotations

import json
import math
import random
from typing import Any

import pytest

from tests.ros2.test_cdr import STORE, as_object, drawn
from tests.ros2.test_commands import FakeLink
from tests.ros2.test_packing import ros_paths, wire_paths
from wirebond import Codec
from wirebond.errors import WirebondError
from wirebond.protocol import loads
from wirebond.ros2.cdr import decode, encode
from wirebond.ros2.commands import Commands, RefusedError
from wirebond.ros2.mapping import read_mapping
from wirebond.ros2.mapping.model import Incoming
from wirebond.ros2.mapping.paths import What, misfit, ros_place, wire_leaf
from wirebond.ros2.types import RosType, ros_type

HOST = Codec(
    loads(
        """
wirebond: 1
protocol: host
frame: [{magic: 0x55}, {id: u8}, {length: u8}, {payload: by_length}, {check: crc-16/arc}]
messages:
  all:
    id: 1
    sender: host
    fields:
      small: {type: f32, range: [-100, 100], default: 0}
      large: {type: f64, default: 0}
      byte: {type: u8, range: [0, 100], on_range: clamp, default: 0}
      less: {type: i8, default: 0}
      wide: {type: u64, default: 0}
      deep: {type: i64, default: 0}
      volts: {type: u16, scale: 0.001, unit: V, range: [0, 50], on_range: clamp, default: 0}
      turned: {type: f32, scale: -0.5, offset: 3, default: 0}
      mode: {type: u8, enum: {off: 0, on: 1, track: 7}, default: off}
      state: {type: u16, flags: {stop: 0, hot: 3}, default: 0}
      is_on: {type: bool, default: false}
      q: {type: f32, count: 4, default: [0, 0, 0, 0]}
      label: {type: text, max: 12, default: none}
"""
    )
)
TYPES = [
    "geometry_msgs/TwistStamped", "geometry_msgs/Vector3", "nav_msgs/Odometry", "sensor_msgs/Imu",
    "sensor_msgs/BatteryState", "tf2_msgs/TFMessage", "sensor_msgs/JointState", "std_msgs/Bool", "std_msgs/String",
    "diagnostic_msgs/DiagnosticArray", "trajectory_msgs/JointTrajectory",
    *(f"std_msgs/{name}" for name in ("Int8", "UInt8", "UInt64", "Int64", "Float32", "Int64MultiArray")),
]  # fmt: skip
SPECIAL = (math.nan, math.inf, -math.inf, 0.0, -0.0, 99.99, 100.0, 100.01, 3e38, 1e300)


def drawn_command(draw: random.Random) -> Incoming | None:
    name = draw.choice(TYPES)
    type_ = ros_type(name)
    assert type_ is not None
    (message,) = HOST.model.messages
    places = list(ros_paths(type_))
    fields: dict[str, Any] = {}
    for target in draw.sample(sorted({path.split(".")[0] for path in wire_paths(message.fields)}), 5):
        leaf, _ = wire_leaf(message, target)
        for path in draw.sample(places, min(len(places), 5)):
            given = ros_place(type_, path).leaf
            numbers = (What.NUMBER, What.INTEGER)
            if leaf.what == What.NUMBER and given.what in numbers and not leaf.is_list and draw.random() < 0.4:
                fields[target] = {"from": path, "scale": draw.choice((0.5, -3)), "offset": draw.choice((0, 0.1))}
                break
            if not misfit(leaf, given):
                fields[target] = path
                break
    if "small" not in fields:
        fields["small"] = draw.choice((1, 2.5))
    topic = {"topic": "t", "type": name, "message": "all", "fields": fields}
    (found,) = read_mapping(json.dumps({"wirebond_ros2": 1, "subscribe": [topic]}), HOST.model).subscribe
    return found


def with_special(values: Any, draw: random.Random) -> Any:
    """Some floats of a message become numbers that no command should be; integers become any."""
    if isinstance(values, dict):
        return {key: with_special(one, draw) for key, one in values.items()}
    if isinstance(values, list):
        return [with_special(one, draw) for one in values]
    if isinstance(values, float) and draw.random() < 0.7:
        return draw.choice(SPECIAL) if draw.random() < 0.5 else draw.uniform(-120, 120)
    return values


def drawn_data(type_: RosType, draw: random.Random) -> bytes:
    values = with_special(drawn(type_, draw), draw)
    try:
        data = encode(type_, values)
    except (OverflowError, ValueError):
        data = encode(type_, drawn(type_, draw))
    if draw.random() < 0.2:
        plain = drawn(type_, draw)
        data = bytes(STORE.serialize_cdr(as_object(type_, plain), type_.name, little_endian=False))
    if draw.random() < 0.2:
        damaged = bytearray(data)
        for _ in range(2):
            damaged[draw.randrange(len(damaged))] = draw.choice((0, 1, 0x7F, 0x80, 0xFF))
        data = bytes(damaged)
    return data[: draw.randrange(len(data) + 1)] if draw.random() < 0.2 else data


def by_the_reference(commands: Commands, incoming: Incoming, data: bytes) -> bytes | None:
    """The frame; None: something is clamped, refused or no message."""
    try:
        values = decode(incoming.type, data)
        fitting, clamped = commands._fitting("all", {name: getter(values) for name, getter in incoming.values})
        return None if clamped else HOST.encode("all", fitting)
    except (ValueError, LookupError, RefusedError, WirebondError, TypeError):
        return None


def has_large_integers(incoming: Incoming, data: bytes) -> bool:
    """Those are compared exactly in Python alone."""
    values = decode(incoming.type, data)
    taken = [getter(values) for _, getter in incoming.values]
    return any(isinstance(one, int) and abs(one) > 2**53 for one in taken)


class HostLink(FakeLink):
    def __init__(self) -> None:
        super().__init__()
        self.codec = HOST


def test_frames_are_those_of_the_reference_or_none() -> None:
    draw, commands = random.Random("unpack"), Commands(HostLink(), lambda _, __: None)  # type: ignore[arg-type]
    framed = compared = 0
    for _ in range(70):
        incoming = drawn_command(draw)
        framer = None if incoming is None or incoming.plan is None else commands.framer(incoming.plan)
        if incoming is None or framer is None:
            continue
        for _ in range(15):
            data = drawn_data(incoming.type, draw)
            found, wanted = next(iter(framer.frames([data])), None), by_the_reference(commands, incoming, data)
            compared += 1
            framed += found is not None
            if found is None and wanted is not None and has_large_integers(incoming, data):
                continue
            assert found == wanted, (incoming, data)
    assert compared > 900 and framed > compared / 6


@pytest.mark.parametrize("fields", [{"q": "axes"}, {"small": 1000}, {"byte": 101}], ids=str)
def test_lists_and_constants_out_of_range_are_for_the_reference(fields: dict[str, Any]) -> None:
    topic = {"topic": "t", "type": "sensor_msgs/Joy", "message": "all", "fields": fields}
    (incoming,) = read_mapping(json.dumps({"wirebond_ros2": 1, "subscribe": [topic]}), HOST.model).subscribe
    commands = Commands(HostLink(), lambda _, __: None)  # type: ignore[arg-type]
    assert incoming.plan is None or commands.framer(incoming.plan) is None
