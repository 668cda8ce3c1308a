"""Header values at the host: real bytes both ways, and the sentence for each value that cannot be."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.shared import ROOT
from wirebond import Codec, MessageError, load
from wirebond.analysis.explain import explain
from wirebond.generate.code import generate_python
from wirebond.generate.doc import markdown
from wirebond.protocol import loads
from wirebond.protocol.model import End
from wirebond.sim.virtual_mcu import VirtualMcu

BUS = """\
wirebond: 1
protocol: bus
frame:
  - magic: 0xFF 0xFF
  - {field: servo, type: u8, default: 1}
  - {field: temperature, type: i16be, scale: 0.1, unit: K, range: [-40, 200]}
  - {field: state, type: u8, flags: {voltage: 0, angle: 1}}
  - {field: system, type: u8, default: {host: 255, mcu: 2}}
  - bits: u8
    fields: {kind: {bits: 3, enum: {ping: 1, read: 2}, default: ping}, hops: i5}
  - length: u8
  - id: u8
  - payload: by_length
  - {field: stamp, type: u64}
  - check: sum8
messages:
  move: {id: 1, sender: host, fields: {x: {type: u8}}}
  at: {id: 2, sender: mcu}
"""


@pytest.fixture(scope="module")
def codec() -> Codec:
    return Codec(loads(BUS))


def header_of(codec: Codec, frame: bytes, sender: str) -> dict[str, Any]:
    decoder = codec.decoder(sender)
    (message,) = decoder.feed(frame) + decoder.finish()
    return message.header


def test_each_end_sends_its_defaults(codec: Codec) -> None:
    frame = codec.encode("move", x=3)
    assert frame == bytes.fromhex("FFFF 01 0000 00 FF 01 01 01 03 0000000000000000 04")
    assert header_of(codec, frame, "host") == {
        "servo": 1, "temperature": 0, "state": [], "system": 255, "kind": "ping", "hops": 0, "stamp": 0,
    }  # fmt: skip
    assert header_of(codec, codec.encode("at"), "mcu")["system"] == 2


def test_values_are_as_those_of_message_fields(codec: Codec) -> None:
    header = {"servo": 7, "temperature": -12.5, "state": ["angle"], "system": 9, "kind": "read", "hops": -3}
    frame = codec.encode("move", x=3, header={**header, "stamp": 2**64 - 2})
    assert frame[:-1] == bytes.fromhex("FFFF 07 FF83 02 09 EA 01 01 03 FEFFFFFFFFFFFFFF")
    assert header_of(codec, frame, "host") == {**header, "stamp": 2**64 - 2}


@pytest.mark.parametrize(
    ("header", "sentence"),
    [
        ({"servo": 256}, "header.servo = 256 does not fit its 8-bit wire type, which holds 0 ... 255"),
        ({"servo": "left"}, "header.servo is 'left' (str); expected a number"),
        ({"temperature": 201}, "header.temperature = 201 K is outside -40 ... 200 K"),
        ({"kind": "write"}, "header.kind is 'write'; expected one of ping, read"),
        ({"kind": 3}, "header.kind is 3; expected one of ping, read"),
        ({"state": ["heat"]}, "header.state has no flag 'heat'; it has voltage, angle"),
        ({"hops": 16}, "header.hops = 16 does not fit its 5-bit wire type, which holds -16 ... 15"),
        ({"stamp": 2**64}, "header.stamp = 18446744073709551616 does not fit its 64-bit wire type"),
        (
            {"servos": 1},
            "the header has no field 'servos'; it has servo, temperature, state, system, kind, hops, stamp",
        ),
        ([("servo", 1)], "header is [('servo', 1)]; expected the frame's own fields as a mapping"),
    ],
)
def test_a_value_that_cannot_be_is_refused(codec: Codec, header: Any, sentence: str) -> None:
    with pytest.raises(MessageError) as refused:
        codec.encode("move", x=1, header=header)
    assert sentence in str(refused.value)


def test_header_values_choose_the_form_and_a_value_that_no_form_of_them_has_is_refused() -> None:
    text = BUS.replace("- length: u8", "- {field: extra, type: u16, when: state & 0x02}\n  - length: u8")
    codec = Codec(loads(text))
    assert codec.encode("move", x=1)[:9] == bytes.fromhex("FFFF 01 0000 00 FF 01 01")
    assert codec.encode("move", x=1, header={"state": ["angle"]})[7:11] == bytes.fromhex("01 0000 01")
    frame = codec.encode("move", x=1, header={"state": ["angle"], "extra": 513})
    assert header_of(codec, frame, "host")["extra"] == 513
    with pytest.raises(MessageError, match="no form of the frame has the header fields extra together"):
        codec.encode("move", x=1, header={"extra": 513})


def test_a_magic_that_no_frame_has_is_reported_with_its_number() -> None:
    codec = Codec(loads(BUS.replace("- magic: 0xFF 0xFF", "- magic: {any: [0xFF 0xFF, 0xFF 0xFE]}")))
    assert codec.encode("move", x=1, header={"magic": 0xFFFE})[:2] == b"\xff\xfe"
    with pytest.raises(MessageError, match=r"no form .* the header fields magic 65533 \(0xFFFD\) together"):
        codec.encode("move", x=1, header={"magic": 0xFFFD})


SERVO_BUS = ROOT / "tests" / "formats" / "servo_options.yaml"


@pytest.fixture(scope="module")
def servo_bus() -> Codec:
    return load(SERVO_BUS)


def test_columns_have_the_header_with_the_types_of_fields(codec: Codec) -> None:
    frames = [
        codec.encode("move", x=n, header={"servo": n, "temperature": -n, "hops": -n, "kind": "read", "stamp": n << 40})
        for n in range(9)
    ]
    table = codec.decode_columns(b"".join(frames), "host")["move"]
    assert list(table)[:3] == ["x", "header.servo", "header.temperature"]
    assert table["header.servo"].tolist() == list(range(9)) and table["header.servo"].dtype == "uint8"
    assert table["header.temperature"].tolist() == [-float(n) for n in range(9)]
    assert table["header.hops"].tolist() == [-n for n in range(9)] and table["header.hops"].dtype == "int8"
    assert table["header.kind"].tolist() == [2] * 9
    assert table["header.stamp"].tolist() == [n << 40 for n in range(9)]


def test_columns_of_a_large_capture_are_those_of_one_thread(servo_bus: Codec) -> None:
    frames = b"".join(
        servo_bus.encode("move", angle=0, header={"servo": n % 250, **({"options": ["registered"]} if n % 3 else {})})
        for n in range(20_000)
    )
    one, four = (servo_bus.decode_columns(frames, "host", threads=n)["move"] for n in (1, 4))
    assert len(one) == 20_000
    for name in one:
        assert one[name].tolist() == four[name].tolist(), name
    assert one["header.servo"].tolist() == [n % 250 for n in range(20_000)]
    assert one["header.stamp"].tolist() == [0.0] * 20_000


def test_an_unknown_frame_shows_its_header_in_columns(codec: Codec) -> None:
    frame = bytearray(codec.encode("move", x=3, header={"servo": 9}))
    frame[9] = 0x77
    frame[-1] = (sum(frame[:-1])) & 0xFF
    known = Codec(loads(BUS + "unknown: deliver\n"))
    assert known.decode_columns(bytes(frame), "host")["unknown"]["header.servo"].tolist() == [9]


def test_explain_says_what_header_fields_mean(servo_bus: Codec) -> None:
    frame = servo_bus.encode("ask", header={"servo": 4, "options": ["registered"], "stamp": 1.5})
    (stretch,) = explain(servo_bus.model, frame, End.HOST).stretches
    meanings = {row.name: row.meaning for row in stretch.rows}
    assert meanings["servo"] == "4: the MCU's address"
    assert meanings["options"] == "registered (0x02)"
    assert meanings["stamp"] == "1.5 s (1500 * 0.001)"
    assert stretch.header == {"servo": 4, "options": ["registered"], "stamp": 1.5}
    broadcast = servo_bus.encode("ask", header={"servo": 254})
    assert explain(servo_bus.model, broadcast, End.HOST).stretches[0].rows[1].meaning == "254: every receiver"


def test_the_document_has_a_table_of_header_fields(servo_bus: Codec) -> None:
    text = markdown(servo_bus)
    assert "| servo | u8 |  |  | 1 | which servo; the MCU's address: in frames to it and in frames from it |" in text
    assert "| stamp | u16be | s | wire * 0.001 | 0 |  |" in text
    assert "`servo` 254 is a broadcast: every receiver acts on it, and none answers." in text
    assert "Bits of options:" in text


def test_the_virtual_mcu_answers_from_the_address_that_was_asked(servo_bus: Codec) -> None:
    mcu = VirtualMcu(servo_bus, 0.0)
    decoder = servo_bus.decoder("mcu")
    for servo in (3, 7):
        (reply,) = decoder.feed(mcu.feed(servo_bus.encode("ask", header={"servo": servo}), 0.0))
        assert (reply.name, reply.header["servo"]) == ("state", servo)
    assert mcu.feed(servo_bus.encode("ask", header={"servo": 0xFE}), 0.0) == b""


def test_a_virtual_mcu_of_one_address_is_silent_for_others(servo_bus: Codec) -> None:
    mcu = VirtualMcu(servo_bus, 0.0, addresses=(7,))
    assert mcu.feed(servo_bus.encode("ask", header={"servo": 3}), 0.0) == b""
    assert (mcu.foreign, mcu.account.frames) == (1, 1)
    (reply,) = servo_bus.decoder("mcu").feed(mcu.feed(servo_bus.encode("ask", header={"servo": 7}), 0.0))
    assert reply.header["servo"] == 7


def test_a_typed_module_takes_and_carries_the_header(tmp_path: Path) -> None:
    (module,) = generate_python(load(SERVO_BUS).model, tmp_path)
    specification = importlib.util.spec_from_file_location("servo_options", module)
    assert specification is not None and specification.loader is not None
    typed = importlib.util.module_from_spec(specification)
    sys.modules["servo_options"] = typed
    try:
        specification.loader.exec_module(typed)
    finally:
        del sys.modules["servo_options"]
    frame = typed.Move(angle=0.5).encode(header={"servo": 3})
    assert frame == load(SERVO_BUS).encode("move", angle=0.5, header={"servo": 3})
    (message,) = typed.codec.decoder("host").feed(frame)
    received = typed.from_message(message)
    assert received.header == {"servo": 3, "options": []}
    assert received == typed.Move(angle=0.5)  # the header is not a value of the message
    assert typed.Move(angle=0.5).header == {}


def test_a_received_header_that_breaks_a_rule_is_a_violation_of_its_message(codec: Codec) -> None:
    """The handler of generated code does not get such a message; the frame itself is delivered."""
    frame = bytearray(codec.encode("move", x=1))
    frame[3:5] = b"\x7f\xff"  # 3276.7 K
    frame[7] = 5  # `kind` has no name for it
    frame[-1] = sum(frame[:-1]) & 0xFF
    (message,) = codec.decoder("host").feed(bytes(frame))
    temperature, kind = message.violations
    assert temperature.startswith("header.temperature ")
    assert kind.startswith("header.kind ")
    assert codec.decoder("host").feed(codec.encode("move", x=1))[0].violations == []
