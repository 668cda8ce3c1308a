"""Wrong fields within fields: groups, structs, bits, counts. Each names its place. See `wrong_files.py`."""

import pytest
from tests.protocol.wrong_files import marked, problems_of

from wirebond.protocol import loads

SHAPES = """\
wirebond: 1
protocol: rover
frame: [magic: 0xAA, length: u16, id: u8, payload: by_length, check: crc-16/modbus]
types:
  point: {x: {type: i16}, y: {type: i16}}
messages:
  scan:
    id: 1
    sender: mcu
    fields:
      number: {type: u8}
      status: {bits: {type: u8, fields: {mode: {type: u3}, armed: {type: bool}}}}
      rc:     {type: u11, count: 16, packed: low_first}
      gap:    {type: padding, size: 2}
      where:  {struct: point}
      points: {group: {count: number, max: 9, fields: point}}
      name:   {type: text, size: number, max: 9}
      rest:   {group: {count: to_end, max: 4, fields: {a: {type: u8}}}}
"""
NESTED = [
    # types of numbers
    ("number: {type: u8}", "number: {type: @u11}", "u11 is not a whole number of bytes; pack several (`count: 8"),
    ("number: {type: u8}", "number: {type: @s8le}", "`s8le` has no byte order to choose; write `s8`"),
    ("number: {type: u8}", "number: {type: s8, enum: {low: @-128}}", "-128 does not fit s8 (from -127 to 127)"),
    # bit fields
    ("{type: u8, fields: {mode: {type: u3}", "{type: @u8, fields: {mode: {type: u9}", "these fields need 10 bits"),
    ("type: u3}", "type: @u3be}", "`u3be` is not a type of a bit field; possible: u1 to u64"),
    ("type: u3}", "type: @f32}", "`f32` is not a type of a bit field"),
    ("type: u3}", "type: u3, @bits: 3}", "`bits` is not a key of a bit field"),
    ("type: u3}", "type: u3, @size: 3}", "`size` is for text, bytes and padding"),
    ("type: u3}", "type: u3, range: @[0, 9]}", "9 does not fit: u3 carries 0 to 7; narrow the range"),
    ("type: u3}", "type: u3, flags: {a: @3}}", "u3 has no bit 3; its bits are 0 to 2"),
    ("type: u3}", "type: @padding}", "padding needs its number of bits; add `size: 2`"),
    ("bits: {type: u8", "bits: {type: @i8", "`i8` cannot hold bit fields; write u8, u16"),
    ("bits: {type: u8", "bits: {type: u8, first: @top", "possible: low, high"),
    ("fields: {mode: {type: u3}, armed: {type: bool}}", "fields: @{}", "`fields` has too few entries (0)"),
    # constants
    ("type: padding, size: 2", "type: u8, constant: 2, @range: [0, 2]", "`range` cannot be combined with `constant`"),
    ("type: padding, size: 2", "type: u8, constant: @256", "256 does not fit `gap`, which takes values from 0 to 255"),
    ("type: padding, size: 2", "type: f32, @constant: 1", "`constant` is for whole numbers, bool, text and bytes"),
    ("type: padding, size: 2", "type: padding, size: 2, @constant: 1", "for padding write `must_be_zero: true`"),
    ("type: padding, size: 2", "type: u8, @must_be_zero: true", "`must_be_zero` is for padding; for a number write"),
    ("type: padding, size: 2", 'type: text, constant: @""', "this constant has no byte; write it, or remove the field"),
    ("type: padding, size: 2", "type: padding, size: 65, must_be_zero: true", "at most 64 bytes of constants"),
    ("type: u3}", "type: u3, constant: @8}", "8 does not fit `mode`, which takes values from 0 to 7"),
    ("{a: {type: u8}}", "{a: {type: u8, constant: 1}}", "`rest` varies in number, and its elements contain a constant"),
    ("number: {type: u8}", "number: {type: u8, constant: 1}", "`number` cannot count, for it is more than a number"),
    # packed streams and padding
    ("packed: low_first", "packed: @low", "possible: low_first, high_first"),
    ("type: u11, count", "type: @u16be, count", "packed bits have no byte order; write `u16`"),
    ("count: 16, packed", "@packed", "`packed` has no meaning without `count`"),
    ("count: 16, packed", "count: @number, max: 4, packed", "packed elements are always as many"),
    ("type: u11", "type: f32", "`packed` is for whole numbers and bool"),
    ("type: padding, size: 2", "type: @padding", "padding needs its number of bytes; add `size: 2`"),
    ("type: padding, size: 2", "type: padding, size: @number", "padding has always as many bytes"),
    ("type: padding, size: 2", "type: padding, size: 2, @default: 0", "padding has none; remove it"),
    # structs and types
    ("struct: point", "struct: @pint", "there is no type `pint`; did you mean `point`?"),
    ("struct: point", "struct: @3", "is not possible here; write a mapping"),
    ("{struct: point}", "@{struct: point, type: u8}", "`type` and `struct` are two kinds of field; keep one"),
    ("struct: point", "struct: {x: {type: @u9}}", "u9 is not a whole number of bytes"),
    ("y: {type: i16}}", "y: {struct: @point}}", "a type cannot contain itself (`point` in `point`); take it out"),
    ("point: {x: {type: i16}, y: {type: i16}}", "point: @{}", "`point` has too few entries (0)"),
    ("point: {x:", "scan: {x: {type: u8}}\n  point: {x:", "`scan` and `scan` both become `Scan` in C++; rename one"),
    ("{struct: point}", "{@strct: point}", "did you mean `struct`?"),
    # groups and what is counted
    ("{count: number, max: 9, fields: point}", "{count: @nubmer, max: 9, fields: point}", "is called `nubmer`"),
    ("{count: number, max: 9, fields: point}", "{count: @name, max: 9, fields: point}", "is called `name`; possible: "),
    ("{count: number, max: 9, fields: point}", "{count: @rc, max: 9, fields: point}", "`rc` cannot count"),
    ("{count: number, max: 9, fields: point}", "{count: @number, fields: point}", "needs a bound; add `max: 16`"),
    ("{count: number, max: 9, fields: point}", "{count: @number, max: 256, fields: point}", "`number` counts to 255"),
    ("{count: number, max: 9, fields: point}", "{count: 3, @max: 9, fields: point}", "for a number that varies"),
    ("points: {group: {count: number", "@points: {group: {count: to_end", "`points` reaches to the payload's end"),
    ("fields: {a: {type: u8}}", "@fields: {a: {type: text, max: 3}}", "leaves no room for another"),
    (
        "fields: {a: {type: u8}}",
        "fields: {a: {type: u8, count: @number, max: 3}}",
        "no earlier field beside this one is called `number`",
    ),
    ("size: number, max: 9", "size: @to_end, max: 9", "a string reaches to the payload's end by itself"),
    ("size: number, max: 9", "size: @number", "a varying number of bytes needs a bound"),
    ("number: {type: u8}", "number: {type: u8, scale: 2}", "`number` cannot count, for it is more than a number"),
    ("gap:", "many: {type: u16, count: @number}\n      gap:", "a varying number of elements needs a bound"),
    ("gap:", "many: {type: u16, count: 3, @max: 4}\n      gap:", "`max` is for a number that varies"),
    (
        "{count: number, max: 9, fields: point}",
        "{count: @{}, max: 9, fields: point}",
        "the number of elements is not given",
    ),
    (
        "{count: number, max: 9, fields: point}",
        "{count: {bytes: @3}, max: 9, fields: point}",
        "`3` is not a field that counts",
    ),
    (
        "{count: number, max: 9, fields: point}",
        "{count: {size: number}, max: 9, fields: point}",
        "not a key of `count`",
    ),
    ("{count: number, max: 9, fields: point}", "{count: {bytes: @rc}, max: 9, fields: point}", "`rc` cannot count"),
    (
        "{count: number, max: 9, fields: point}",
        "{count: {bytes: @number, elements: number}, max: 9, fields: point}",
        "`number` cannot count both elements and bytes",
    ),
    (
        "{count: number, max: 9, fields: point}",
        "{count: {bytes: @number}, max: 64, fields: point}",
        "`number` counts to 255, and `max` is 64, of 4 bytes each; lower that, or take a wider type",
    ),
    (
        "{count: number, max: 9, fields: point}",
        "{count: @status, max: 9, fields: point}",
        "`status` is shared by several values, and one of them can count; write `status.mode` or `status.armed`",
    ),
    ("{count: number, max: 9, fields: point}", "{count: @status.mde, max: 9, fields: point}", "is called `mde`; write"),
    (
        "{count: number, max: 9, fields: point}",
        "{count: @status.armed, max: 1, fields: point}",
        "`status.armed` cannot",
    ),
    (
        "{count: number, max: 9, fields: point}",
        "{count: @status.mode, max: 9, fields: point}",
        "counts to 7, and `max`",
    ),
    ("{count: number, max: 9, fields: point}", "{count: @number.low, max: 9, fields: point}", "is called `number.low`"),
    ("size: number, max: 9", "size: @{bytes: number}, max: 9", "does not say how many"),
    (
        "{count: number, max: 9, fields: point}",
        "{count: {bytes: number}, max: 9, fields: point}",
        "`number` counts `points` already, and a field that counts bytes cannot count anything else",
    ),
    (
        "{count: to_end, max: 4, fields: {a: {type: u8}}}",
        "{count: {bytes: @number}, max: 4, fields: {b: {type: u8}, a: {type: text, max: 3, ends_with: 0x00}}}",
        "each of these elements has its own size, so their number does not follow from bytes",
    ),
    (
        "{count: number, max: 9, fields: point}",
        "{count: {elements: number, asked_by: much}, max: 9, fields: point}",
        "no message has the reply `scan`, so no request asks; write `reply: scan` in the request",
    ),
    ("number: {type: u8}", "number: {type: u8, @counts: points}", "the counted field names its count"),
    ("type: u3}", "type: u3, @counts: points}", "for a value among bits `count: state.number`"),
    # defaults
    ("type: u11, count: 16", "type: u11, count: 16, default: @[1, 2]", "2 elements do not fit `rc`; it has 16"),
    ("type: u11, count: 16", "type: u11, count: 16, default: @2048", "2048 does not fit `rc`, which takes values"),
    ("number: {type: u8}", "number: {type: u8, default: @[1]}", "`number` is one value; write it without [ and ]"),
    ("gap:", "key: {type: bytes, size: 2, default: @55}\n      gap:", "write its bytes as 0xAA 0x55"),
    ("gap:", "key: {type: bytes, size: 1, default: @0x01 0x02}\n      gap:", "`key` has room for 1"),
    ("gap:", "on: {type: u8, flags: {a: 0}, default: @[b]}\n      gap:", "`b` is not a flag of `on`"),
]


SHAPES_SIZE = 1 + 1 + 22 + 2 + 4 + 36 + 9 + 4


def test_the_file_of_shapes_that_the_table_spoils_is_good() -> None:
    assert loads(SHAPES).message("scan").max_payload == SHAPES_SIZE


@pytest.mark.parametrize(("old", "new", "fragment"), NESTED)
def test_wrong_fields_within_fields_are_reported_at_their_place(old: str, new: str, fragment: str) -> None:
    assert SHAPES.count(old) == 1, old
    text = SHAPES.replace(old, new)
    if "@" in text:
        text, place = marked(text)
        assert [line for line in problems_of(text) if line.startswith(f"{place}: ") and fragment in line]
    else:
        assert [line for line in problems_of(text) if fragment in line]


def test_a_message_varies_only_if_the_frame_gives_its_size() -> None:
    by_id = SHAPES.replace("length: u16, id: u8, payload: by_length", "id: u8, payload: by_id")
    assert [line for line in problems_of(by_id) if "`rest` reaches to the payload's end" in line]
    counted = by_id.replace("      rest:", "      more: {type: u8}\n#")
    assert loads(counted).message("scan").max_payload == SHAPES_SIZE - 4 + 1
    ended = counted.replace("size: number, max: 9", "ends_with: 0x00, max: 9")
    assert [
        line
        for line in problems_of(ended)
        if "`name` varies in size, and no count of the message gives its size" in line
    ]
    fixed = SHAPES.replace("length: u16, id: u8, payload: by_length", "id: u8, payload: 90")
    assert [line for line in problems_of(fixed) if "`rest` reaches to the payload's end" in line]


def test_a_request_has_the_field_that_its_reply_names() -> None:
    asking = "  ask: {id: 2, sender: host, reply: scan, fields: {many: {type: u8}}}\n"
    text = SHAPES.replace("{count: number", "{count: {elements: number, asked_by: many}") + asking
    assert loads(text).message("scan").fields[5].asked_by == "many"
    for wrong in ("much: {type: u8}", "many: {type: f32}", "many: {type: u8, scale: 2}"):
        told = problems_of(text.replace("many: {type: u8}", wrong))
        assert [line for line in told if "`ask`, which asks for this reply, has no whole number `many`" in line]
    inner = SHAPES.replace(
        "{group: {count: number", "{struct: {n: {type: u8}, of: {group: {count: {elements: n, asked_by: many}"
    )
    inner = inner.replace("max: 9, fields: point}}", "max: 9, fields: point}}}}") + asking
    assert [line for line in problems_of(inner) if "a list in the message itself" in line]


def test_types_that_multiply_are_refused_before_they_fill_the_memory() -> None:
    types = "".join(f"  t{n}: {{{', '.join(f'f{i}: {{struct: t{n - 1}}}' for i in range(9))}}}\n" for n in range(1, 30))
    text = SHAPES.replace("types:\n", "types:\n  t0: {x: {type: u8}}\n" + types)
    assert [line for line in problems_of(text) if "values, those of structs included; at most 1000" in line]


@pytest.mark.parametrize("step", [1, -1])
def test_types_that_lie_too_deep_are_refused_in_either_order(step: int) -> None:
    types = [f"  t{n}: {{f: {{struct: t{n - 1}}}}}\n" for n in range(1, 3000)]
    text = SHAPES.replace("types:\n", "types:\n  t0: {x: {type: u8}}\n" + "".join(types[::step]))
    assert [line for line in problems_of(text) if "deep" in line and ("at most 8" in line or "more than 8" in line)]
