"""Wrong frame formats, and messages that do not fit theirs: each names its place. See `wrong_files.py`."""

import pytest
from tests.protocol.wrong_files import marked, problems_of

from wirebond.protocol import loads

FRAMES = [
    (
        "magic: 0x01, id: u8, payload: @by_length",
        "needs a length; add a part such as `- length: u8` before it",
    ),
    ("id: u8, payload: @rest, check: crc-16/modbus", "needs delimiters"),
    ("magic: 0x01, payload: by_id, @id: u8", "the id must precede the payload, because it determines its size"),
    ("magic: 0x01, id: u8, payload: by_length, @length: u8", "the length must precede the payload"),
    ("magic: 0x01, id: u8, @length: u8, payload: 20", "this length is not used"),
    ("magic: 0x01, id: u8, @id: u8, payload: 20", "a frame has one `id` part at most"),
    ("magic: 0x01, id: u8, payload: 20, @payload: 20", "a frame has one `payload` part at most"),
    ("id: u8, @magic: 0x01, payload: 20", "a magic begins the frame; put it first"),
    ("id: u8, @tail: 0x01, payload: 20", "a tail ends the frame; put it last"),
    ("@check: xor8, id: u8, payload: 20", "nothing precedes this check"),
    ("id: u8, payload: 20, check: {type: xor8, over: @ids..payload}", "no part `ids`; did you mean `id`?"),
    ("id: u8, payload: 20, check: {type: xor8, over: @payload..id}", "write `id..payload`"),
    ("id: u8, payload: 20, check: {type: xor8, over: @id..check}", "a check cannot cover itself"),
    (
        "constant: 0x01, constant: 0x02, id: u8, payload: 20, check: {type: xor8, over: @constant..payload}",
        "2 parts are called `constant`; give the one that is meant a `name:`",
    ),
    ("id: u8, payload: 20, check: {type: xor8, @byte: high}", "a check of 8 bits has one byte"),
    ("id: u8, payload: 20, check: {type: crc-16/modbus, @poly: 0x8005}", "has its own `poly`; remove this"),
    ("id: u8, payload: 20, check: {@type: crc, width: 16}", "a CRC of your own needs `poly`"),
    ("id: u8, payload: 20, check: {@type: sum}", "`sum` needs `width`; or name one: sum8, sum16, sum32"),
    ("id: u8, payload: 20, check: {type: sum, width: @33}", "a check of this kind has 1 to 32 bits"),
    ("id: u8, payload: 20, check: {type: crc, width: @2, poly: 3}", "a check of this kind has 3 to 64 bits"),
    ("id: u8, payload: 20, check: {type: fletcher, width: @24}", "Fletcher's two sums have 8, 16 or 32 bits together"),
    ("id: u8, payload: 20, check: {type: sum8-inverted, @xorout: 1}", "`sum8-inverted` has its own `xorout`"),
    ("id: u8, payload: 20, check: {type: sum8, @width: 7}", "`sum8` has its own `width`"),
    ("id: u8, payload: 20, check: {type: sum8-negated, @sums_to: 5}", "`sum8-negated` has its own `sums_to`"),
    ("id: u8, payload: 20, check: {type: xor8, @carry: end_around}", "only a sum has `carry`; remove it"),
    ("id: u8, payload: 20, check: {type: xor8, @modulo: 9}", "only a sum or Fletcher's has `modulo`; remove it"),
    ("id: u8, payload: 20, check: {type: xor8, @poly: 9}", "only a CRC has `poly`; remove it"),
    (
        "id: u8, payload: 20, check: {type: sum8, sums_to: 1, @plus: 9}",
        "`plus` cannot be combined with `sums_to`; remove one of them",
    ),
    ("id: u8, payload: 20, check: {type: sum8, @odd: xor}", "`odd` is about words; add `unit: 2` or `unit: 4`"),
    ("id: u8, payload: 20, check: {type: sum8, mask: @0x1FF}", "0x1ff has more than 8 bits; write at most 0xff"),
    ("id: u8, payload: 20, check: {type: sum8, modulo: @300}", "8 bits hold less; write at most 256"),
    ("id: u8, payload: 20, check: {type: sum8, modulo: 100, @init: 100}", "a sum modulo 100 begins below that"),
    ("id: u8, payload: 20, check: {type: crc-64/xz, @unit: 2}", "a check over words has at most 32 bits"),
    ("id: u8, payload: 20, check: {type: xor8, @unit: 2}", "8 bits do not hold words of 16; write `unit: 1`"),
    ("id: u8, payload: 20, check: {type: crc-32, unit: 4, @odd: xor}", "a CRC has no `odd: xor`"),
    ("id: u8, payload: 20, check: {type: xor8, @bcd: true}", "only a sum has `bcd`; remove it"),
    (
        "id: u8, payload: 20, check: {type: sum, width: 10, @bcd: true}",
        "10 are not a multiple of that; write `width: 12`",
    ),
    (
        "id: u8, payload: 20, check: {type: sum16, @avoid: {values: 0x0D, plus: 1}}",
        "only a check of up to 8 bits, sent as a byte, has values to avoid; remove `avoid`",
    ),
    (
        "id: u8, payload: 20, check: {type: sum8, text: hex, @avoid: {values: 0x0D, plus: 1}}",
        "only a check of up to 8 bits, sent as a byte, has values to avoid; remove `avoid`",
    ),
    (
        "id: u8, payload: 20, check: {type: sum8, @avoid: {values: 0x0D, plus: 0x100}}",
        "the check has 8 bits; write values and `plus` of at most 0xff",
    ),
    (
        "id: u8, payload: 20, check: {type: sum8, @avoid: {values: 0x0A..0x0D, plus: 1}}",
        "0xa becomes 0xb, which is to be avoided, too; write another `plus`",
    ),
    (
        "id: u8, payload: 20, check: {type: sum8, avoid: {values: @0x0D..0x0A, plus: 1}}",
        "`0x0D..0x0A` is not a range of byte values; write one such as 0..0x1F",
    ),
    (
        "id: u8, payload: 20, check: {type: sum8, avoid: {values: @CR, plus: 1}}",
        "`CR` is not a byte's value; write one, or a range such as 0..0x1F",
    ),
    (
        "id: u8, payload: 20, check: {type: sum8, avoid: {values: @[1, 2, 3, 4, 5], plus: 8}}",
        "this list has 5 entries; write 1 to 4 values or ranges",
    ),
    ("id: u8, payload: 20, check: {type: crc, width: 8, poly: @0x107}", "0x107 has more than 8 bits"),
    ("id: u8, payload: 20, check: {type: crc, width: 16, poly: @0x8408}", "a CRC's polynomial is odd"),
    (
        "@check: {type: crc-16/modbus, over: id..tail_check}, id: u8, payload: 20, check: "
        "crc-16/modbus, name: tail_check",
        "covers a later one (line 4) whose value is not known yet",
    ),
    (
        "magic: 0x01, id: u8, @length: {type: u8, counts: frame, offset: -30}, payload: by_length",
        "would have a negative length",
    ),
    (
        "magic: 0x01, id: u8, @length: {type: u8, offset: 300}, payload: by_length",
        "cannot express its count",
    ),
    ("magic: 0x01, name: @payload, id: u8, payload: 20", "is the word for another kind of part"),
    ("magic: 0x01, name: a, id: u8, name: @a, payload: 20", "another part is named `a`"),
    ("@cobs: [id: u8, payload: rest, check: crc-16/modbus]", "stuffing needs a delimiter before and after it"),
    ("@delimiter: 0x00, id: u8, payload: 20", "delimiters are the first and the last part of a frame"),
    ("delimiter: @0x7E, cobs: [id: u8, payload: rest], delimiter: 0x00", "COBS frees a frame of 0x00"),
    ("delimiter: 0x00, cobs: [id: u8], @payload: 20, delimiter: 0x00", "the payload must be among the stuffed parts"),
    ("delimiter: 0x00, @constant: 0xA5 0x00, cobs: [id: u8, payload: 20], delimiter: 0x00", "holds the delimiter 0x00"),
    (
        "delimiter: 0x0D 0x0A, id: u8, payload: 20, @constant: 0x0D 0x0A, delimiter: 0x0D 0x0A",
        "every frame is cut here",
    ),
    (
        "delimiter: 0x00, cobs: [id: u8, payload: 20], check: @{type: sum8, over: payload}, delimiter: 0x00",
        "its range covers all of them or none",
    ),
    (
        "delimiter: 0x00, cobs: [id: u8, payload: rest, @delimiter: 0x00], delimiter: 0x00",
        "`delimiter` cannot be a stuffed part",
    ),
    (
        "delimiter: 0x00, cobs: [id: u8, payload: rest], @cobs: [id: u8], delimiter: 0x00",
        "a frame has one group of stuffed parts",
    ),
]


def test_beside_stuffed_parts_nothing_is_optional() -> None:
    text = """
wirebond: 1
protocol: rover
frame:
  - delimiter: 0x00
  - {bits: u8, fields: {flags: 8}}
  - cobs: [id: u8, payload: rest]
  - {constant: 0x05, when: flags & 0x01}
  - delimiter: 0x00
messages: {one: {id: 1, sender: host}}
"""
    assert [line for line in problems_of(text) if "beside stuffed parts a part is always there" in line]


def frame_of(parts: str) -> str:
    """`a: 1, name: x, b: 2` as a list of parts, one for each key but `name`, all in one line."""
    entries: list[str] = []
    depth, begin = 0, 0
    for index, letter in enumerate(parts + ","):
        depth += (letter in "[{") - (letter in "]}")
        if letter == "," and depth == 0:
            entry = parts[begin:index].strip()
            begin = index + 1
            if entry.startswith("name:"):
                entries[-1] += f", {entry}"
            else:
                entries.append(entry)
    # A mark stays in front of the mapping that it marks.
    items = ", ".join("@{" + entry[1:] + "}" if entry[0] == "@" else "{" + entry + "}" for entry in entries)
    return f"wirebond: 1\nprotocol: rover\n\nframe: [{items}]\nmessages: {{one: {{id: 1, sender: host}}}}\n"


@pytest.mark.parametrize(("parts", "fragment"), FRAMES)
def test_a_frame_that_cannot_be_read_is_reported_at_the_part(parts: str, fragment: str) -> None:
    text, place = marked(frame_of(parts).replace("[@delimiter", "[@{delimiter"))
    assert [line for line in problems_of(text) if line.startswith(f"{place}: ") and fragment in line]


@pytest.mark.parametrize(
    ("frame", "fragment"),
    [
        ("[magic: 0x01, id: u8]", "4:8: the frame has no payload"),
        ("[id: u8, payload: 20]", "4:8: nothing distinguishes this frame from other bytes"),
        (
            "[magic: 0x73, {bits: u8, fields: {flags: 4, length: {bits: 4, unit: 4}}}, id: u8, payload: by_length]",
            "4:60: the unit of a length belongs to the whole part; write `unit` beside",
        ),
        (
            "[{bits: u8, fields: {a: {bits: 7, constant: 0x25}, b: 1}}, id: u8, payload: 20]",
            "4:8: nothing distinguishes this frame from other bytes",
        ),
        (
            "[magic: 0x01, id: u8, payload: 20" + ", check: xor8" * 5 + "]",
            "4:8: the frame has 5 checks; at most 4",
        ),
        (
            "[constant: 0x01" + " 0x01" * 15 + ", id: u8, payload: 20, tail: 0x01]",
            "4:8: the frame has 17 bytes of",
        ),
        ("[]", "4:8: `frame` has too few entries (0)"),
        (
            "[" + ", ".join(["reserved: 1"] * 33) + "]",
            "4:8: `frame` has too many entries (33); it takes at most 32",
        ),
    ],
)
def test_a_frame_that_is_wrong_as_a_whole_is_reported_at_its_beginning(frame: str, fragment: str) -> None:
    text = f"wirebond: 1\nprotocol: rover\n\nframe: {frame}\nmessages: {{one: {{id: 1, sender: host}}}}\n"
    assert [line for line in problems_of(text) if line.startswith(f"rover.yaml:{fragment}")]


ONE_MESSAGE = "wirebond: 1\nprotocol: rover\n{extra}\nframe: [{frame}]\nmessages:\n  one:\n    {message}\n"


@pytest.mark.parametrize(
    ("extra", "frame", "message", "expected"),
    [
        (
            "",
            "magic: 0x01, payload: 2",
            "{id: 1, sender: host}",
            "7:6: the frame has no `id` part; remove this id",
        ),
        (
            "",
            "magic: 0x01, id: u8, payload: 2",
            "{sender: host}",
            "6:3: `one` needs an id, for the frame has one",
        ),
        (
            "",
            "magic: 0x01, id: u8, payload: 2",
            "{id: 1, sender: host, fields: {a: {type: u32}}}",
            "6:3: `one` has up to 4 payload bytes; this frame carries 2",
        ),
        (
            "",
            "magic: 0x01, id: u8, length: u8, payload: by_length",
            "{id: 1, sender: host, fields: {a: {type: u32, count: 64}}}",
            "6:3: `one` has up to 256 payload bytes; the frame's length can express 255 at most",
        ),
        (
            "",
            "magic: 0x01, id: u8, length: {type: u8, counts: frame}, payload: by_length, check: crc-16/modbus",
            "{id: 1, sender: host, fields: {a: {type: bytes, max: 251}}}",
            "6:3: `one` has up to 251 payload bytes; the frame's length can express 250 at most",
        ),
        (
            "max_payload: 3",
            "magic: 0x01, id: u8, length: u8, payload: by_length",
            "{id: 1, sender: host, fields: {a: {type: u32}}}",
            "6:3: `one` has up to 4 payload bytes; `max_payload` is 3",
        ),
        (
            "max_payload: 256",
            "magic: 0x01, id: u8, length: u8, payload: by_length",
            "{id: 1, sender: host}",
            "3:14: the frame's length can express 255 payload bytes at most",
        ),
        (
            "max_payload: 9",
            "magic: 0x01, id: u8, payload: 2",
            "{id: 1, sender: host}",
            "3:14: every payload has 2 bytes in this frame; remove `max_payload`",
        ),
        (
            "",
            "magic: 0x01, id: u8, payload: 9",
            "{id: 1, sender: host, fields: {a: {type: text, max: 9}}}",
            "7:36: `a` reaches to the payload's end, but this frame does not show where that is",
        ),
        (
            "unknown: deliver",
            "magic: 0x01, id: u8, payload: by_id, check: crc-32",
            "{id: 1, sender: host}",
            "3:10: with `payload: by_id` the size of an unknown message is not known",
        ),
        (
            "",
            "magic: 0x01, id: u8, payload: 2",
            "{id: 1, sender: host}\n  two:\n    {id: 1, sender: host}",
            "9:10: the host sends `one` (line 6) under id 0x01 already; take another id",
        ),
        (
            "",
            "magic: 0x01, payload: 2",
            "{sender: host}\n  two:\n    {sender: host}",
            "8:3: without an `id` part the frame can carry one message from the host, which is `one` (line 6); add "
            "`- id: u8` to the frame, or name `two` as the `reply` of its request",
        ),
        (
            "",
            "magic: {host: 0x01, mcu: 0x02}, {id: u8, when: magic == 0x01}, payload: by_id",
            "{id: 1, sender: host, reply: two}\n  two:\n    {id: 1, sender: mcu}",
            "9:6: the frame of the MCU has no `id` part; remove this id",
        ),
        (
            "",
            "magic: {host: 0x01, mcu: 0x02}, {id: u8, when: magic == 0x01}, payload: by_id",
            "{sender: host}",
            "6:3: `one` needs an id, for the frame has one",
        ),
        (
            "",
            "magic: 0x01, id: u8, payload: 2, check: {type: crc-16/modbus, seed: message}",
            "{id: 1, sender: mcu, seed: 1}\n  two:\n    {id: 1, sender: mcu, seed: 2}\n  ask:\n"
            "    {id: 1, sender: host, reply: two}",
            "8:3: `two` and `one` (line 6) share their id; give both the same `seed`",
        ),
    ],
)
def test_messages_that_do_not_fit_their_frame_are_reported(extra: str, frame: str, message: str, expected: str) -> None:
    text = ONE_MESSAGE.format(extra=extra, frame=frame, message=message)
    assert [line for line in problems_of(text) if line.startswith(f"rover.yaml:{expected}")]


def test_the_same_id_may_mean_a_message_in_each_direction() -> None:
    message = "{id: 1, sender: host}\n  two:\n    {id: 1, sender: mcu}"
    protocol = loads(ONE_MESSAGE.format(extra="", frame="magic: 0x01, id: u8, payload: 2", message=message))
    assert [m.id for m in protocol.messages] == [1, 1]
