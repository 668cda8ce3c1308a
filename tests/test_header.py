"""Header values at the host: real bytes both ways, and the sentence for each value that cannot be."""

from __future__ import annotations

from typing import Any

import pytest

from wirebond import Codec, MessageError
from wirebond.protocol import loads

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
