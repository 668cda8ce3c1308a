"""Wrong protocol files: each names the exact place, what is wrong, and what would be right.

In the tables `@` marks the place that the error must name; it is taken out before the file is read.
"""

import pytest

from wirebond.protocol import ProtocolFileError, loads

GOOD = """\
wirebond: 1
protocol: rover
link: {baud: 115200}
frame:
  - magic: 0xAA 0x55
  - length: u8
  - id: u8
  - payload: by_length
  - check: crc-16/modbus
messages:
  drive:
    id: 0x01
    sender: host
    every: 50 ms
    reply: state
    fields:
      speed: {type: i16, unit: m/s, scale: 0.001, range: [-2.0, 2.0], on_range: clamp}
      mode:  {type: u8, enum: {idle: 0, manual: 1}}
  state:
    id: 0x81
    sender: mcu
    fields:
      faults: {type: u8, flags: {stalled: 0, hot: 1}}
      note:   {type: text, max: 8}
deadlines:
  - {message: drive, at: mcu, after: 1 s, then: stop}
emergency_stop: {message: drive, speed: 0, mode: idle}
"""


def problems_of(text: str) -> list[str]:
    with pytest.raises(ProtocolFileError) as caught:
        loads(text, "rover.yaml")
    return str(caught.value).split("\n")


def marked(text: str) -> tuple[str, str]:
    """The text without its marks, and the place of the first one as an error prints it."""
    before = text[: text.index("@")]
    place = f"rover.yaml:{before.count(chr(10)) + 1}:{len(before) - before.rfind(chr(10))}"
    return text.replace("@", ""), place


def edited(old: str, new: str) -> str:
    assert GOOD.count(old) == 1, old
    return GOOD.replace(old, new)


def test_the_file_that_the_tables_spoil_is_good() -> None:
    assert loads(GOOD).name == "rover"


SYNTAX = [
    # keys
    ("wirebond: 1\n", "@", "a protocol file needs `wirebond`; write for example `wirebond: 1`"),
    ("wirebond: 1", "wirebond: @2", "write `wirebond: 1`, or update Wirebond"),
    ("wirebond: 1", "wirebond: @true", "write `wirebond: 1`"),
    ("link:", "@lnk:", "`lnk` is not a key of a protocol file; did you mean `link`? (possible: wirebond, "),
    ("{baud: 115200}", "{baud: 115200, @stopbits: 2}", "did you mean `stop_bits`? (possible: baud, "),
    ("link: {baud: 115200}", "@link:", "`link` has no value; write for example `link: {baud: 115200}`"),
    ("    sender: mcu\n", "", "a message needs `sender`; write for example `sender: host`"),
    ("    every: 50 ms", "    @evry: 50 ms", "did you mean `every`?"),
    ("max: 8", "max: 8, @length: 3", "`length` is not a key of a field; "),
    # values
    (
        "rover",
        "@Rover",
        "`Rover` cannot be a protocol's name, because it becomes a namespace and names of files: lower case, a "
        "letter first; write `rover`",
    ),
    ("rover", "@std", "becomes a namespace"),
    ("baud: 115200", "baud: @fast", "`fast` is not a whole number; write one from 50 to"),
    ("baud: 115200", "baud: @1.5e400", "is not a whole number"),
    ("baud: 115200", "baud: @10", "`10` is out of range; write a whole number from 50 to"),
    ("baud: 115200", "data_bits: @7", "bytes of 8 bits; write 8"),
    ("baud: 115200", "parity: @evn", "did you mean `even`? (possible: none, even, odd)"),
    ("baud: 115200", "stop_bits: @3", "write 1, 1.5 or 2"),
    ("{baud: 115200}", "@[115200]", "a list cannot stand for `link`; write a mapping with the keys baud,"),
    ("{baud: 115200}", "{baud: 115200}\nbyte_order: @network", "possible: little, big"),
    ("{baud: 115200}", "{baud: 115200}\nunknown: @ignore", "possible: deliver, reject"),
    ("{baud: 115200}", "{baud: 115200}\nidle: @20", "`20` has no unit; write a number and a unit"),
    ("{baud: 115200}", "{baud: 115200}\nidle: @20 Hz", "is a rate, and a duration belongs here"),
    ("{baud: 115200}", "{baud: 115200}\ndescription: @5", "`5` is not text here; put it in quotes"),
    ("every: 50 ms", "every: @50", "`50` has no unit; write a number and a unit: `50 ms`"),
    ("every: 50 ms", "every: @50 min", "`min` is not a unit of time"),
    ("every: 50 ms", "every: @0 Hz", "`0 Hz` means never; leave the key out"),
    ("every: 50 ms", "every: @1 Hzz", "`Hzz` is not a unit of time"),
    ("every: 50 ms", "every: @9999 s", "possible are 1 us to 2147 s"),
    ("every: 50 ms", "queue: @newest", "`newest` is not possible here; possible: normal, urgent, latest"),
    ("sender: mcu", "sender: mcu\n    log: hot\n    level: @warn", "did you mean `warning`?"),
    ("{baud: 115200}", "{max_age: @31 s}", "frames can wait for 1 ms to 30 s"),
    ("{baud: 115200}", "{max_run: @1}", "`1` has no unit"),
    ("every: 50 ms", "every: @often", "`often` is not a duration"),
    ("0x01", "@one", "the id has no named values; write a number where `one` stands"),
    ("0x01", "@-1", "`-1` is out of range"),
    ("sender: host", "sender: @hots", "did you mean `host`?"),
    ("sender: host", "sender: @3", "`3` is not possible here; write host, mcu or both"),
    ("type: i16", "type: @int16_t", "`int16_t` is not a type here; write `i16`"),
    (
        "text, max",
        "@char, max",
        "`char` is not a type here; write `text` for letters (`size: 8`), or `u8` for a number",
    ),
    ("type: i16", "type: @float", "`float` is not a type here; write `f32`"),
    ("type: i16", "type: @i65", "possible: u8, i8 and s8 to u64, i64 and s64 in steps of 8 bits, f32,"),
    ("type: u8, enum", "type: @u8le, enum", "`u8le` has no byte order to choose; write `u8`"),
    ("scale: 0.001", "scale: @1/1000", "`1/1000` is not a number; write a decimal"),
    ("scale: 0.001", "scale: 0,@001", "`001` is not a key; write a decimal number with a point, such as `0.001`"),
    ("scale: 0.001", 'scale: @"0,001"', "`0,001` is not a number; write a point for the comma: 0.001"),
    ("scale: 0.001", "scale: @.inf", "is not a finite number"),
    ("scale: 0.001", "scale: @1e-400", "is out of the range of a double"),
    ("[-2.0, 2.0]", "[-2.0, @two]", "`two` is not a number"),
    ("[-2.0, 2.0]", "@[2.0]", "`range` has too few entries (1); it needs at least 2"),
    ("[-2.0, 2.0]", "@[1, 2, 3]", "`range` has too many entries (3); it takes at most 2"),
    ("[-2.0, 2.0]", "@2.0", "`2.0` cannot stand here; write a list"),
    ("{idle: 0, manual: 1}", "@[idle, manual]", "a list cannot stand here; write a mapping"),
    ("{idle: 0, manual: 1}", "@{}", "`enum` has too few entries (0); it needs at least 1"),
    ("{idle: 0, manual: 1}", "{idle: @off, manual: 1}", "`off` is not a whole number"),
    ("{idle: 0, manual: 1}", "{idle: 0, @IDLE: 1}", "`IDLE` and `idle` are both `idle` in generated code; rename one"),
    ("{idle: 0, manual: 1}", "{@idle_: 0, run: 1}", "`idle_` is not a name; a name has letters, digits and single"),
    ("{idle: 0, manual: 1}", "{@a__b: 0, idle: 1}", "single underscores"),
    ("note: ", f"@{'n' * 65}: ", "is longer than 64 characters"),
    ("then: stop", "then: @stop_", "`stop_` is not a name"),
    ("then: stop", "then: @parameters", "`parameters` is the function by which a handler gives its parameters"),
    ("at: mcu", "at: @both", "`both` is not possible here; "),
    # parts
    (
        "magic: 0xAA 0x55",
        "magic: @55",
        "`55` may mean two things (decimal or hexadecimal); bytes are written 0x",
    ),
    ("magic: 0xAA 0x55", "magic: @AA 55", "bytes are written 0x.., such as 0xAA 0x55"),
    ("magic: 0xAA 0x55", "magic: @0xAA55", "write one 0x.. for each byte: 0xAA 0x55"),
    ("magic: 0xAA 0x55", "magic: @[0xAA, 0x55]", "a list is not a byte"),
    ("magic: 0xAA 0x55", "magic: @0x01 0x02 0x03 0x04 0x05", "5 bytes are too many here; at most 4"),
    ("- magic: 0xAA 0x55", "- @magc: 0xAA", "`magc` is not a part of a frame; did you mean `magic`?"),
    ("- magic: 0xAA 0x55", "- @magic", "write `- part: value`"),
    ("- magic: 0xAA 0x55", "- @{magic: 0xAA, id: u8}", "`magic` and `id` are 2 parts in one entry"),
    ("- magic: 0xAA 0x55", "- {magic: 0xAA, @nme: x}", "did you mean `name`? (possible: magic, name, when)"),
    ("- length: u8", "- length: @u64", "possible: u8, u16, u24, u32; "),
    ("- length: u8", "- length: {type: u8, counts: @all}", "possible: payload, rest, self_and_rest, frame"),
    ("- length: u8", "- length: {type: u8, @count: rest}", "did you mean `counts`?"),
    ("- length: u8", "- {length: u8, when: @magic == 0xAA55}", "write one 0x.. for each byte: 0xAA 0x55"),
    ("- length: u8", "- {length: u8, when: @magic == 0xAA0x55}", "may mean two things"),
    (
        "- length: u8",
        "- sequence: u8\n  - {reserved: 1, when: @sequence & 1}\n  - length: u8",
        "`sequence` is a sequence number: ",
    ),
    (
        "- length: u8",
        "- {sequence: u8, name: turn}\n  - {reserved: 1, when: @turn == 3}\n  - length: u8",
        "can depend on it; name another field of the header",
    ),
    (
        "- length: u8",
        "- bits: u8\n    fields: {sequence: 4, hops: 4}\n  - {reserved: 1, when: @sequence > 3}\n  - length: u8",
        "`sequence` is a sequence number: ",
    ),
    ("- length: u8", "- {length: u8, when: @flags & 08}", "`0 8` is not one number"),
    ("- length: u8", "- {length: u8, when: @flags ~ 3}", "'~' has no meaning here"),
    ("- length: u8", "- @length: {counts: rest}", "`length` needs `type`; write for example `type: u8`"),
    ("by_length", "@bylength", "did you mean `by_length`?"),
    ("by_length", "@-4", "write by_length, by_id, rest, or a number of bytes"),
    ("crc-16/modbus", "@crc-16/modbuss", "did you mean `crc-16/modbus`?"),
    ("crc-16/modbus", "@crc16", "say which: crc-16/arc, crc-16/modbus,"),
    ("crc-16/modbus", "@16", "`16` is not a check; write its name"),
    ("crc-16/modbus", "{type: sum16, byte: @middle}", "possible: low, high"),
    ("crc-16/modbus", "{type: crc, width: @12, poly: 0x80F}", "write 8, 16, 24, 32 or 64"),
    ("crc-16/modbus", "{type: crc, width: 16, poly: 0x1021, refin: @yes}", "write true or false"),
    ("crc-16/modbus", "{type: sum16, over: @id...payload}", "write `id..payload`"),
]


@pytest.mark.parametrize(("old", "new", "fragment"), SYNTAX)
def test_wrong_syntax_is_told_at_its_place(old: str, new: str, fragment: str) -> None:
    if new == "":  # the key that is missing has no place of its own: its owner's is named
        text, place = edited(old, new), "rover.yaml:19:3"
    else:
        text, place = marked(edited(old, new))
    assert [line for line in problems_of(text) if line.startswith(f"{place}: ") and fragment in line]


COUNTS = "  counts: {{id: 0x82, sender: mcu, fields: {}}}\nservices: {{counters: {{message: @counts}}}}\ndeadlines:"
MEANING = [
    # messages
    ("id: 0x81", "id: @0x181", "id 385 does not fit the frame's id part, whose greatest is 255"),
    (
        "sender: mcu\n",
        "sender: both\n  other:\n    id: @0x01\n    sender: both\n",
        "sends `drive` (line 11) under id 0x01",
    ),
    ("reply: state", "reply: @stat", "there is no message `stat`; did you mean `state`?"),
    ("reply: state", "reply: @drive", "the host sends `drive`, so its reply must come from the MCU"),
    (
        "  state:",
        "  drive_1: {id: 2, sender: host}\n  @drive1: {id: 3, sender: host}\n  state:",
        "both become `Drive1` in C++",
    ),
    # fields
    ("[-2.0, 2.0]", "@[-40, 2]", "-40 does not fit: i16 with scale 0.001 carries -32.768 to 32.767"),
    ("[-2.0, 2.0]", "@[2.0, -2.0]", "the range ends (-2) before it begins (2)"),
    ("[-2.0, 2.0]", "@[0.0001, 0.0002]", "no number on the wire has a value in this range"),
    ("scale: 0.001", "scale: @0", "a scale of 0 would make every value the same"),
    (
        "i16, unit: m/s, scale: 0.001",
        "u64, unit: m/s, scale: @1e300",
        "the greatest value is beyond a double",
    ),
    ("scale: 0.001", "scale: @1e-310", "out of the range of a double; write a number from 1e-300 to 1e300"),
    ("scale: 0.001", "scale: @5e-324", "out of the range of a double; write a number from 1e-300 to 1e300"),
    ("scale: 0.001", "scale: @1_0", "`1_0` is not a number"),
    ("scale: 0.001", "scale: @٣", "`٣` is not a number"),
    (
        "scale: 0.001, range: [-2.0, 2.0], on_range: clamp",
        "offset: @1e300",
        "beside an offset of 1e+300 a double loses the steps of 1; write an offset of at most 281474976710656",
    ),
    (
        "scale: 0.001, range: [-2.0, 2.0], on_range: clamp",
        "scale: 0.000123, offset: @1.0e+12",
        "a double loses the steps of 0.000123; write an offset of at most",
    ),
    (
        "type: i16, unit: m/s, scale: 0.001, range: [-2.0, 2.0], on_range: clamp",
        "type: f64, offset: @1e300",
        "beside an offset of 1e+300 a double loses the steps of 1",
    ),
    (
        "type: i16, unit: m/s, scale: 0.001, range: [-2.0, 2.0], on_range: clamp",
        "type: f32, scale: @1e-60",
        "f32 values are computed in 32-bit floats, and 1e-60 is out of their range",
    ),
    ("on_range: clamp", "default: @3", "3 does not fit `speed`, which takes values from -2 to 2"),
    ("on_range: clamp", "default: @slow", "`slow` is not a number"),
    (
        ", range: [-2.0, 2.0], on_range: clamp",
        ", @on_range: clamp",
        "`on_range` has no meaning without `range`",
    ),
    ("type: i16, unit", "type: bool, @unit", "`unit` is for numbers"),
    ("type: i16, unit: m/s", "type: i16, @size: 2", "for an array of numbers write `count`"),
    ("idle: 0, manual: 1", "idle: 0, manual: @256", "256 does not fit u8 (from 0 to 255)"),
    ("idle: 0, manual: 1", "idle: 0, manual: @0", "`idle` is 0 already; give `manual` a value of its own"),
    (
        "enum: {idle: 0, manual: 1}}",
        "enum: {idle: 0, manual: 1}, default: @automatic}",
        "possible: idle, manual",
    ),
    ("enum: {idle: 0, manual: 1}}", "enum: {idle: 0, manual: 1}, default: @7}", "7 has no name in `mode`"),
    ("enum: {idle: 0, manual: 1}}", "enum: {idle: 0, manual: 1}, @scale: 2}", "no meaning for named numbers"),
    (
        "enum: {idle: 0, manual: 1}}",
        "enum: {idle: 0, manual: 1}, @flags: {a: 0}}",
        "cannot stand beside `enum`",
    ),
    ("stalled: 0, hot: 1", "stalled: 0, hot: @8", "u8 has no bit 8; its bits are 0 to 7"),
    ("stalled: 0, hot: 1", "stalled: 1, hot: @1", "`stalled` is bit 1 already"),
    ("hot: 1}", "hot: 1}, default: @4", "bit 2 of 4 has no name in `faults`"),
    ("hot: 1}", "hot: 1}, count: 2, default: @[1]", "1 elements do not fit `faults`; it has 2"),
    ("type: text, max: 8", "type: text, size: 8, @max: 8", "`max` cannot stand beside `size`"),
    ("type: text, max: 8", "type: @text", "a text field needs a size; add `size: 16`"),
    ("type: text, max: 8", "type: text, max: 8, default: @123456789", "is a text; put the value in quotes"),
    (
        "type: text, max: 8",
        "type: text, max: 8, default: @'123456789'",
        "has 9 bytes, and `note` has room for 8",
    ),
    ("type: text, max: 8}", "type: text, @max: 8}\n      more: {type: u8}", "so it must be the last"),
    ("type: text, max: 8", "type: u8, default: @0.5", "0.5 is not a whole number"),
    # log lines
    (
        "sender: mcu",
        "sender: mcu\n    log: @'{fault}'",
        "there is no field `fault` to show here; did you mean `faults`?",
    ),
    (
        "sender: mcu",
        "sender: mcu\n    log: @'is {faults'",
        "`{faults` names no field; write `{field}`, or `{{` for a brace",
    ),
    ("sender: mcu", "sender: mcu\n    log: @'{faults:x}'", "`{faults:x}` names no field"),
    ("sender: mcu", "sender: mcu\n    log: @'faults}'", "`}` ends nothing here; write `}}` for a brace"),
    ("sender: mcu", "sender: mcu\n    log: @' '", "a log line says something"),
    ("sender: mcu", 'sender: mcu\n    log: @"a\\nb"', "one line of printable characters"),
    ("sender: mcu", "sender: mcu\n    @level: error", "`level` belongs to a log line; add `log: ...`, or remove it"),
    ("sender: host", "sender: @host\n    log: driven", "a log line is the MCU's; write `sender: mcu`, or remove `log`"),
    # deadlines and emergency stop
    ("{message: drive, at", "{message: @drve, at", "there is no message `drve`; did you mean `drive`?"),
    ("at: mcu", "at: @host", "`drive` comes from the host, so the host cannot miss it; write `at: mcu`"),
    ("after: 1 s", "after: @10 ms", "`drive` is due every 0.05 s only"),
    ("then: stop}", "then: stop}\n  - {message: drive, at: mcu, after: 2 s, @then: stop}", "done after 1 s"),
    ("{message: drive, speed", "{message: @drove, speed", "did you mean `drive`?"),
    ("{message: drive, speed: 0, mode: idle}", "{message: @state}", "comes from the MCU, and the host sends"),
    (
        "speed: 0, mode: idle",
        "speed: @9, mode: idle",
        "9 does not fit `speed`, which takes values from -2 to 2",
    ),
    (
        "speed: 0, mode: idle",
        "speed: 0, mode: @stop",
        "`stop` is not a name of `mode`; possible: idle, manual",
    ),
    ("speed: 0, mode: idle", "speed: 0, mode: 0, @sped: 1", "has no field `sped`; did you mean `speed`?"),
    (
        "drive, speed: 0, mode: idle",
        "@drive, speed: 0",
        "the stop leaves `mode` open; add for example `mode: 0`",
    ),
    (
        "{message: drive, speed: 0, mode: idle}",
        "[{message: drive, speed: 0, mode: idle}, {message: @drive, speed: 0, mode: idle}]",
        "`drive` is in the stop already",
    ),
    (
        "{message: drive, speed: 0, mode: idle}",
        "[{message: drive, speed: 0, mode: idle}, {message: @state}]",
        "from the MCU",
    ),
    ("{message: drive, speed: 0, mode: idle}", "@[]", "`emergency_stop` has too few entries (0); it needs at least 1"),
    ("{message: drive, speed: 0, mode: idle}", "[@drive]", "cannot stand for a message of `emergency_stop`"),
    ("{message: drive, speed: 0, mode: idle}", "[@{speed: 0}]", "needs `message`"),
    # services
    (
        "deadlines:",
        "services: {ping: {request: @pnig, reply: state}}\ndeadlines:",
        "there is no message `pnig`",
    ),
    (
        "deadlines:",
        "services: {ping: {request: @state, reply: state}}\ndeadlines:",
        "the host sends the `request`",
    ),
    (
        "deadlines:",
        "services: {ping: {request: @drive, reply: state}}\ndeadlines:",
        "needs a field `number` in `drive`",
    ),
    ("deadlines:", "services: {log: {message: @drive}}\ndeadlines:", "the MCU sends the `message`"),
    ("deadlines:", "services: {@pong: {message: drive}}\ndeadlines:", "did you mean `ping`?"),
    ("deadlines:", "services: {counters: {message: @state}}\ndeadlines:", "is called like a counter of the MCU's link"),
    ("deadlines:", f"{COUNTS.format('{late: {type: u16}}')}", "the MCU sends its counters by itself; give"),
    ("deadlines:", f"{COUNTS.format('{late: {type: u16, scale: 0.1}}')}", "`late` in `counts` is no plain unsigned"),
    ("deadlines:", f"{COUNTS.format('{late: {type: u16, range: [0, 9]}}')}", "takes every value; remove its `range`"),
]


@pytest.mark.parametrize(("old", "new", "fragment"), MEANING)
def test_a_file_that_makes_no_sense_is_told_at_the_place(old: str, new: str, fragment: str) -> None:
    text, place = marked(edited(old, new))
    assert [line for line in problems_of(text) if line.startswith(f"{place}: ") and fragment in line]


FRAMES = [
    (
        "magic: 0x01, id: u8, payload: @by_length",
        "needs a length; add a part such as `- length: u8` before it",
    ),
    ("id: u8, payload: @rest, check: crc-16/modbus", "needs delimiters"),
    ("magic: 0x01, payload: by_id, @id: u8", "the id must stand before the payload whose size it tells"),
    ("magic: 0x01, id: u8, payload: by_length, @length: u8", "the length must stand before the payload"),
    ("magic: 0x01, id: u8, @length: u8, payload: 20", "this length tells nothing"),
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
        "counts more than it can tell",
    ),
    ("magic: 0x01, name: @payload, id: u8, payload: 20", "is the word for another kind of part"),
    ("magic: 0x01, name: a, id: u8, name: @a, payload: 20", "another part is named `a`"),
    ("@cobs: [id: u8, payload: rest, check: crc-16/modbus]", "stuffing needs a delimiter before and behind it"),
    ("@delimiter: 0x00, id: u8, payload: 20", "delimiters are the frame's first and its last part"),
    ("delimiter: @0x7E, cobs: [id: u8, payload: rest], delimiter: 0x00", "COBS frees a frame of 0x00"),
    ("delimiter: 0x00, cobs: [id: u8], @payload: 20, delimiter: 0x00", "the payload stands within the stuffed parts"),
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
        "`delimiter` cannot stand within stuffed parts",
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
def test_a_frame_that_cannot_be_read_is_told_at_the_part(parts: str, fragment: str) -> None:
    text, place = marked(frame_of(parts).replace("[@delimiter", "[@{delimiter"))
    assert [line for line in problems_of(text) if line.startswith(f"{place}: ") and fragment in line]


@pytest.mark.parametrize(
    ("frame", "fragment"),
    [
        ("[magic: 0x01, id: u8]", "4:8: the frame has no payload"),
        ("[id: u8, payload: 20]", "4:8: nothing tells this frame from other bytes"),
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
def test_a_frame_that_is_wrong_as_a_whole_is_told_at_its_beginning(frame: str, fragment: str) -> None:
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
            "6:3: `one` has up to 256 payload bytes; the frame's length can tell 255 at most",
        ),
        (
            "",
            "magic: 0x01, id: u8, length: {type: u8, counts: frame}, payload: by_length, check: crc-16/modbus",
            "{id: 1, sender: host, fields: {a: {type: bytes, max: 251}}}",
            "6:3: `one` has up to 251 payload bytes; the frame's length can tell 250 at most",
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
            "3:14: the frame's length can tell 255 payload bytes at most",
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
            "7:36: `a` reaches to the payload's end, and this frame does not tell where that is",
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
def test_messages_that_do_not_fit_their_frame_are_told(extra: str, frame: str, message: str, expected: str) -> None:
    text = ONE_MESSAGE.format(extra=extra, frame=frame, message=message)
    assert [line for line in problems_of(text) if line.startswith(f"rover.yaml:{expected}")]


def test_the_same_id_may_mean_a_message_in_each_direction() -> None:
    message = "{id: 1, sender: host}\n  two:\n    {id: 1, sender: mcu}"
    protocol = loads(ONE_MESSAGE.format(extra="", frame="magic: 0x01, id: u8, payload: 2", message=message))
    assert [m.id for m in protocol.messages] == [1, 1]


def test_all_problems_are_told_at_once_and_in_order() -> None:
    text = GOOD
    for old, new in (
        ("baud: 115200", "bad: 115200"),  # an unknown key
        ("length: u8", "length: u9"),  # a wrong value, which spoils the frame
        ("every: 50 ms", "every: 50"),  # another, which spoils a message
        ("reply: state", "reply: nobody"),  # not looked up: its message is spoiled
        ("manual: 1", "manual: 0"),  # makes no sense, in a spoiled message
        ("hot: 1", "hot: 9"),  # makes no sense, in a sound message
        ("at: mcu", "at: both"),
        ("message: drive, speed", "message: nothing, speed"),
    ):
        text = text.replace(old, new)
    places = [line.split(": ")[0].removeprefix("rover.yaml:") for line in problems_of(text)]
    assert places == ["3:8", "6:13", "14:12", "18:49", "23:51", "26:26", "27:27"]


def test_a_reference_to_a_message_that_is_wrong_itself_is_no_second_problem() -> None:
    text, place = marked(edited("sender: host", "sender: @hots"))
    assert [line.split(": ")[0] for line in problems_of(text)] == [place]


def test_a_wrong_field_does_not_make_its_message_too_small_or_its_stop_incomplete() -> None:
    text, place = marked(edited("type: i16", "type: @i65"))
    assert [line.split(": ")[0] for line in problems_of(text)] == [place]


def test_an_error_carries_its_problems_as_data() -> None:
    with pytest.raises(ProtocolFileError) as caught:
        loads(GOOD.replace("rover", "Rover-2"), "rover.yaml")
    (problem,) = caught.value.problems
    assert (problem.path, problem.line, problem.column) == ("rover.yaml", 2, 11)
    assert problem.sentence.startswith("`Rover-2` is not a name; ")


def test_a_flood_of_problems_is_cut_short_with_their_number() -> None:
    text = GOOD + "".join(f"key{n}: 0\n" for n in range(300))
    lines = problems_of(text)
    assert len(lines) == 101
    assert lines[-1].endswith("200 more problems from here on; correct the earlier ones first")


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
    ("number: {type: u8}", "number: {type: @u11}", "u11 is no whole number of bytes; pack several (`count: 8"),
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
    ("type: padding, size: 2", "type: u8, constant: 2, @range: [0, 2]", "`range` cannot stand beside `constant`"),
    ("type: padding, size: 2", "type: u8, constant: @256", "256 does not fit `gap`, which takes values from 0 to 255"),
    ("type: padding, size: 2", "type: f32, @constant: 1", "`constant` is for whole numbers, bool, text and bytes"),
    ("type: padding, size: 2", "type: padding, size: 2, @constant: 1", "for padding write `must_be_zero: true`"),
    ("type: padding, size: 2", "type: u8, @must_be_zero: true", "`must_be_zero` is for padding; for a number write"),
    ("type: padding, size: 2", 'type: text, constant: @""', "this constant has no byte; write it, or remove the field"),
    ("type: padding, size: 2", "type: padding, size: 65, must_be_zero: true", "at most 64 bytes of constants"),
    ("type: u3}", "type: u3, constant: @8}", "8 does not fit `mode`, which takes values from 0 to 7"),
    ("{a: {type: u8}}", "{a: {type: u8, constant: 1}}", "`rest` varies in number, and its elements hold a constant"),
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
    ("struct: point", "struct: @3", "cannot stand here; write a mapping"),
    ("{struct: point}", "@{struct: point, type: u8}", "`type` and `struct` are two kinds of field; keep one"),
    ("struct: point", "struct: {x: {type: @u9}}", "u9 is no whole number of bytes"),
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
    ("{count: number, max: 9, fields: point}", "{count: @{}, max: 9, fields: point}", "nothing says how many elements"),
    (
        "{count: number, max: 9, fields: point}",
        "{count: {bytes: @3}, max: 9, fields: point}",
        "`3` is no field that counts",
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
        "`number` cannot tell elements and bytes at once",
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
        "`number` counts `points` already, and what tells bytes counts nothing else",
    ),
    (
        "{count: to_end, max: 4, fields: {a: {type: u8}}}",
        "{count: {bytes: @number}, max: 4, fields: {b: {type: u8}, a: {type: text, max: 3, ends_with: 0x00}}}",
        "each of these elements has its own size, so bytes do not tell how many there are",
    ),
    (
        "{count: number, max: 9, fields: point}",
        "{count: {elements: number, asked_by: much}, max: 9, fields: point}",
        "no message has the reply `scan`, so no request asks; write `reply: scan` in the request",
    ),
    ("number: {type: u8}", "number: {type: u8, @counts: points}", "the field that is counted names what counts it"),
    ("type: u3}", "type: u3, @counts: points}", "of a value among bits `count: state.number`"),
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
def test_wrong_fields_within_fields_are_told_at_the_place(old: str, new: str, fragment: str) -> None:
    assert SHAPES.count(old) == 1, old
    text = SHAPES.replace(old, new)
    if "@" in text:
        text, place = marked(text)
        assert [line for line in problems_of(text) if line.startswith(f"{place}: ") and fragment in line]
    else:
        assert [line for line in problems_of(text) if fragment in line]


def test_a_message_varies_only_where_the_frame_tells_its_size() -> None:
    by_id = SHAPES.replace("length: u16, id: u8, payload: by_length", "id: u8, payload: by_id")
    assert [line for line in problems_of(by_id) if "`rest` reaches to the payload's end" in line]
    counted = by_id.replace("      rest:", "      more: {type: u8}\n#")
    assert loads(counted).message("scan").max_payload == SHAPES_SIZE - 4 + 1
    ended = counted.replace("size: number, max: 9", "ends_with: 0x00, max: 9")
    assert [line for line in problems_of(ended) if "`name` varies in size, and no count of the message tells" in line]
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
    assert [line for line in problems_of(inner) if "a list that stands in the message itself" in line]


def test_types_that_multiply_are_refused_before_they_fill_the_memory() -> None:
    types = "".join(f"  t{n}: {{{', '.join(f'f{i}: {{struct: t{n - 1}}}' for i in range(9))}}}\n" for n in range(1, 30))
    text = SHAPES.replace("types:\n", "types:\n  t0: {x: {type: u8}}\n" + types)
    assert [line for line in problems_of(text) if "values, those of structs included; at most 1000" in line]


@pytest.mark.parametrize("step", [1, -1])
def test_types_that_lie_too_deep_are_refused_in_either_order(step: int) -> None:
    types = [f"  t{n}: {{f: {{struct: t{n - 1}}}}}\n" for n in range(1, 3000)]
    text = SHAPES.replace("types:\n", "types:\n  t0: {x: {type: u8}}\n" + "".join(types[::step]))
    assert [line for line in problems_of(text) if "deep" in line and ("at most 8" in line or "more than 8" in line)]
