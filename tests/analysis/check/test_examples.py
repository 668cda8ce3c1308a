"""Worked examples are worked out again; one that is wrong names the byte, what is found there and what is expected."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.analysis.check.files import PROTOCOLS, made, shipped

from wirebond.analysis.check import Places, examples
from wirebond.analysis.check.findings import Severity
from wirebond.codec import load

SPECIFICATION = Path(__file__).with_name("diffdrive_specification.yaml")
NOWHERE = Places()


def test_three_of_the_specifications_four_examples_have_a_wrong_check() -> None:
    codec = load(SPECIFICATION)
    found = examples.assess(codec, Places.of_text(codec.model.text))
    assert [(finding.line, finding.severity) for finding in found] == [(line, Severity.ERROR) for line in (14, 15, 16)]
    assert [finding.sentence for finding in found] == [
        "the example of `velocity`: byte 9 (check) is 0xFF, expected 0x0B",
        "the example of `velocity`: byte 9 (check) is 0xEF, expected 0x15",
        "the example of `velocity`: byte 9 (check) is 0x8C, expected 0x26",
    ]
    assert "AA 55 01 F4 01 00 00 00 00 0B 0D" in found[0].reason
    assert "the receiver refuses the example's bytes (check_mismatch)" in found[0].reason


@pytest.mark.parametrize("path", sorted(PROTOCOLS.glob("*.yaml")), ids=lambda path: path.stem)
def test_the_projects_own_examples_are_right(path: Path) -> None:
    assert examples.assess(load(path), NOWHERE) == []


def test_the_seeds_protocols_have_examples() -> None:
    assert len(shipped("diffdrive").model.examples) >= 3
    assert len(shipped("pid_tuner").model.examples) >= 1


MESSAGES = """
  state:
    id: 1
    sender: both
    fields:
      x: {type: i16, scale: 0.01}
      mode: {type: u8, enum: {off: 0, on: 1}}
      faults: {type: u8, flags: {hot: 0, stuck: 1}}
      ok: {type: bool}
      gains: {type: f32, count: 2}
      blob: {type: bytes, max: 4}
"""
FIELDS = "x: 1.5, mode: on, faults: [hot, stuck], ok: true, gains: [0.1, -2], blob: 01 FF"
FRAME = "A5 0F 01 96 00 01 03 01 CD CC CC 3D 00 00 00 C0 01 FF"


def assessed(fields: str, frame: str) -> list[str]:
    rest = f'examples: [{{message: state, fields: {{{fields}}}, bytes: "{frame}"}}]'
    codec = made("[magic: 0xA5, length: u8, id: u8, payload: by_length, check: xor8]", MESSAGES, rest)
    return [finding.sentence.removeprefix("the example of `state`: ") for finding in examples.assess(codec, NOWHERE)]


def with_check(frame: str) -> str:
    check = 0
    for byte in bytes.fromhex(frame):
        check ^= byte
    return f"{frame} {check:02X}"


def test_every_kind_of_field_can_stand_in_an_example() -> None:
    assert assessed(FIELDS, with_check(FRAME)) == []
    assert assessed(FIELDS.replace("on", "1").replace("[hot, stuck]", "3"), with_check(FRAME)) == []


def test_a_wrong_value_names_its_byte_and_the_check_after_it() -> None:
    sentence = assessed(FIELDS.replace("1.5", "1.4"), with_check(FRAME))[0]
    assert sentence.startswith("byte 3 (payload) is 0x96, expected 0x8C, byte 18 (check) is 0x")


def test_a_missing_byte_is_reported_by_size() -> None:
    assert assessed(FIELDS, with_check(FRAME).rsplit(" ", 1)[0]) == ["it has 18 bytes, expected 19"]


def test_a_value_that_the_wire_cannot_carry_exactly_is_reported() -> None:
    found = assessed(FIELDS.replace("1.5", "1.504"), with_check(FRAME))
    assert found == ["`x` comes back as 1.5, and the example says 1.504"]


def test_header_fields_choose_the_form_that_is_compared() -> None:
    frame = "[magic: 0xA5, {bits: u8, fields: {stamped: 1, rest: 7}}, {field: stamp, type: u16, when: stamped & 0x01}, "
    frame += "id: u8, payload: by_id, check: xor8]"
    messages = "{state: {id: 1, sender: mcu, fields: {x: {type: u8}}}}"
    for header, bytes_, found in (
        ("{stamped: 1, stamp: 2}", "A5 01 02 00 01 09 AE", []),
        ("{}", "A5 00 01 09 AD", []),
        ("{stamped: 1, stamp: 2}", "A5 01 03 00 01 09 AE", ["byte 2 (field stamp) is 0x03, expected 0x02"]),
    ):
        rest = f'examples: [{{message: state, header: {header}, fields: {{x: 9}}, bytes: "{bytes_}"}}]'
        assessed = examples.assess(made(frame, messages, rest), NOWHERE)
        assert [finding.sentence.removeprefix("the example of `state`: ") for finding in assessed] == found


def test_bytes_of_stuffed_frames_are_compared_too() -> None:
    frame = "[delimiter: 0x00, cobs: [id: u8, payload: rest, check: crc-16/ibm-sdlc], delimiter: 0x00]"
    messages = "{state: {id: 1, sender: mcu, fields: {x: {type: i16}}}}"
    good = made(frame, messages).encode("state", x=1)
    for bytes_, found in ((good, 0), (good[:1] + b"\x02" + good[2:], 1)):
        rest = f'examples: [{{message: state, fields: {{x: 1}}, bytes: "{bytes_.hex(" ")}"}}]'
        assert len(examples.assess(made(frame, messages, rest), NOWHERE)) == found
