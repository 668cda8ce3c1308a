"""Messages as the types that are generated for them: every value arrives, in both directions, in the bytes of ROS."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest

from tests.ros2.fake_node import FakeNode
from tests.ros2.test_bridge import Bench
from tests.ros2.test_mapping import ROVER, STAMP, read
from tests.shared import PROTOCOLS, ROOT, loaded
from tests.streams import random_values
from wirebond import Codec, MessageError, _engine
from wirebond.codec import Message
from wirebond.errors import ProtocolFileError
from wirebond.generate.code.ros2_types import interfaces
from wirebond.protocol import loads
from wirebond.protocol.model import End
from wirebond.ros2.cdr import decode, encode
from wirebond.ros2.mapping.model import HEADER_KEY
from wirebond.ros2.mapping.own_types import OwnTypes
from wirebond.ros2.types import ros_type

FILES = [*sorted(PROTOCOLS.glob("*.yaml")), *sorted((ROOT / "tests" / "generate" / "code").glob("every_*.yaml"))]
FLOAT32 = 1e-6  # relative


def received(codec: Codec, name: str, values: dict[str, Any]) -> Message | None:
    """Return the message at the other end; None: only a request could identify these bytes."""
    sender = "mcu" if codec.model.message(name).sent_by(End.MCU) else "host"
    decoder = codec.decoder(sender=sender)
    try:
        frame = codec.encode(name, values)
    except MessageError:
        return None  # no frame has all these values
    found = [*decoder.feed(frame, t=0.0), *decoder.finish()]
    return next((message for message in found if message.name == name), None)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_every_value_arrives_in_both_directions(path: Path) -> None:
    codec, source = loaded(path), random.Random(path.stem)
    own, compared = OwnTypes(codec.model), 0
    for model in codec.model.messages:
        tree, type_ = own.tree(model.name), own.of(model.name)
        fill, plan = tree.filler(), tree.plan(model.name)
        packer = None if plan is None else _engine.CdrPacker.make(codec.tables.protocol, plan)
        for _ in range(5):
            message = received(codec, model.name, random_values(model, source))
            if message is None or received(codec, model.name, message.fields) is None:
                continue  # a step of the wire lies beyond the range
            data = encode(type_, fill({**message.fields, HEADER_KEY: message.header}, STAMP))
            assert packer is None or packer.pack([message], [7_000_000_009])[0] in (data, None)
            theirs = type_.store.deserialize_cdr(data, type_.name)
            assert bytes(type_.store.serialize_cdr(theirs, type_.name)) == data
            values = decode(type_, data)
            back = {name: getter(values) for name, getter in own.getters(model.name)}
            again = received(codec, model.name, back)
            assert again is not None
            assert again.fields == message.fields
            compared += 1
    assert compared


def test_bytes_are_those_of_rosbags_and_the_hash_is_that_of_ros() -> None:
    own, codec = OwnTypes(ROVER), loaded(PROTOCOLS / "diffdrive.yaml")
    message = received(codec, "status", {"battery": 12.5, "errors": ["encoder", 0x80], "state": ["charging"]})
    assert message is not None
    plan = own.tree("status").plan("status")
    packer = _engine.CdrPacker.make(codec.tables.protocol, plan)
    assert packer is not None  # the engine makes them
    (data,) = packer.pack([message], [7_000_000_009])
    golden = "00010000 07000000 09000000 01000000 00000000 0000000000002940 90 02".replace(" ", "")
    assert data.hex() == golden
    store = own.of("status").store
    kind = store.types["diffdrive_msgs/msg/Status"]
    header = store.types["std_msgs/msg/Header"](store.types["builtin_interfaces/msg/Time"](7, 9), "")
    assert bytes(store.serialize_cdr(kind(header, 12.5, 0x90, 2), "diffdrive_msgs/msg/Status")) == data
    assert own.of("status").hash == "RIHS01_7839062b3029dc9145b47bd436a5f9779a1c1e772e46656ad31ec9468fbf7401"
    assert own.of("status").dds_name == "diffdrive_msgs::msg::dds_::Status_"
    header_type = own.of("status").field("header")
    assert header_type is not None
    assert header_type.of is ros_type("std_msgs/Header")  # the types of ROS themselves are shared


MODES = """
wirebond: 1
protocol: modes
frame: [magic: 0xAA, length: u8, id: u8, payload: by_length, check: crc-16/mcrf4xx]
messages: {state: {id: 1, sender: both, fields: {mode: {type: i8, enum: {off: 0, on: -1}}}}}
"""


def test_numbers_without_a_name_come_as_numbers() -> None:
    codec, newer = Codec(loads(MODES)), Codec(loads(MODES.replace("on: -1", "on: -1, fast: 7")))
    tree = OwnTypes(codec.model).tree("state")
    packer = _engine.CdrPacker.make(codec.tables.protocol, tree.plan("state"))
    assert packer is not None
    for given, number in (("on", -1), ("off", 0), ("fast", 7)):
        (message,) = codec.decoder(sender="mcu").feed(newer.encode("state", mode=given), t=0.0)
        filled = tree.filler()({**message.fields, HEADER_KEY: {}}, STAMP)
        assert filled["mode"] == number
        wanted = encode(tree.type, filled) if given != "fast" else None
        assert packer.pack([message], [7_000_000_009]) == [wanted]


def test_a_frames_own_fields_come_along() -> None:
    codec = loaded(PROTOCOLS / "servo_bus.yaml")
    name = next(m.name for m in codec.model.messages if m.sent_by(End.MCU))
    tree = OwnTypes(codec.model).tree(name)
    frame = tree.type.field("frame_header")
    assert frame is not None
    assert frame.of is not None
    key = frame.of.fields[0].name
    assert tree.plan(name) is None
    definition = interfaces(codec.model).messages[name]
    assert [member.name for member in definition.members[:2]] == ["header", "frame_header"]
    fields = {f.name: 0 for f in codec.model.message(name).fields}
    assert tree.filler()({**fields, HEADER_KEY: {key: 5}}, STAMP)["frame_header"][key] == 5


def test_topics_of_own_types_need_one_line_of_a_mapping() -> None:
    mapping = read("typed_topics: all")
    assert [(out.topic, out.type.short) for out in mapping.publish] == [
        ("~/status", "diffdrive_msgs/Status"),
        ("~/odometry", "diffdrive_msgs/Odometry"),
    ]
    assert [(one.topic, one.type.short) for one in mapping.subscribe] == [
        ("~/velocity/send", "diffdrive_msgs/Velocity"),
        ("~/status_query/send", "diffdrive_msgs/StatusQuery"),
        ("~/parameter/send", "diffdrive_msgs/Parameter"),
    ]
    assert not mapping.json_out
    assert not mapping.json_in
    assert all(out.plan is not None for out in mapping.publish)


def test_typed_topics_are_for_messages_that_no_section_maps() -> None:
    text = (PROTOCOLS / "ros2" / "diffdrive.yaml").read_text().partition("wirebond_ros2: 1")[2]
    mapping = read(f"typed_topics: unmapped\n{text}")
    assert {one.topic for one in mapping.subscribe} == {"cmd_vel", "~/status_query/send", "~/parameter/send"}
    assert {out.topic for out in mapping.publish} == {"battery_state", "estop"}


def test_a_topic_may_have_its_messages_own_type() -> None:
    mapping = read("""
publish:
  - {message: status, topic: state, type: diffdrive_msgs/msg/Status}
  - message: odometry
    topic: ticks
    type: diffdrive_msgs/Odometry
    frame: base_link
    fields: {left_ticks: left_ticks}
subscribe:
  - {topic: drive, type: diffdrive_msgs/Velocity, message: velocity, stale: 500 ms}
""")
    fields = {"battery": 12.0, "errors": ["encoder"], "state": [], "left_ticks": 3, "right_ticks": 4, HEADER_KEY: {}}
    state, ticks = (out.fill(fields, STAMP) for out in mapping.publish)
    assert (state["errors"], state["header"]["stamp"]) == (16, STAMP)
    assert (ticks["left_ticks"], ticks["header"]["frame_id"], "right_ticks" in ticks) == (3, "base_link", False)
    (drive,) = mapping.subscribe
    assert {name: getter({"linear": 0.5, "angular": 0.0}) for name, getter in drive.values} == {
        "linear": 0.5,
        "angular": 0.0,
    }


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            "publish: [{message: status, topic: x, type: diffdrive_msgs/Statuss}]",
            "there is no message type `diffdrive_msgs/Statuss` in ROS 2; did you mean diffdrive_msgs/Status?",
        ),
        (
            "publish: [{message: status, topic: x, type: diffdrive_msgs/Odometry}]",
            "an entry of `publish` needs `fields`, which say where each value of diffdrive_msgs/Odometry comes from; "
            "only diffdrive_msgs/Status, the type of status itself, needs none",
        ),
        (
            "subscribe: [{message: velocity, topic: x, type: geometry_msgs/Twist}]",
            "an entry of `subscribe` needs `fields`, which say where each value of geometry_msgs/Twist comes from; "
            "only diffdrive_msgs/Velocity, the type of velocity itself, needs none",
        ),
        ("typed_topics: some", "`some` is not possible here; possible: unmapped, all, none"),
    ],
)
def test_a_mistake_has_a_sentence(text: str, sentence: str) -> None:
    with pytest.raises(ProtocolFileError) as caught:
        read(text)
    assert sentence in str(caught.value)


@pytest.mark.live
def test_bridge_publishes_and_sends_own_types() -> None:
    bench = Bench(read("typed_topics: all"))
    try:
        bench.mcu_sends("status", battery=12.25, errors=["encoder"], state=[])
        node: FakeNode = bench.node
        (status,) = node.wait(lambda: node.published["/diffdrive/status"])
        assert (status["battery"], status["errors"], status["state"]) == (12.25, 16, 0)
        assert node.types["/diffdrive/status"] == "diffdrive_msgs/Status"
        node.take["/diffdrive/parameter/send"]({"name": 1, "reserved": 0, "value": 0.5})
        assert bench.mcu_hears("parameter") == {"name": "max_linear", "reserved": 0, "value": 0.5}
    finally:
        bench.close()
