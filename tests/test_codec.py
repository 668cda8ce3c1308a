"""Encoding values, the sentences for wrong ones, and reading values back."""

from __future__ import annotations

import gc
import math
import random
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wirebond
from tests.streams import random_values
from wirebond import MessageError, UsageError
from wirebond.protocol import loads
from wirebond.protocol.model import End

PROTOCOLS = Path(__file__).resolve().parents[1] / "protocols"
DIFFDRIVE = wirebond.load(PROTOCOLS / "diffdrive.yaml")
ENTERPRIZE = wirebond.load(PROTOCOLS / "enterprize.yaml")
NATIVE = wirebond.load(PROTOCOLS / "native.yaml")
PID = wirebond.load(PROTOCOLS / "pid_tuner.yaml")


@pytest.mark.parametrize(
    ("message", "fields", "sentence"),
    [
        ("velocty", {}, "diffdrive has no message 'velocty'; did you mean velocity? it has velocity, status_query"),
        ("odometry", {"left_ticks": 0}, "odometry needs right_ticks, which has no default"),
        ("velocity", {"linear": 0, "angular": 0, "up": 1}, "velocity has no field 'up'; it has linear, angular"),
        ("velocity", {"linear": 2.5, "angular": 0}, "velocity.linear = 2.5 m/s is outside -2 ... 2 m/s"),
        ("velocity", {"linear": math.nan, "angular": 0}, "velocity.linear is nan, not a finite number"),
        ("velocity", {"linear": -math.inf, "angular": 0}, "velocity.linear is -inf, not a finite number"),
        ("velocity", {"linear": "fast", "angular": 0}, "velocity.linear is 'fast' (str); expected a number"),
        ("velocity", {"linear": None, "angular": 0}, "velocity.linear is None (NoneType); expected a number"),
        ("velocity", {"linear": 10**400, "angular": 0}, "velocity.linear is too large for a 64-bit number"),
        ("odometry", {"left_ticks": 40000, "right_ticks": 0}, "holds -32768 ... 32767"),
        ("odometry", {"left_ticks": 1.5, "right_ticks": 0}, "odometry.left_ticks is 1.5 (float); expected an integer"),
        ("odometry", {"left_ticks": 10**30, "right_ticks": 0}, "does not fit its 16-bit wire type"),
        ("status", {"battery": 70.0, "errors": [], "state": []}, "holds 0 ... 65.535 V"),
        ("status", {"battery": -0.001, "errors": [], "state": []}, "holds 0 ... 65.535 V"),
        ("status", {"battery": 1, "errors": ["fire"], "state": []}, "errors has no flag 'fire'; it has left_motor"),
        ("status", {"battery": 1, "errors": "encoder", "state": []}, "expected a list of flag names"),
        ("status", {"battery": 1, "errors": 256, "state": []}, "holds 0 ... 255"),
        ("parameter", {"name": "mass", "value": 1}, "parameter.name is 'mass'; expected one of clear_safe_mode"),
        ("parameter", {"name": 9, "value": 1}, "parameter.name is 9; expected one of"),
    ],
)  # fmt: skip
def test_wrong_value_is_refused_with_a_sentence(message: str, fields: dict[str, object], sentence: str) -> None:
    with pytest.raises(MessageError) as caught:
        DIFFDRIVE.encode(message, fields)
    assert sentence in str(caught.value)


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"q": [1.0, 2.0]}, "gimbal_msg.q has 2 elements; expected 4"),
        ({"q": 1.0}, "expected a list of 4"),
        ({"q": "abcd"}, "expected a list of 4"),
        ({"q": [1, 2, 3, math.nan]}, "gimbal_msg.q is nan, not a finite number"),
        ({"q": None}, "gimbal_msg.q is None (NoneType); expected a list of 4"),
        ({"bullet_speed": 1e39}, "does not fit a 32-bit float"),
    ],
)
def test_wrong_array_or_float_is_refused(fields: dict[str, object], sentence: str) -> None:
    good = {"cur_cv_mode": 0, "target_color": 0, "bullet_speed": 0.0, "q": [0.0] * 4}
    with pytest.raises(MessageError) as caught:
        ENTERPRIZE.encode("gimbal_msg", good | fields)
    assert sentence in str(caught.value)


REPEATED = """
wirebond: 1
protocol: repeated
frame: [magic: 0xA5, length: u8, id: u8, payload: by_length, check: crc-16/modbus]
messages:
  m:
    id: 1
    sender: host
    fields:
      n:      {type: u8}
      counted: {group: {count: n, max: 5, fields: {x: {type: u8, default: 1}}}}
      twice:   {group: {count: 2, fields: {x: {type: u8, default: 1}}}}
      open:    {group: {count: to_end, max: 3, fields: {x: {type: u8, default: 1}}}}
"""


@pytest.mark.parametrize(("name", "wanted"), [("counted", "at most 5"), ("twice", "2"), ("open", "at most 3")])
def test_none_is_no_list_of_structs(name: str, wanted: str) -> None:
    """It was sent as one element, or as those of the default."""
    codec = wirebond.Codec(loads(REPEATED))
    lists: dict[str, object] = {"counted": [], "open": []}
    assert codec.encode("m", lists) == codec.encode("m", lists, twice=[{"x": 1}, {"x": 1}])
    with pytest.raises(MessageError, match=rf"m\.{name} is None \(NoneType\); expected a list of {wanted}"):
        codec.encode("m", {**lists, name: None})


LEFT_OUT = """
wirebond: 1
protocol: legs
frame: [magic: 0xA5, length: u8, id: u8, payload: by_length, check: crc-16/modbus]
messages:
  m:
    id: 1
    sender: host
    fields:
      joints: {group: {count: 2, fields: {at: {type: u8}, on: {type: u8, default: 1}}}}
      gains:  {type: u8, count: 2}
      n:      {type: u8}
      steps:  {type: u8, count: n, max: 4}
      legs:   {group: {count: n, max: 4, fields: {at: {type: u8, default: 7}}}}
      same:   {type: u8, count: 2, default: 3}
      few:    {type: u8, count: to_end, max: 4, default: []}
"""


@pytest.mark.parametrize("name", ["joints", "gains", "steps", "legs"])
def test_an_array_or_group_that_is_left_out_is_refused_unless_it_has_a_default(name: str) -> None:
    codec = wirebond.Codec(loads(LEFT_OUT))
    values = {"joints": [{"at": 1}, {"at": 2}], "gains": [0, 0], "steps": [], "legs": []}
    assert codec.encode("m", values) == codec.encode("m", values, same=[3, 3], few=[])
    del values[name]
    with pytest.raises(MessageError, match=f"^m needs {name}, which has no default$"):
        codec.encode("m", values)


def test_text_that_is_too_long_is_refused_with_its_size() -> None:
    with pytest.raises(MessageError, match="text has 49 bytes; it holds at most 48"):
        NATIVE.encode("log", level="info", text="x" * 49)


def test_text_travels_as_utf8_of_any_length() -> None:
    for text in ("", "a", "上位机", "x" * 48):
        (message,) = NATIVE.decoder("mcu").feed(NATIVE.encode("log", level="warning", text=text))
        assert message.fields == {"level": "warning", "text": text}


def test_field_that_is_left_out_takes_its_default() -> None:
    assert DIFFDRIVE.encode("velocity", linear=0.5) == DIFFDRIVE.encode("velocity", linear=0.5, angular=0.0)


def test_value_on_the_edge_of_its_range_is_accepted() -> None:
    for linear in (-2.0, 2.0):
        (message,) = DIFFDRIVE.decoder("host").feed(DIFFDRIVE.encode("velocity", linear=linear, angular=0))
        assert message.fields["linear"] == linear


def test_scaled_values_read_back_as_written_decimals() -> None:
    for wire in range(-2000, 2001):
        (message,) = DIFFDRIVE.decoder("host").feed(DIFFDRIVE.encode("velocity", linear=wire / 1000, angular=0))
        assert message.fields["linear"] == wire / 1000


def test_received_field_outside_its_rules_is_delivered_with_its_violation() -> None:
    frame = bytearray(PID.encode("motors", left=0.5, right=0.5))
    frame[3:5] = struct.pack("<h", 1500)
    frame[7] = sum(frame[1:7]) >> 8
    (message,) = PID.decoder("mcu").feed(frame)
    assert message.fields["left"] == 1.5
    assert message.violations == ["motors.left = 1.5 is outside -1 ... 1"]


COARSE = """
wirebond: 1
protocol: coarse
frame: [{magic: 0xAA}, {id: u8}, {payload: 1}, {check: xor8}]
messages:
  m: {id: 1, sender: mcu, fields: {x: {type: i8, scale: 0.3, range: [-1.7, 1.7]}}}
"""


def test_legal_bound_that_rounds_past_itself_is_no_violation() -> None:
    proto = wirebond.Codec(loads(COARSE))
    (message,) = proto.decoder("mcu").feed(proto.encode("m", x=1.7))
    assert message.fields["x"] == pytest.approx(1.8)
    assert message.violations == []
    frame = bytearray(proto.encode("m", x=1.7))
    frame[2], frame[3] = frame[2] + 1, frame[3] ^ frame[2] ^ (frame[2] + 1)
    (message,) = proto.decoder("mcu").feed(frame)
    assert message.violations == ["m.x = 2.1 is outside -1.7 ... 1.7"]


def test_halves_round_away_from_zero_as_in_generated_code() -> None:
    for value, wire in ((0.0005, 1), (0.0015, 2), (0.0025, 3), (-0.0005, -1)):
        frame = DIFFDRIVE.encode("velocity", linear=value, angular=0)
        assert struct.unpack("<h", frame[3:5]) == (wire,)


def test_received_nan_is_delivered_with_its_violation() -> None:
    values = {"idx": 0, "p": 1.0, "i": 2.0, "d": 3.0}
    frame = bytearray(PID.encode("pid", values))
    frame[4:8] = struct.pack("<f", math.nan)
    frame[-2] = sum(frame[1:-2]) >> 8 & 0xFF
    (message,) = PID.decoder("host").feed(frame)
    assert math.isnan(message.fields["p"])
    assert message.violations == ["pid.p is nan, not a finite number"]


def test_unknown_enumerator_and_unnamed_flag_are_delivered_as_numbers_with_violations() -> None:
    frame = bytearray(DIFFDRIVE.encode("status", battery=12.0, errors=["encoder"], state=0x40))
    (message,) = DIFFDRIVE.decoder("mcu").feed(frame)
    assert message.fields["state"] == [0x40]
    assert message.violations == ["status.state has unnamed bits set: 64"]
    again = DIFFDRIVE.encode("status", message.fields)
    assert again == bytes(frame)


def test_decoder_refuses_a_sender_that_is_none() -> None:
    with pytest.raises(UsageError, match="sender is 'robot'; expected 'mcu' or 'host'"):
        DIFFDRIVE.decoder("robot")


COLLIDING = """
wirebond: 1
protocol: both_ways
frame: [{magic: 0xAA}, {id: u8}, {payload: 1}, {check: xor8}]
messages:
  ask: {id: 1, sender: host, fields: {number: {type: u8}}}
  tell: {id: 1, sender: mcu, fields: {answer: {type: u8}}}
"""


def test_ids_that_mean_two_things_need_a_sender() -> None:
    proto = wirebond.Codec(loads(COLLIDING))
    frame = proto.encode("ask", number=3)
    with pytest.raises(UsageError, match="the id 0x01 means ask from host and tell from mcu"):
        proto.decoder()
    assert proto.decoder("host").feed(frame)[0].fields == {"number": 3}
    assert proto.decoder("mcu").feed(frame)[0].fields == {"answer": 3}


def test_columns_are_si_with_shapes_and_wire_types() -> None:
    stream = b"".join(
        ENTERPRIZE.encode("gimbal_msg", cur_cv_mode=i, target_color=1, bullet_speed=i / 2, q=[i, 0, 0, 1])
        for i in range(9)
    )
    table = ENTERPRIZE.decode_columns(stream, "mcu")["gimbal_msg"]
    assert table["q"].shape == (9, 4)
    assert table["q"].dtype == np.float32
    assert table["cur_cv_mode"].dtype == np.uint8
    assert table["bullet_speed"].tolist() == [i / 2 for i in range(9)]
    assert (table.rows, table.offset.tolist()) == (9, [29 * i for i in range(9)])
    scaled = DIFFDRIVE.decode_columns(DIFFDRIVE.encode("velocity", linear=0.009, angular=0) * 2)["velocity"]
    assert scaled["linear"].tolist() == [0.009, 0.009]
    assert scaled["linear"].dtype == np.float64


def test_columns_outlive_everything_that_made_them() -> None:
    proto = wirebond.load(PROTOCOLS / "diffdrive.yaml")
    column = proto.decode_columns(proto.encode("odometry", left_ticks=5, right_ticks=-5) * 1000)["odometry"][
        "right_ticks"
    ]
    del proto
    gc.collect()
    assert int(column.sum()) == -5000


def test_messages_outlive_their_decoder() -> None:
    proto = wirebond.load(PROTOCOLS / "diffdrive.yaml")
    messages = proto.decoder("mcu").feed(proto.encode("odometry", left_ticks=1, right_ticks=2) * 100)
    del proto
    gc.collect()
    assert [m.fields for m in messages] == [{"left_ticks": 1, "right_ticks": 2}] * 100


NUMBERS = """
wirebond: 1
protocol: numbers
frame: [{magic: 0xAA 0x55}, {length: u16be}, {id: u16}, {payload: by_length}, {check: crc-32/iso-hdlc}]
messages:
  all:
    id: 0x1234
    sender: mcu
    fields:
      a: {type: i8}
      b: {type: u16be}
      c: {type: i24}
      d: {type: u32be}
      e: {type: i64}
      f: {type: u64be}
      g: {type: f32be}
      h: {type: f64}
      k: {type: i24be, scale: 0.5, offset: 10, count: 2}
"""


@given(
    a=st.integers(-128, 127), b=st.integers(0, 2**16 - 1), c=st.integers(-(2**23), 2**23 - 1),
    d=st.integers(0, 2**32 - 1), e=st.integers(-(2**63), 2**63 - 1), f=st.integers(0, 2**64 - 1),
    g=st.floats(width=32, allow_nan=False, allow_infinity=False), h=st.floats(allow_nan=False, allow_infinity=False),
    k=st.lists(st.integers(-(2**23), 2**23 - 1), min_size=2, max_size=2),
)  # fmt: skip
def test_every_number_type_is_on_the_wire_as_struct_packs_it(**values: object) -> None:
    proto = wirebond.Codec(loads(NUMBERS))
    k = values.pop("k")
    assert isinstance(k, list)
    frame = proto.encode("all", values, k=[n * 0.5 + 10 for n in k])
    c = int(values["c"]).to_bytes(3, "little", signed=True)  # type: ignore[call-overload]
    payload = struct.pack("<b", values["a"]) + struct.pack(">H", values["b"]) + c
    payload += struct.pack(">I", values["d"]) + struct.pack("<q", values["e"]) + struct.pack(">Q", values["f"])
    payload += struct.pack(">f", values["g"]) + struct.pack("<d", values["h"])
    payload += b"".join(n.to_bytes(3, "big", signed=True) for n in k)
    assert frame[6:-4] == payload
    assert frame[2:4] == len(payload).to_bytes(2, "big")
    (message,) = proto.decoder("mcu").feed(frame)
    assert message.fields == values | {"k": [n * 0.5 + 10 for n in k]}


def test_random_values_survive_the_round_trip_through_every_message() -> None:
    source = random.Random(7)
    for message in DIFFDRIVE.model.messages:
        sender = "mcu" if message.sent_by(End.MCU) else "host"
        for _ in range(100):
            frame = DIFFDRIVE.encode(message.name, random_values(message, source))
            (found,) = DIFFDRIVE.decoder(sender).feed(frame)
            assert (found.name, found.violations) == (message.name, [])
            assert DIFFDRIVE.encode(found.name, found.fields) == frame
