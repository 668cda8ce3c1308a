"""A short form means what its long form means, everywhere; what is wrong in it is reported at its place."""

from __future__ import annotations

from dataclasses import replace

import pytest
from tests.protocol.test_schema import VALIDATOR, tree

from wirebond.protocol import ProtocolFileError, loads

HEAD = """\
wirebond: 1
protocol: rover
frame: [magic: 0xA5, length: u8, id: u8, payload: by_length, check: crc-16/modbus]
"""
SHORT = (
    HEAD
    + """\
types:
  point: {x: i16 0.001 m, y: i16 0.001 m}
  pose: {position: point, heading: f32 rad}
messages:
  hello: {id: 1, sender: both, fields: {protocol_hash: u64, version: u16}}
  state:
    id: 2
    sender: mcu
    fields:
      ready:   bool
      voltage: u16be mV
      torque:  i16 0.5 N m
      ratio:   "u8 0.01"
      where:   pose
      inner:   {struct: {a: u8, at: point}}
      joints:
        group:
          count: 2
          fields:
            position: i16 0.001 rad
            mode: {bits: {type: u8, fields: {on: u1, level: u7 0.1}}}
services: {hello: hello}
"""
)
LONG = (
    HEAD
    + """\
types:
  point: {x: {type: i16, scale: 0.001, unit: m}, y: {type: i16, scale: 0.001, unit: m}}
  pose: {position: {struct: point}, heading: {type: f32, unit: rad}}
messages:
  hello: {id: 1, sender: both, fields: {protocol_hash: {type: u64}, version: {type: u16}}}
  state:
    id: 2
    sender: mcu
    fields:
      ready:   {type: bool}
      voltage: {type: u16be, unit: mV}
      torque:  {type: i16, scale: 0.5, unit: N m}
      ratio:   {type: u8, scale: 0.01}
      where:   {struct: pose}
      inner:   {struct: {a: {type: u8}, at: {struct: point}}}
      joints:
        group:
          count: 2
          fields:
            position: {type: i16, scale: 0.001, unit: rad}
            mode: {bits: {type: u8, fields: {on: {type: u1}, level: {type: u7, scale: 0.1}}}}
services: {hello: {message: hello}}
"""
)


def test_each_short_form_means_what_its_long_form_means() -> None:
    assert replace(loads(SHORT), text="") == replace(loads(LONG), text="")


@pytest.mark.parametrize("text", [SHORT, LONG])
def test_the_schema_knows_both(text: str) -> None:
    assert [error.message for error in VALIDATOR.iter_errors(tree(text))] == []


def test_a_word_that_is_a_type_of_numbers_stays_that() -> None:
    text = HEAD + "types: {u8: {x: f32}}\nmessages: {a: {id: 1, sender: mcu, fields: {b: u8}}}\n"
    assert loads(text) == replace(loads(text.replace("b: u8", "b: {type: u8}")), text=text)


@pytest.mark.parametrize(
    ("field", "sentence"),
    [
        ("u9x", ":4:48: `u9x` is not a type here; possible: u8"),
        ("int16_t", ":4:48: `int16_t` is not a type here; write `i16`"),
        ("pont", ":4:48: `pont` is not a type here; possible: u8"),
        ("bool m", ":4:48: `unit` is for numbers; remove it"),
        ("text", ":4:48: a text field needs a size; add `size: 16`"),
        ("u8 0", ":4:48: a scale of 0 would make every value the same"),
        ("5", ":4:48: `5` cannot be used for a field; write a type, such as `u16`, or a mapping with the keys type, "),
        ("[u8]", "cannot be used for a field"),
    ],
)
def test_a_fault_in_a_short_form_is_reported_at_its_place(field: str, sentence: str) -> None:
    text = HEAD + f"messages: {{a: {{id: 1, sender: mcu, fields: {{b: {field}}}}}}}\n"
    with pytest.raises(ProtocolFileError) as caught:
        loads(text)
    assert sentence in str(caught.value)


@pytest.mark.parametrize(
    ("service", "sentence"),
    [("hello: nobody", "there is no message `nobody`"), ("ping: hello", "`hello` cannot be used for this service")],
)
def test_a_wrong_service_is_a_sentence(service: str, sentence: str) -> None:
    with pytest.raises(ProtocolFileError, match=sentence):
        loads(SHORT.replace("services: {hello: hello}", f"services: {{{service}}}"))
