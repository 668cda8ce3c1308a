"""Numbers in characters: what their digits mean, what is not a number, and where they are; against hand-made bytes."""

from __future__ import annotations

import math
import re
from decimal import Decimal
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import wirebond
from wirebond import Codec
from wirebond.analysis.explain.values import read_fields, values_of
from wirebond.protocol import loads

LINE = "wirebond: 1\nprotocol: line\nframe: [payload: rest, delimiter: 0x0D 0x0A]\n"


def line_of(fields: str) -> Codec:
    """Lines of text from the MCU with these fields."""
    return Codec(loads(f"{LINE}messages: {{m: {{sender: mcu, fields: {{{fields}}}}}}}\n"))


def read(codec: Codec, text: bytes) -> wirebond.Message:
    [message] = codec.decoder("mcu").feed(text + b"\r\n")
    return message


SENSOR = line_of(
    "t: {type: u32, text: decimal, ends_with: 0x2C, unit: ms}, "
    "x: {type: i16, text: decimal, decimals: 2, ends_with: 0x2C}, code: {type: u16, text: hex, size: 4}"
)


def test_a_line_of_a_sensor_is_read_and_written() -> None:
    message = read(SENSOR, b"12034,-3.50,00fF")
    assert message.fields == {"t": 12034, "x": -3.5, "code": 255}
    assert message.violations == []
    assert SENSOR.encode("m", message.fields) == b"12034,-3.50,00FF\r\n"


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0", 0.0), ("7", 7.0), ("-7", -7.0), ("+7", 7.0), ("007", 7.0), ("  7", 7.0), (" -7.5", -7.5), ("7.", 7.0),
        (".5", 0.5), ("-.5", -0.5), ("1.234", 1.23), ("1.235", 1.24), ("-1.235", -1.24), ("-0.004", 0.0),
        ("327.67", 327.67), ("-327.68", -327.68), ("327.674999", 327.67), ("1.2e3", None), ("-", None),
        (".", None), ("1.2.3", None), ("1 ", None), ("- 1", None), ("--1", None), ("0x10", None), ("327.675", None),
        ("-327.69", None), ("99999999999999999999", None), ("1\0", None), ("\xb2", None),
    ],
)  # fmt: skip
def test_texts_that_are_numbers_and_texts_that_are_not(text: str, value: float | None) -> None:
    codec = line_of("x: {type: i16, text: decimal, decimals: 2, max: 20}")
    message = read(codec, text.encode("latin-1"))
    assert message.fields == {"x": value}
    assert len(message.violations) == (value is None)
    if value is None:
        [sentence] = message.violations
        assert sentence.startswith("m.x is '")
        assert sentence.endswith("', which is no 16-bit number in decimal digits")
    [reading] = read_fields(codec.model.message("m"), text.encode("latin-1"))  # what `explain` shows
    assert values_of([reading]) == {"x": value}
    assert bool(reading.faults) == (value is None)
    columns = codec.decode_columns(text.encode("latin-1") + b"\r\n", "mcu")["m"]
    assert columns["x"].tolist() == pytest.approx([math.nan if value is None else value], nan_ok=True)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0", 0), ("ff", 255), ("FF", 255), ("00000000aB", 171), ("+1", 1), ("10000", None), ("-1", None), ("g", None),
        ("1.0", None),
    ],
)  # fmt: skip
def test_hex_digits(text: str, value: int | None) -> None:
    message = read(line_of("x: {type: u16, text: hex, max: 12}"), text.encode())
    assert message.fields == {"x": value}
    assert message.violations == (
        [] if value is not None else [f"m.x is '{text}', which is no 16-bit number in hex digits"]
    )


@given(wire=st.integers(-(2**47), 2**47 - 1), decimals=st.integers(0, 6), size=st.integers(17, 20))
def test_digits_are_those_of_the_number(wire: int, decimals: int, size: int) -> None:
    point = f", decimals: {decimals}" if decimals else ""
    value = Decimal(wire).scaleb(-decimals)
    codec = line_of(
        f"a: {{type: i48, text: decimal{point}, ends_with: 0x20}}, b: {{type: i48, text: decimal{point}, size: {size}}}"
    )
    given_values = {name: float(value) if decimals else wire for name in "ab"}
    spelled = f"{value:.{decimals}f}" if wire else f"{abs(value):.{decimals}f}"
    padded = f"-{spelled[1:].rjust(size - 1, '0')}" if wire < 0 else spelled.rjust(size, "0")
    assert codec.encode("m", given_values) == f"{spelled} {padded}\r\n".encode()
    assert read(codec, f"{spelled} {padded}".encode()).fields == given_values


def test_a_number_that_is_not_ended_has_no_value_and_later_ones_keep_their_place() -> None:
    codec = line_of("x: {type: u8, text: decimal, ends_with: 0x2C}, y: {type: u8, text: decimal}")
    message = read(codec, b"1234,5")
    assert message.fields["x"] is None
    assert message.violations[0] == "m.x does not end with 0x2C within 4 bytes"


def test_in_groups_each_element_has_its_own_size() -> None:
    codec = line_of("legs: {group: {count: to_end, max: 4, fields: {x: {type: i16, text: decimal, ends_with: 0x3B}}}}")
    message = read(codec, b"1;-20;300;")
    assert message.fields == {"legs": [{"x": 1}, {"x": -20}, {"x": 300}]}
    assert codec.encode("m", message.fields) == b"1;-20;300;\r\n"
    columns = codec.decode_columns(b"1;-20;300;\r\n1;x;\r\n", "mcu")["m"]
    assert columns["legs[1].x"].tolist() == pytest.approx([-20, math.nan], nan_ok=True)
    assert columns["legs[2].x"].tolist() == pytest.approx([300, math.nan], nan_ok=True)


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"x": 1000}, "m.x = 1000 does not fit its 16-bit wire type, which holds 0 ... 999"),
        ({"x": -1}, "m.x = -1 does not fit its 16-bit wire type, which holds 0 ... 999"),
        ({"x": "1"}, "m.x is '1' (str); expected"),
    ],
)
def test_values_that_cannot_be_sent(values: dict[str, Any], sentence: str) -> None:
    with pytest.raises(wirebond.MessageError, match=re.escape(sentence)):
        line_of("x: {type: u16, text: decimal, size: 3}").encode("m", values)


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ("x: {type: f32, text: decimal}", "`text` is for whole numbers, such as u16 and i32; for one with a point"),
        ("x: {type: bool, text: decimal}", "`text` is for whole numbers"),
        ("x: {type: u8, decimals: 2}", "`decimals` is for numbers in characters; add `text: decimal`"),
        ("x: {type: u8, text: octal}", "octal"),
        ("x: {type: u16be, text: decimal}", "only digits are sent here; write `u16`"),
        ("x: {type: s16, text: decimal}", "only digits are sent here; write `i16`"),
        ("x: {type: u64, text: decimal}", "only digits are sent here; write `u48`"),
        ("x: {type: i16, text: hex}", "hex digits have no sign; write `u16`"),
        ("x: {type: u16, text: hex, decimals: 1}", "hex digits have no point; remove it"),
        ("x: {type: u16, text: decimal, count: 2}", "`count` cannot be combined with `text`"),
        ("x: {type: u16, text: decimal, constant: 2}", "`constant` cannot be combined with `text`"),
        ("x: {type: u32, text: decimal, clock: mcu, unit: us}", "`clock` cannot be combined with `text`"),
        ("x: {type: u16, text: decimal, size: 3, ends_with: 0x2C}", "`ends_with` cannot be combined with `size`"),
        ("x: {type: u16, text: decimal, ends_with: 0x30}", "this byte can be part of a number"),
        ("x: {type: u16, text: hex, ends_with: 0x41}", "this byte can be part of a number"),
        ("x: {type: u16, text: decimal, decimals: 2, size: 3}", "0.00 has 4 characters; write at least 4"),
        ("x: {type: u16, text: decimal, size: n}", "no field counts the characters of a number"),
        ("x: {type: u16, text: decimal}, y: u8", "`x` reaches to the payload's end, so it must be the last"),
        ("n: {type: u8, text: decimal, size: 2}, x: {type: text, size: n, max: 9}", "`n` cannot count"),
        (
            "x: {type: u16, text: decimal, size: 2, default: 100}",
            "100 does not fit `x`, which takes values from 0 to 99",
        ),
    ],
)
def test_keys_that_a_number_in_characters_cannot_have(fields: str, sentence: str) -> None:
    with pytest.raises(wirebond.ProtocolFileError, match=re.escape(sentence)):
        line_of(fields)


# ---- a check in decimal digits


def checked(check: str = "xor8") -> Codec:
    digits = f"{{type: {check}, over: payload, text: decimal}}"
    text = f"frame: [payload: rest, constant: 0x2A, check: {digits}, delimiter: 0x0A]\n"
    text += "messages: {m: {sender: mcu, fields: {x: {type: text, max: 20}}}}\n"
    return Codec(loads(f"wirebond: 1\nprotocol: p\n{text}"))


@pytest.mark.parametrize(("text", "check"), [("T0", "100"), ("aa", "0"), ("a@", "33"), ("\x7f", "127")])
def test_a_check_in_decimal_digits_has_as_many_as_it_needs(text: str, check: str) -> None:
    assert checked().encode("m", x=text) == f"{text}*{check}\n".encode()


@pytest.mark.parametrize(
    ("line", "cause"),
    [
        (b"T0*100", ""), (b"aa*0", ""), (b"aa*000", ""), (b"a@*033", ""), (b"T0*101", "check_mismatch"),
        (b"aa*0000", "constant_mismatch"), (b"T0*", "bad_stuffing"), (b"T0*ab", "bad_stuffing"),
        (b"T0*356", "bad_stuffing"), (b"T0*10 ", "bad_stuffing"), (b"", ""),
    ],
)  # fmt: skip
def test_values_that_a_receiver_takes_and_counts(line: bytes, cause: str) -> None:
    decoder = checked().decoder("mcu")
    found = decoder.feed(line + b"\n")
    assert len(found) == (not cause and line != b"")
    assert {name for name, number in decoder.stats.rejected_candidates.items() if number} == (
        {cause} if cause else set()
    )


@given(text=st.text(st.characters(codec="ascii", exclude_characters="\n\0"), min_size=1, max_size=20))
@pytest.mark.parametrize("check", ["xor8", "sum16", "crc-24/openpgp", "crc-32/iso-hdlc"])
def test_wider_checks_come_back(check: str, text: str) -> None:
    codec = checked(check)
    [message] = codec.decoder("mcu").feed(codec.encode("m", x=text))
    assert message.fields == {"x": text}


CHECK = "check: {type: xor8, text: decimal}"


@pytest.mark.parametrize(
    ("frame", "sentence"),
    [
        (f"payload: rest, {CHECK}, delimiter: 0x0A", "must follow a constant that is not a digit"),
        (f"payload: rest, constant: 0x30, {CHECK}, delimiter: 0x0A", "must follow a constant that is not a digit"),
        (f"payload: rest, constant: 0x2A, {CHECK}, tail: 0x3B, delimiter: 0x0A", "the last part of every frame"),
        (f"magic: 0xAA, payload: 3, constant: 0x2A, {CHECK}", "ends with a delimiter that is not a digit"),
        (f"payload: rest, constant: 0x2A, {CHECK}, delimiter: 0x31", "ends with a delimiter that is not a digit"),
        (f"payload: rest, constant: 0x2A, {CHECK.replace('xor8', 'crc-64/xz')}, delimiter: 0x0A", "at most 32 bits"),
        (f"cobs: [payload: rest, constant: 0x2A, {CHECK}], delimiter: 0x00", "its frame is not stuffed"),
    ],
)
def test_where_a_check_in_decimal_digits_cannot_stand(frame: str, sentence: str) -> None:
    with pytest.raises(wirebond.ProtocolFileError, match=re.escape(sentence)):
        loads(f"wirebond: 1\nprotocol: p\nframe: [{frame}]\nmessages: {{m: {{sender: mcu, fields: {{x: u8}}}}}}\n")
