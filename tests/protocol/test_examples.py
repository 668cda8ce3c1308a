"""The `examples` section: what it means once loaded, and what is said about wrong ones."""

from __future__ import annotations

import pytest

from wirebond.protocol import End, ProtocolFileError, loads, protocol_hash

FILE = """\
wirebond: 1
protocol: rover
frame: [magic: 0xAA, length: u8, id: u8, payload: by_length, check: xor8]
messages:
  drive: {id: 1, sender: host, fields: {speed: {type: i16, scale: 0.1, range: [-1, 1]}, mode: {type: u8, default: 0}}}
  state:
    id: 2
    sender: both
    fields:
      gear: {type: u8, enum: {neutral: 0, first: 1}}
      faults: {type: u8, flags: {hot: 0, stuck: 1}}
      gains: {type: f32, count: 2}
      name: {type: text, size: 4}
      blob: {type: bytes, max: 2}
"""
STATE = "gear: first, faults: [hot], gains: [1, 2.5], name: left, blob: 01 FF"


def with_example(example: str) -> str:
    return f"{FILE}examples:\n  - {{{example}}}\n"


def test_an_example_holds_values_as_the_api_takes_them() -> None:
    drive = loads(with_example('message: drive, fields: {speed: 0.5}, bytes: "AA 03 01 05 00 00 AD"')).examples[0]
    assert (drive.message, drive.sender, dict(drive.values)) == ("drive", End.HOST, {"speed": 0.5})
    assert drive.frame == bytes.fromhex("AA 03 01 05 00 00 AD")
    state = loads(with_example(f"message: state, sender: mcu, fields: {{{STATE}}}, bytes: AA55")).examples[0]
    assert state.sender == End.MCU
    assert dict(state.values) == {
        "gear": "first",
        "faults": ("hot",),
        "gains": (1.0, 2.5),
        "name": "left",
        "blob": b"\x01\xff",
    }


@pytest.mark.parametrize("text", ["AA 55 01", "aa5501", "0xAA 0x55 0x01", "AA55 01"])
def test_bytes_may_be_written_as_specifications_write_them(text: str) -> None:
    protocol = loads(with_example(f'message: drive, fields: {{speed: 0}}, bytes: "{text}"'))
    assert protocol.examples[0].frame == b"\xaa\x55\x01"


def test_a_message_of_both_ends_is_the_hosts_unless_said() -> None:
    assert loads(with_example(f"message: state, fields: {{{STATE}}}, bytes: AA")).examples[0].sender == End.HOST


NUMBERED = """\
wirebond: 1
protocol: numbered
frame: [magic: 0xAA, sequence: u8, bits: u8, id: u8, payload: by_id, check: xor8]
messages: {beat: {id: 2, sender: mcu}}
""".replace("bits: u8", "{bits: u8, fields: {urgent: 1, rest: 7}}")


def test_header_fields_may_be_given() -> None:
    text = NUMBERED + 'examples: [{message: beat, header: {sequence: 5, urgent: 1}, bytes: "AA 05 01 02 AC"}]\n'
    assert dict(loads(text).examples[0].header) == {"sequence": 5, "urgent": 1}


@pytest.mark.parametrize(
    ("header", "sentence"),
    [
        ("{sequenc: 5}", "7:37: the frame's header has no field `sequenc`; did you mean `sequence`?"),
        ("{sequence: 256}", "256 does not fit `sequence`, which takes values from 0 to 255"),
        ("{urgent: 2}", "2 does not fit `urgent`, which takes values from 0 to 1"),
        ("{sequence: -1}", "-1 does not fit `sequence`"),
    ],
)
def test_an_impossible_header_field_is_reported(header: str, sentence: str) -> None:
    with pytest.raises(ProtocolFileError) as refused:
        loads(NUMBERED + f'\n\nexamples: [{{message: beat, header: {header}, bytes: "AA"}}]')
    assert sentence in str(refused.value)


def test_examples_do_not_change_the_hash() -> None:
    assert protocol_hash(loads(with_example("message: drive, fields: {speed: 0}, bytes: AA"))) == protocol_hash(
        loads(FILE)
    )


@pytest.mark.parametrize(
    ("example", "at", "sentence"),
    [
        ("message: drve, bytes: AA", "drve", "there is no message `drve`; did you mean `drive`?"),
        (
            "message: drive, bytes: AA",
            "{message",
            "the example leaves `speed` of `drive` open; add for example `speed: 0`",
        ),
        ("message: drive, fields: {speed: 0, sped: 1}, bytes: AA", "sped:", "`drive` has no field `sped`"),
        (
            "message: drive, fields: {speed: 2}, bytes: AA",
            "2}",
            "2 does not fit `speed`, which takes values from -1 to 1",
        ),
        ("message: drive, fields: {speed: [1]}, bytes: AA", "[1]", "`speed` is one value; write it without [ and ]"),
        ("message: drive, sender: mcu, fields: {speed: 0}, bytes: AA", "mcu", "`drive` comes from the host"),
        ("message: drive, fields: {speed: 0}", "{message", "an example needs `bytes`; write for example `bytes:"),
        ("message: drive, fields: {speed: 0}, bytes: 10", "10}", "`10` is read as a number; put the bytes in quotes"),
        ("message: drive, fields: {speed: 0}, bytes: AA 5", "AA 5", "`AA 5` is not a frame; write its bytes"),
        ("message: drive, fields: {speed: 0}, bytes: [AA]", "[AA]", "a list is not a frame; write its bytes"),
        ("message: drive, fields: {speed: {a: 1}}, bytes: AA", "{a:", "`speed` is one value; write it without { and }"),
        ("message: state, fields: {" + STATE.replace("hot", "cold") + "}, bytes: AA", "[cold", "`cold` is not a flag"),
        (
            "message: state, fields: {" + STATE.replace("2.5", "2, 3") + "}, bytes: AA",
            "[1",
            "3 elements do not fit `gains`; it has 2",
        ),
        ("message: state, fields: {" + STATE.replace("FF", "FG") + "}, bytes: AA", "01 FG", "`blob` is a byte string"),
        ("message: state, fields: {" + STATE.replace("FF", "FF 02") + "}, bytes: AA", "01 FF 02", "these are 3 bytes"),
        ("message: state, fields: {" + STATE.replace("left", "leftmost") + "}, bytes: AA", "leftmost", "has 8 bytes"),
    ],
)
def test_a_wrong_example_gets_a_sentence_at_its_place(example: str, at: str, sentence: str) -> None:
    text = with_example(example)
    with pytest.raises(ProtocolFileError) as refused:
        loads(text)
    problem = refused.value.problems[0]
    assert sentence in problem.sentence
    assert text.splitlines()[problem.line - 1][problem.column - 1 :].startswith(at)
    assert problem.line == FILE.count("\n") + 2


def test_long_text_that_is_no_frame_is_refused_at_once() -> None:
    with pytest.raises(ProtocolFileError, match="is not a frame"):
        loads(with_example(f'message: drive, fields: {{speed: 0}}, bytes: "{"AA  " * 20_000}X"'))


def test_a_frame_too_long_for_an_example_is_refused() -> None:
    with pytest.raises(ProtocolFileError, match="5000 bytes are too many"):
        loads(with_example(f'message: drive, fields: {{speed: 0}}, bytes: "{"AA" * 5000}"'))


SHAPES = """\
wirebond: 1
protocol: rover
frame: [magic: 0xAA, length: u8, id: u8, payload: by_length, check: xor8]
types: {point: {x: {type: i8}, y: {type: i8, default: 0}}}
messages:
  scan:
    id: 1
    sender: mcu
    fields:
      n:      {type: u8}
      status: {bits: {type: u8, fields: {mode: {type: u3}, armed: {type: bool}}}}
      gap:    {type: padding, size: 1}
      points: {group: {count: n, max: 3, fields: point}}
examples:
  - {message: scan, fields: {status: {mode: 5, armed: true}, points: [{x: 1, y: 2}, {x: -1}]}, bytes: "AA 07"}
"""


def test_an_example_holds_values_within_structs() -> None:
    (example,) = loads(SHAPES).examples
    assert dict(example.values) == {
        "status": {"mode": 5, "armed": True},
        "points": ({"x": 1, "y": 2}, {"x": -1}),
    }


@pytest.mark.parametrize(
    ("old", "new", "at", "sentence"),
    [
        ("{x: -1}", "{y: 3}", "{y: 3}", "the example leaves `x` of `points` open; add for example `x: 0`"),
        ("{x: -1}", "{x: 200}", "200", "200 does not fit `x`, which takes values from -128 to 127"),
        ("{x: -1}", "{x: 0, z: 1}", "z: 1", "`points` has no field `z`; possible: x, y"),
        ("{x: -1}", "5", "5]", "`points` has fields; write a mapping of x, y"),
        ("{mode: 5, armed: true}", "3", "3, points", "`status` has fields; write a mapping of mode, armed"),
        ("mode: 5", "mode: {}", "{}, armed", "`mode` is one value; write it without { and }"),
        ("[{x: 1, y: 2}, {x: -1}]", "{x: 1}", "{x: 1}", "`points` has at most 3 elements; write a list"),
        ("status: {mode", "gap: 0, status: {mode", "gap: 0", "`scan` has no field `gap`"),
    ],
)
def test_wrong_values_within_structs_are_reported_at_their_place(old: str, new: str, at: str, sentence: str) -> None:
    text = SHAPES.replace(old, new)
    line = text.count("\n", 0, text.rindex(at)) + 1
    column = text.rindex(at) - text.rfind("\n", 0, text.rindex(at))
    with pytest.raises(ProtocolFileError) as caught:
        loads(text, "f")
    assert [p for p in str(caught.value).split("\n") if p.startswith(f"f:{line}:{column}: ") and sentence in p]
