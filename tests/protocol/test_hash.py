"""A protocol's hash changes with what bytes mean, and with nothing else."""

import pytest

from wirebond.protocol import loads, protocol_hash

TEXT = """\
wirebond: 1
protocol: rover
frame:
  - magic: 0xAA 0x55
  - length: u16
  - id: u8
  - payload: by_length
  - check: crc-16/modbus
  - tail: 0x0D
messages:
  drive:
    id: 0x01
    sender: host
    fields:
      speed: {type: i16, scale: 0.001}
      mode:  {type: u8, enum: {idle: 0, manual: 1}}
      lamps: {type: u8, flags: {left: 0, right: 1}}
  ask: {id: 0x02, sender: host, fields: {number: {type: u8}}}
  tell: {id: 0x03, sender: mcu, fields: {number: {type: u8}}}
services: {ping: {request: ask, reply: tell}}
"""


def changed(*edits: tuple[str, str]) -> int:
    text = TEXT
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new)
    return protocol_hash(loads(text))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("0xAA 0x55", "0xAA 0x56"),
        ("length: u16", "length: u8"),
        ("length: u16", "length: u16be"),
        ("length: u16", "length: {type: u16, counts: rest}"),
        ("length: u16", "length: {type: u16, offset: 1}"),
        ("crc-16/modbus", "crc-16/arc"),
        ("crc-16/modbus", "{type: crc-16/modbus, over: id..payload}"),
        ("crc-16/modbus", "{type: crc-16/modbus, byte: low}"),
        ("crc-16/modbus", "{type: crc-16/modbus, byte_order: big}"),
        ("id: 0x01", "id: 0x11"),
        ("sender: host\n", "sender: both\n"),
        ("speed:", "pace:"),
        ("type: i16", "type: u16"),
        ("type: i16", "type: i16be"),
        ("type: i16", "type: i16, count: 2"),
        ("scale: 0.001", "scale: 0.01"),
        ("scale: 0.001", "scale: 0.001, offset: 1"),
        ("manual: 1", "manual: 2"),
        ("right: 1", "right: 2"),
        ("byte_order: big\n", ""),
        ("  drive:", "  go:"),
        ("services: {ping: {request: ask, reply: tell}}\n", ""),
    ],
)
def test_the_meaning_of_bytes_changes_the_hash(old: str, new: str) -> None:
    if old == "byte_order: big\n":
        assert changed(("protocol: rover", "protocol: rover\nbyte_order: big")) != changed()
    else:
        assert changed((old, new)) != changed()


@pytest.mark.parametrize("rule", ["counts: rest", "offset: 1", "unit: 2"])
def test_the_meaning_of_a_counted_run_of_bits_changes_the_hash(rule: str) -> None:
    text = (
        "wirebond: 1\nprotocol: rover\nframe: [magic: 0x01, {bits: u8, fields: {id: 3, length: 5}}, "
        "payload: by_length]\nmessages: {one: {id: 1, sender: host, fields: {x: u16}}}\n"
    )
    assert protocol_hash(loads(text)) != protocol_hash(loads(text.replace("length: 5}", f"length: 5}}, {rule}")))


def test_swapped_fields_change_the_hash() -> None:
    speed, mode = (
        "      speed: {type: i16, scale: 0.001}\n",
        "      mode:  {type: u8, enum: {idle: 0, manual: 1}}\n",
    )
    assert changed((speed + mode, mode + speed)) != changed()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (
            "protocol: rover",
            "protocol: other\ndescription: words\nlink: {baud: 9600}\nidle: 5 ms\nmax_payload: 99",
        ),
        ("protocol: rover", "protocol: rover\nunknown: reject"),
        ("scale: 0.001", "scale: 1e-3, unit: m/s, description: words, range: [-1, 1], default: 0"),
        ("idle: 0, manual: 1", "manual: 1, idle: 0"),
        ("left: 0, right: 1", "right: 1, left: 0"),
        ("type: i16", "type: i16le"),
        ("magic: 0xAA 0x55", "magic: 0xaa 0x55\n    name: start"),
        ("crc-16/modbus", "{type: crc, width: 16, poly: 0x8005, init: 0xFFFF, refin: true, refout: true}"),
        ("crc-16/modbus", "modbus"),
        ("id: 0x01", "id: 1"),
        ("sender: host\n", "sender: host\n    every: 1 s\n    description: words\n"),
        ("sender: host\n", "sender: host\n    queue: latest\n"),
    ],
)
def test_changes_that_bytes_do_not_show_leave_the_hash_alone(old: str, new: str) -> None:
    assert changed((old, new)) == changed()


def test_the_order_of_messages_leaves_the_hash_alone() -> None:
    ask, tell = (line + "\n" for line in TEXT.split("\n") if line.startswith(("  ask", "  tell")))
    assert changed((ask + tell, tell + ask)) == changed()


def test_the_hash_is_the_same_in_every_release() -> None:
    """A change of this number breaks the hello of every link whose two ends have different releases."""
    assert changed() == 0x4C55EC6D0FE43009


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
      trim:   {type: i16}
      points: {group: {count: number, max: 9, fields: point}}
"""


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("mode: {type: u3}", "mode: {type: u4}"),
        ("mode: {type: u3}", "mode: {type: i3}"),
        ("mode: {type: u3}", "mood: {type: u3}"),
        ("{bits: {type: u8,", "{bits: {type: u16,"),
        ("{bits: {type: u8,", "{bits: {type: u8, first: high,"),
        ("low_first", "high_first"),
        ("type: u11", "type: u12"),
        ("type: padding, size: 2", "type: padding, size: 3"),
        ("type: i16}\n      points", "type: s16}\n      points"),
        ("x: {type: i16}", "x: {type: u16}"),
        ("count: number, max: 9", "count: to_end, max: 9"),
        ("count: number, max: 9", "count: 9"),
        ("count: number, max: 9", "count: number, max: 8"),
    ],
)
def test_how_fields_lie_together_changes_the_hash(old: str, new: str) -> None:
    assert SHAPES.count(old) == 1, old
    assert protocol_hash(loads(SHAPES.replace(old, new))) != protocol_hash(loads(SHAPES))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("fields: point", "fields: {x: {type: i16}, y: {type: i16}}"),
        ("gap: ", "hole: "),
        ("first", "first, description: words"),
        ("mode: {type: u3}", "mode: {type: u3, default: 1, range: [0, 5]}"),
    ],
)
def test_names_of_types_and_padding_leave_the_hash_alone(old: str, new: str) -> None:
    assert protocol_hash(loads(SHAPES.replace(old, new))) == protocol_hash(loads(SHAPES))


def test_the_meaning_of_a_count_is_in_the_hash_and_its_notation_is_not() -> None:
    text = """
wirebond: 1
protocol: counted
frame: [magic: 0xA5, length: u8, id: u8, payload: by_length, check: crc-8/smbus]
messages:
  ask: {id: 1, sender: host, reply: told, fields: {many: {type: u8}}}
  told:
    id: 2
    sender: mcu
    fields: {n: {type: u8}, size: {type: u8}, v: {type: u16, count: n, max: 4}, w: {type: u8, count: n, max: 4}}
"""
    first = protocol_hash(loads(text))

    def hash_with(count: str) -> int:
        return protocol_hash(loads(text.replace("u16, count: n", f"u16, count: {count}")))

    assert hash_with("{elements: n}") == hash_with("{elements: n, asked_by: many}") == first
    others = {hash_with("{bytes: size}"), hash_with("size"), hash_with("{elements: n, bytes: size}")}
    assert len(others) == 3
    assert first not in others
    one_byte = text.replace("w: {type: u8, count: n", "w: {type: u8, count: {bytes: n}")
    assert protocol_hash(loads(one_byte)) == first
