"""Frames of devices whose checks are combinations, byte for byte: their values are those that their makers publish or
that were captured on a line."""

from __future__ import annotations

from itertools import product
from typing import Any

import pytest

import wirebond
from tests.reference.checks import checksum
from tests.shared import ROOT
from wirebond.protocol import loads
from wirebond.protocol.model import PartKind

FORMATS = ROOT / "tests" / "formats"
PIONEER = {"argument_type": 59, "argument": 1}
FEEDBACK = {
    "cmd1": 0, "cmd2": 0, "speed_right": 0, "speed_left": 0, "battery": 42.33, "temperature": 37.7, "led": 10,
}  # fmt: skip
FRAMES: list[tuple[str, str, str, str, dict[str, Any], dict[str, int]]] = [
    ("hoverboard", "mcu", "cd ab 00 00 00 00 00 00 00 00 89 10 79 01 0a 00 37 ba", "feedback", FEEDBACK, {}),
    ("hoverboard", "host", "cd ab ce ff 2c 01 2f 55", "command", {"steer": -50, "speed": 300}, {}),
    (
        "lg_ac", "mcu", "a8 20 00 00 00 00 1b 26 00 00 00 00 5c", "state",
        {"state": bytes.fromhex("20 00 00 00 00 1b 26 00 00 00 00")}, {},
    ),
    ("pioneer", "host", "fa fb 06 04 3b 01 00 05 3b", "command", PIONEER, {"id": 4}),
    ("pioneer", "mcu", "fa fb 05 20 50 69 20 39", "report", {"data": b"Pi"}, {"id": 32}),
    (
        "stm32_crc", "mcu", "21 50" + " 00" * 58 + " 2b 88 3a 8b", "data", {"rest": b"\x50" + bytes(58)}, {"id": 0x21},
    ),
    ("sabertooth", "host", "82 00 40 42", "drive", {"speed": 64}, {"id": 0, "address": 130}),
    ("pololu", "host", "83 01 17", "exit_safe_start", {}, {}),
    ("vedirect_hex", "mcu", b":A0002000148\n".hex(), "update", {"register": 512, "flags": 0, "value": 1}, {}),
    ("vedirect_hex", "mcu", b":51641F9\n".hex(), "pong", {"version": 16662}, {}),
    ("gcode_line", "host", b"N3 T0*57\n".hex(), "line", {"line": 3, "command": "T0"}, {}),
    *(  # seven digits that lie apart
        ("bcd_counter", "mcu", frame, "count", {"all": {"number": number, "second": second, "last": last}}, {})
        for frame, number, second, last in (
            ("f1 f7 11 26 94 74", 1112694, 0xF7, 0x74),
            ("f5 7c 43 24 32 a2", 5432432, 0x7C, 0xA2),
            ("f6 dc 43 01 16 48", 6430116, 0xDC, 0x48),
            ("f3 d8 25 48 17 e9", 3254817, 0xD8, 0xE9),
            ("f0 ce 04 28 63 b2", 42863, 0xCE, 0xB2),
        )
    ),
]  # fmt: skip


@pytest.mark.parametrize(("file", "sender", "frame", "name", "fields", "header"), FRAMES)
def test_frames_are_encoded_and_decoded(
    file: str, sender: str, frame: str, name: str, fields: dict[str, Any], header: dict[str, int]
) -> None:
    codec, raw = wirebond.load(FORMATS / f"{file}.yaml"), bytes.fromhex(frame)
    decoder = codec.decoder(sender)
    [message] = decoder.feed(raw) + decoder.finish()
    assert message.name == name
    assert dict(message.fields) == pytest.approx(fields) if name == "feedback" else dict(message.fields) == fields
    assert codec.encode(name, fields, header=header, sender=sender) == raw


def test_the_words_of_the_stm32_are_those_of_its_manual() -> None:
    text = "wirebond: 1\nprotocol: one\nframe: [payload: 4, check: {type: stm32-crc, byte_order: big}]\n"
    codec = wirebond.Codec(loads(text + "messages: {word: {sender: mcu, fields: {word: u32le}}}\n"))
    assert codec.encode("word", word=0x12345678).hex() == "78563412df8a8a2b"


SUMMED = """\
wirebond: 1
protocol: summed
frame: [constant: 0x02, payload: 4, check: {{type: sum8, over: payload, {options}}}]
messages: {{data: {{sender: mcu, fields: {{data: {{type: bytes, size: 4}}}}}}}}
"""


@pytest.mark.parametrize(
    ("options", "data", "value"),
    [
        ("modulo: 100, bcd: true", "64 64 64 0c", 0x12),  # 312
        ("bcd: true", "ff 00 00 00", 0x55),  # 255: there is room for two digits
        ("avoid: {values: 0..0x1F, plus: 0x20}", "10 0f 00 00", 0x3F),
        ("avoid: {values: 0..0x1F, plus: 0x20}", "10 10 00 00", 0x20),
        ("avoid: {values: [0x0A, 0x0D], plus: 0xFF}", "0a 00 00 03", 0x0C),
        ("avoid: {values: 010, plus: 1}", "0a 00 00 00", 0x0B),
        ("mask: 0x7F, avoid: {values: [0, 0x0A..0x0D], plus: 0x30}", "80 00 00 00", 0x30),
    ],
)
def test_a_sum_is_sent_as_its_last_steps_say(options: str, data: str, value: int) -> None:
    codec = wirebond.Codec(loads(SUMMED.format(options=options)))
    raw = codec.encode("data", data=bytes.fromhex(data))
    assert raw == bytes([0x02]) + bytes.fromhex(data) + bytes([value])
    [message] = codec.decoder("mcu").feed(raw)
    assert message.fields["data"] == bytes.fromhex(data)
    assert codec.decoder("mcu").feed(raw[:-1] + bytes([value ^ 1])) == []


WORDS = "type: xor16, odd: refuse"


@pytest.mark.parametrize(
    "checks",
    [
        f"{{check: {{{WORDS}, over: id, seed: message}}, name: a}}, payload: 2",  # two bytes, and the check of one more
        f"{{check: {{{WORDS}, over: magic..id}}, name: a}}, payload: 2, {{check: {{{WORDS}, over: payload}}, name: b}}",
        # An even number of bytes before it, only for values that a sender refuses.
        "{field: kind, type: u8, enum: {short: 0, long: 2}}, {constant: 0x07, name: c, when: kind >= 3}, payload: 2, "
        f"{{check: {{{WORDS}, over: id..c}}, name: a}}",
        "{field: kind, type: u8, range: [0, 2]}, {constant: 0x07, name: c, when: kind >= 3}, payload: 2, "
        f"{{check: {{{WORDS}, over: id..c}}, name: a}}",
    ],
)
def test_a_frame_whose_check_would_refuse_all_of_them_is_no_frame(checks: str) -> None:
    frame = f"frame: [magic: 0xA5, id: u16, {checks}]"
    with pytest.raises(wirebond.ProtocolFileError, match="always ends a check's range within a word"):
        loads(f"wirebond: 1\nprotocol: p\n{frame}\nmessages: {{m: {{id: 1, sender: mcu, fields: {{x: u16}}}}}}\n")


def test_an_empty_message_whose_check_refuses_its_frame_is_not_called_an_empty_frame() -> None:
    parts = '{field: kind, type: u8}, {constant: 0x07, name: c, when: "kind & 1"}, id: u8, payload: by_id, '
    parts += f"{{check: {{{WORDS}, over: magic..id}}, name: a}}"
    codec = wirebond.Codec(
        loads(f"wirebond: 1\nprotocol: p\nframe: [magic: 0xA5, {parts}]\nmessages: {{m: {{id: 1, sender: mcu}}}}\n")
    )
    assert codec.encode("m", header={"kind": 1})[:4] == bytes.fromhex("a5 01 07 01")
    with pytest.raises(
        wirebond.MessageError, match="payload of m has 0 bytes, and with them the frame's check has no whole"
    ):
        codec.encode("m", header={"kind": 0})


@pytest.mark.parametrize(
    "parts",
    [
        f"payload: 4, {{check: {{{WORDS}, over: magic..payload}}, name: a}}",  # filled with zeros, and 8 bytes then
        f"{{check: {{{WORDS}, over: magic..number}}, name: a}}, payload: by_id",
    ],
)
def test_the_payload_counts_as_it_is_sent_and_only_where_it_is_covered(parts: str) -> None:
    frame = "frame: [magic: 0xA5, id: u16, {field: number, type: u8}, " + parts + "]"
    codec = wirebond.Codec(
        loads(
            f"wirebond: 1\nprotocol: p\n{frame}\nmessages: {{m: {{id: 1, sender: mcu, fields: {{x: u16, y: u8}}}}}}\n"
        )
    )
    raw = codec.encode("m", x=0x0102, y=3)
    [message] = codec.decoder("mcu").feed(raw)
    assert dict(message.fields) == {"x": 0x0102, "y": 3}


@pytest.mark.parametrize("width", range(3, 8))
@pytest.mark.parametrize("steps", ["", ", negate: true", ", plus: 5", ", negate: true, plus: 2, mask: 3, xorout: 1"])
def test_a_crc_of_fewer_than_eight_bits_has_no_more_of_them_after_its_last_steps(width: int, steps: str) -> None:
    for refin, refout in product(("true", "false"), repeat=2):
        check = f"{{type: crc, width: {width}, poly: 3, init: 1, refin: {refin}, refout: {refout}{steps}}}"
        protocol = loads(
            "wirebond: 1\nprotocol: narrow\nframe: [magic: 0xA5, payload: 9, check: " + check + "]\n"
            "messages: {data: {sender: mcu, fields: {data: {type: bytes, size: 9}}}}\n"
        )
        part = protocol.format.part(PartKind.CHECK)
        assert part is not None
        assert part.algorithm is not None
        for data in (bytes(9), b"123456789"):
            raw = wirebond.Codec(protocol).encode("data", data=data)
            assert raw[-1] == checksum(part.algorithm, raw[:-1]), check
