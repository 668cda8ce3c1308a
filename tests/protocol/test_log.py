"""Log lines: the file's text with a message's values in it, and lines that came as text."""

import pytest

import wirebond
from wirebond.codec import Codec
from wirebond.generate.code.cpp import message_comment
from wirebond.protocol import loads, protocol_hash

FILE = """\
wirebond: 1
protocol: arm
frame:
  - magic: 0xAA 0x55
  - length: u8
  - id: u8
  - payload: by_length
  - check: crc-16/modbus
messages:
  motor_hot:
    id: 0x61
    sender: mcu
    log: "motor {motor} is too hot: {temperature} °C, {{braces}} stay"
    level: warning
    fields:
      motor:       {type: u8}
      temperature: {type: i16, unit: °C, scale: 0.1}
  started: {id: 0x62, sender: mcu, log: started}
  everything:
    id: 0x63
    sender: both
    log: "{power} {mode} {faults} {load} {list} {text} {bytes} {point}"
    level: debug
    fields:
      power:  {type: bool}
      mode:   {type: u8, enum: {off: 0, slow: 1}}
      faults: {type: u8, flags: {hot: 0, stalled: 1}}
      load:   {type: f32}
      list:   {type: u16, count: 2, scale: 0.25}
      text:   {type: text, size: 4}
      bytes:  {type: bytes, size: 2}
      point:  {struct: {x: {type: i8}, y: {type: i8, scale: 0.5}}}
  said: {id: 0x64, sender: mcu, fields: {level: {type: u8}, text: {type: text, max: 20}}}
  state: {id: 0x65, sender: mcu, fields: {speed: {type: i16}}}
services:
  log: {message: said}
"""


@pytest.fixture(scope="module")
def arm() -> Codec:
    return Codec(loads(FILE))


def line_of(codec: Codec, name: str, **values: object) -> wirebond.LogLine | None:
    decoder = codec.decoder()
    messages = decoder.feed(codec.encode(name, **values)) + decoder.finish()
    assert [message.name for message in messages] == [name]
    return codec.log_line(messages[0])


def test_values_stand_where_the_text_names_their_fields(arm: Codec) -> None:
    line = line_of(arm, "motor_hot", motor=2, temperature=81.5)
    assert line == wirebond.LogLine("warning", "motor 2 is too hot: 81.5 °C, {braces} stay")
    assert str(line).startswith("warning: motor 2 is too hot")
    assert line_of(arm, "started") == wirebond.LogLine("info", "started")


def test_every_kind_of_value_is_written_for_a_person(arm: Codec) -> None:
    line = line_of(
        arm, "everything", power=True, mode="slow", faults=["hot", "stalled"], load=1 / 3, list=[0.25, 2], text="ok",
        bytes=b"\x01\xab", point={"x": -1, "y": 1.5},
    )  # fmt: skip
    assert line is not None
    assert line.text == "yes slow hot, stalled 0.333333 0.25, 2.00 ok 01 AB x -1, y 1.5"


def test_the_log_services_line_is_the_text_that_came(arm: Codec) -> None:
    assert line_of(arm, "said", level=3, text="all is lost") == wirebond.LogLine("error", "all is lost")
    assert line_of(arm, "said", level=9, text="odd") == wirebond.LogLine("level 9", "odd")


def test_other_messages_are_no_log_lines(arm: Codec) -> None:
    assert line_of(arm, "state", speed=3) is None
    newer = Codec(loads(FILE.replace("id: 0x65", "id: 0x99")))
    (unknown,) = arm.decoder().feed(newer.encode("state", speed=3))
    assert (unknown.name, arm.log_line(unknown)) == ("unknown", None)


def test_generated_code_makes_the_text_of_the_message(arm: Codec) -> None:
    said = message_comment(arm.model.message("motor_hot"))
    assert said.endswith("a log line (warning): motor {motor} is too hot: {temperature} °C, {{braces}} stay.")


def test_a_text_may_be_mended_without_the_other_end() -> None:
    """The MCU knows ids and fields alone."""
    other = FILE.replace("is too hot", "runs hot").replace("level: warning", "level: error")
    assert protocol_hash(loads(other)) == protocol_hash(loads(FILE))
