"""The engine makes a topic's bytes: the same as the mapping's filler and `encode`, or none where these raise."""

from __future__ import annotations

import json
import random
import struct
from collections.abc import Iterator, Sequence
from typing import Any

import pytest

from tests.shared import codec as shipped
from tests.streams import random_values
from tests.test_random_formats import drawn_format
from wirebond import Codec, Message, MessageError, _engine
from wirebond.protocol import loads
from wirebond.protocol.model import End, Field, FieldKind
from wirebond.ros2.cdr import encode
from wirebond.ros2.mapping import read_mapping
from wirebond.ros2.mapping.model import Outgoing
from wirebond.ros2.mapping.paths import PathError, What, misfit, ros_place, wire_leaf
from wirebond.ros2.types import Kind, RosType, ros_type

# Every kind of number, and none of its bits is checked.
EVERYTHING = Codec(
    loads(
        """
wirebond: 1
protocol: everything
frame: [{magic: 0x55}, {id: u8}, {payload: by_id}]
types: {pair: {x: {type: f64}, y: {type: u16}, z: {type: s16}}}
messages:
  all:
    id: 1
    sender: mcu
    fields:
      small: {type: f32}
      large: {type: f64}
      byte: {type: u8}
      less: {type: i8}
      wide: {type: u64be}
      deep: {type: i64}
      odd: {type: i24}
      volts: {type: u16, scale: 0.001, unit: V}
      turned: {type: f32, scale: -0.5, offset: 3}
      mode: {type: u8, enum: {off: 0, on: 1, track: 7}}
      side: {type: i8, enum: {left: -1, right: 1}}
      state: {type: u16, flags: {stop: 0, hot: 3, top: 15}}
      is_on: {type: bool}
      pair: {struct: pair}
      pairs: {group: {count: 3, fields: pair}}
      q: {type: f32, count: 4}
      twelve: {type: u12, count: 5, packed: low_first}
      shared: {bits: {type: u16, fields: {number: {type: u5}, sign: {type: bool}, rest: {type: i10}}}}
"""
    )
)
TYPES = [
    "geometry_msgs/TwistStamped", "geometry_msgs/Quaternion", "nav_msgs/Odometry", "sensor_msgs/Imu",
    "sensor_msgs/BatteryState", "sensor_msgs/NavSatFix", "tf2_msgs/TFMessage", "sensor_msgs/JointState",
    *(f"std_msgs/{name}" for name in ("Bool", "Byte", "Char", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32")),
    *(f"std_msgs/{name}" for name in ("Int64", "UInt64", "Float32", "Float64", "Float64MultiArray", "String")),
]  # fmt: skip
STAMPS_NS = (0, 1, 1_700_000_000_123_456_789, (2**31 - 1) * 10**9 + 999_999_999, -1, 2**31 * 10**9)


def wire_paths(fields: Sequence[Field], before: str = "") -> Iterator[str]:
    """Every path of a message that leads to one value, or might."""
    for field in fields:
        if not field.has_value:
            continue
        many = field.count is not None or field.is_list
        for path in [f"{before}{field.name}{f'.{i}' if many else ''}" for i in range(field.count or 1)]:
            if field.kind in (FieldKind.STRUCT, FieldKind.BITS):
                yield from wire_paths(field.fields, f"{path}.")
                continue
            yield path
            yield from (f"{path}.{flag}" for flag, _ in field.flags)


def ros_paths(type_: RosType, before: str = "") -> Iterator[str]:
    """Every path of a topic that leads to one value, in the first elements of lists."""
    for field in type_.fields:
        indexes = [""] if field.kind == Kind.ONE else [f".{i}" for i in range(min(field.count or 2, 3))]
        for path in [f"{before}{field.name}{index}" for index in indexes]:
            if field.of is None:
                yield path
            else:
                yield from ros_paths(field.of, f"{path}.")


def drawn_mappings(codec: Codec, draw: random.Random) -> list[Outgoing]:
    """Topics of any type that take any fields of the MCU's messages, where these fit."""
    topics = []
    for message in codec.model.messages:
        given = list(wire_paths(message.fields)) if message.sent_by(End.MCU) else []
        for name in draw.sample(TYPES, 6) if given else ():
            type_ = ros_type(name)
            assert type_ is not None
            fields: dict[str, Any] = {}
            for target in draw.sample(places := list(ros_paths(type_)), min(len(places), 8)):
                source = drawn_source(message, type_, target, given, draw)
                if source is not None:
                    fields[target] = source
            topic = {"message": message.name, "topic": "t", "type": name, "fields": fields}
            topics.append(topic | ({"frame": "base"} if any("header" in target for target in fields) else {}))
    text = json.dumps({"wirebond_ros2": 1, "publish": topics})
    return list(read_mapping(text, codec.model).publish)


def drawn_source(message: Any, type_: RosType, target: str, given: list[str], draw: random.Random) -> Any:
    place = ros_place(type_, target)
    for path in draw.sample(given, min(len(given), 6)):
        try:
            leaf, _ = wire_leaf(message, path)
        except PathError:
            continue
        words = ("true", "false") if leaf.what == What.BOOL else leaf.choices if leaf.what == What.NAME else ()
        if words and place.leaf.what in (What.NUMBER, What.INTEGER) and not leaf.is_list and draw.random() < 0.7:
            return {"from": path, "values": {word: draw.randrange(3) for word in words}}
        if place.leaf.what == What.NUMBER and leaf.what in (What.NUMBER, What.INTEGER) and draw.random() < 0.4:
            return {"from": path, "scale": draw.choice((2, -0.125, 0.3333333)), "offset": draw.choice((0, 1.1))}
        if not misfit(place.leaf, leaf):
            return path
    return None


def fills(topic: Outgoing, message: Message, stamp_ns: int) -> bytes | None:
    """Return the filler's bytes; None if it raises."""
    stamp = {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}
    try:
        return encode(topic.type, topic.fill(message.fields, stamp))
    except (ValueError, TypeError, ArithmeticError, LookupError, struct.error):
        return None


def compare(codec: Codec, messages: list[Message], draw: random.Random) -> int:
    """Return how many messages the engine packed."""
    packed = 0
    for topic in drawn_mappings(codec, draw):
        packer = None if topic.plan is None else _engine.CdrPacker.make(codec.tables.protocol, topic.plan)
        for message in messages if packer is not None else ():
            stamp_ns = draw.choice(STAMPS_NS)
            (found,) = packer.pack([message], [stamp_ns])
            if message.name != topic.message:
                assert found is None
                continue
            assert found == fills(topic, message, stamp_ns), (topic, dict(message))
            packed += 1
    return packed


def test_any_bits_of_any_number() -> None:
    draw = random.Random("bits")
    size = EVERYTHING.model.message("all").min_payload
    special = struct.pack("<f", float("nan")), struct.pack("<f", float("inf")), bytes(4), b"\xff\xff\xff\x7f"
    frames = []
    for number in range(40):
        payload = bytearray(draw.randbytes(size))
        if number % 4:
            payload[0:4] = draw.choice(special)
            payload[4:12] = struct.pack("<d", draw.choice((float("nan"), float("-inf"), 1e300, -0.0)))
        frames.append(b"\x55\x01" + payload)
    messages = EVERYTHING.decoder("mcu").feed(b"".join(frames))
    assert len(messages) == len(frames)
    assert sum(compare(EVERYTHING, messages, draw) for _ in range(25)) > 1500


def test_random_formats() -> None:
    draw, packed = random.Random("formats"), 0
    for seed in range(8):
        codec = drawn_format(seed).codec
        decoder, messages = codec.decoder("mcu"), []
        for message in codec.model.messages:
            if message.sent_by(End.MCU):
                for _ in range(3):
                    try:
                        sender = "mcu" if message.sent_by(End.HOST) else None
                        frame = codec.encode(message.name, random_values(message, draw), sender=sender)
                    except MessageError:  # no form of the frame carries it
                        continue
                    messages += decoder.feed(frame)
        packed += compare(codec, messages + decoder.finish(), draw)
    assert packed > 30


def test_message_of_another_protocol_is_not_packed() -> None:
    (topic,) = read_mapping(
        json.dumps({"wirebond_ros2": 1, "publish": [
            {"message": "all", "topic": "t", "type": "std_msgs/UInt8", "fields": {"data": "byte"}}
        ]}), EVERYTHING.model
    ).publish  # fmt: skip
    packer = _engine.CdrPacker.make(EVERYTHING.tables.protocol, topic.plan)
    assert packer is not None
    rover = shipped("diffdrive")
    (status,) = rover.decoder("mcu").feed(rover.encode("status", battery=12.0, errors=[], state=[]))
    assert packer.pack([status], [0]) == [None]


@pytest.mark.parametrize(
    ("type_name", "field", "source"),
    [("std_msgs/String", "data", "mode"), ("std_msgs/Float32MultiArray", "data", "q")],
)
def test_texts_and_lists_are_for_the_filler(type_name: str, field: str, source: str) -> None:
    topic = {"message": "all", "topic": "t", "type": type_name, "fields": {field: source}}
    (found,) = read_mapping(json.dumps({"wirebond_ros2": 1, "publish": [topic]}), EVERYTHING.model).publish
    assert found.plan is None
