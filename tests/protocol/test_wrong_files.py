"""Wrong protocol files: each names the exact place, what is wrong, and what would be right.

In the tables `@` marks the place that the error must name; it is taken out before the file is read.
"""

import pytest
from tests.protocol.wrong_files import marked, problems_of

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
    ("{baud: 115200}", "@[115200]", "a list cannot be used for `link`; write a mapping with the keys baud,"),
    ("{baud: 115200}", "{baud: 115200}\nbyte_order: @network", "possible: little, big"),
    ("{baud: 115200}", "{baud: 115200}\nunknown: @ignore", "possible: deliver, reject"),
    ("{baud: 115200}", "{baud: 115200}\nidle: @20", "`20` has no unit; write a number and a unit"),
    ("{baud: 115200}", "{baud: 115200}\nidle: @20 Hz", "is a rate, but a duration is expected here"),
    ("{baud: 115200}", "{baud: 115200}\ndescription: @5", "`5` is not text here; put it in quotes"),
    ("every: 50 ms", "every: @50", "`50` has no unit; write a number and a unit: `50 ms`"),
    ("every: 50 ms", "every: @50 min", "`min` is not a unit of time"),
    ("every: 50 ms", "every: @0 Hz", "`0 Hz` means never; leave the key out"),
    ("every: 50 ms", "every: @1 Hzz", "`Hzz` is not a unit of time"),
    ("every: 50 ms", "every: @9999 s", "write 1 us to 2147 s"),
    ("every: 50 ms", "queue: @newest", "`newest` is not possible here; possible: normal, urgent, latest"),
    ("sender: mcu", "sender: mcu\n    log: hot\n    level: @warn", "did you mean `warning`?"),
    ("{baud: 115200}", "{max_age: @31 s}", "frames can wait for 1 ms to 30 s"),
    ("{baud: 115200}", "{max_run: @1}", "`1` has no unit"),
    ("every: 50 ms", "every: @often", "`often` is not a duration"),
    ("0x01", "@one", "the id has no named values; write a number instead of `one`"),
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
    ("type: i16", "type: @i65", "possible: u8, i8 and s8 to u64, i64 and s64 in steps of 8 bits, bcd8 to bcd56"),
    ("type: u8, enum", "type: @u8le, enum", "`u8le` has no byte order to choose; write `u8`"),
    ("scale: 0.001", "scale: @1/1000", "`1/1000` is not a number; write a decimal"),
    ("scale: 0.001", "scale: 0,@001", "`001` is not a key; write a decimal number with a point, such as `0.001`"),
    ("scale: 0.001", 'scale: @"0,001"', "`0,001` is not a number; write a point instead of the comma: 0.001"),
    ("scale: 0.001", "scale: @.inf", "is not a finite number"),
    ("scale: 0.001", "scale: @1e-400", "is out of the range of a double"),
    ("[-2.0, 2.0]", "[-2.0, @two]", "`two` is not a number"),
    ("[-2.0, 2.0]", "@[2.0]", "`range` has too few entries (1); it needs at least 2"),
    ("[-2.0, 2.0]", "@[1, 2, 3]", "`range` has too many entries (3); it takes at most 2"),
    ("[-2.0, 2.0]", "@2.0", "`2.0` is not possible here; write a list"),
    ("{idle: 0, manual: 1}", "@[idle, manual]", "a list is not possible here; write a mapping"),
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
        "`55` is ambiguous (decimal or hexadecimal); bytes are written 0x",
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
    ("- length: u8", "- {length: u8, when: @magic == 0xAA0x55}", "is ambiguous"),
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
    ("crc-16/modbus", "{type: crc, width: @2, poly: 0x3}", "has 3 to 64 bits"),
    ("crc-16/modbus", "{type: crc, width: 16, poly: 0x1021, refin: @yes}", "write true or false"),
    ("crc-16/modbus", "{type: sum16, over: @id...payload}", "write `id..payload`"),
]


@pytest.mark.parametrize(("old", "new", "fragment"), SYNTAX)
def test_wrong_syntax_is_reported_at_its_place(old: str, new: str, fragment: str) -> None:
    if new == "":  # the key that is missing has no place of its own: its owner's is named
        text, place = edited(old, new), "rover.yaml:19:3"
    else:
        text, place = marked(edited(old, new))
    assert [line for line in problems_of(text) if line.startswith(f"{place}: ") and fragment in line]


COUNTS = "  counts: {{id: 0x82, sender: mcu, fields: {}}}\nservices: {{counters: {{message: @counts}}}}\ndeadlines:"
MEANING = [
    # messages
    ("id: 0x81", "id: @0x181", "id 385 does not fit the frame's id part, whose maximum is 255"),
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
        "the maximum is beyond a double",
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
        "cannot be combined with `enum`",
    ),
    ("stalled: 0, hot: 1", "stalled: 0, hot: @8", "u8 has no bit 8; its bits are 0 to 7"),
    ("stalled: 0, hot: 1", "stalled: 1, hot: @1", "`stalled` is bit 1 already"),
    ("hot: 1}", "hot: 1}, default: @4", "bit 2 of 4 has no name in `faults`"),
    ("hot: 1}", "hot: 1}, count: 2, default: @[1]", "1 elements do not fit `faults`; it has 2"),
    ("type: text, max: 8", "type: text, size: 8, @max: 8", "`max` cannot be combined with `size`"),
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
    (
        "after: 1 s, then: stop}",
        "after: 1 s, then: stop, @recover_by: {message: drive, speed: 0, mode: idle}}",
        "only a deadline with `at: mcu` and `recover: explicit` is ended by a message of its own",
    ),
    (
        "then: stop}",
        "then: stop, recover: explicit, recover_by: @{message: drive, speed: 0, mode: idle}}",
        "`drive` is held back itself while `stop` lasts; name another message of the host",
    ),
    (
        "then: stop}",
        "then: stop, start: @held}",
        "only a deadline with `at: mcu` and `recover: explicit` can hold back its",
    ),
    ("then: stop}", "then: stop, recover: explicit, start: @hold}", "did you mean `held`?"),
    ("then: stop}", "then: stop, recover: explicit, recover_by: {message: @state}}", "and the host sends `recover_by`"),
    ("then: stop}", "then: stop, recover: explicit, recover_by: {message: @drve}}", "did you mean `drive`?"),
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
        "the stop leaves `mode` of `drive` open; add for example `mode: idle`",
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
    ("{message: drive, speed: 0, mode: idle}", "[@drive]", "cannot be used for a message of `emergency_stop`"),
    ("{message: drive, speed: 0, mode: idle}", "[@{speed: 0}]", "needs `message`"),
    # time stamps
    ("faults: {type: u8,", "t: {type: i32, unit: us, @clock: mcu}\n      faults: {type: u8,", "one unsigned number"),
    (
        "faults: {type: u8,",
        "t: {type: u32, @clock: mcu}\n      faults: {type: u8,",
        "and here it is none; add `unit: us`",
    ),
    (
        "faults: {type: u8,",
        "t: {type: u32, unit: us, @clock: mcu, scale: 0.1}\n      faults: {type: u8,",
        "a whole number",
    ),
    ("faults: {type: u8,", "t: {type: u32, unit: us, @clock: mcu, offset: 1}\n      faults: {type: u8,", "no `offset`"),
    (
        "faults: {type: u8,",
        "t: {type: u16, unit: us, @clock: mcu}\n      faults: {type: u8,",
        "after 0.0655 s, too soon",
    ),
    ("faults: {type: u8,", "t: {type: u16, unit: ms, @clock: mcu}\n      faults: {type: u8,", "means several times"),
    ("faults: {type: u8,", "t: {type: u32, unit: us, clock: @host}\n      faults: {type: u8,", "the only one: mcu"),
    (
        "faults: {type: u8,",
        "t: {type: u32, unit: us, clock: mcu}\n      @u: {type: u32, unit: us, clock: mcu}\n      faults: {type: u8,",
        "`t` says already when `state` was measured",
    ),
    (
        "faults: {type: u8,",
        "@t: {type: u32, unit: us, clock: mcu}\n      x: {type: u8, count: t, max: 3}\n      faults: {type: u8,",
        "`t` counts elements, so it is not a time",
    ),
    (
        "faults: {type: u8,",
        "@s: {struct: {t: {type: u32, unit: us, clock: mcu}}}\n      faults: {type: u8,",
        "`clock` is for a field of the message itself",
    ),
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
    ("deadlines:", f"{COUNTS.format('{late: {type: u16, scale: 0.1}}')}", "`late` in `counts` is not a plain unsigned"),
    ("deadlines:", f"{COUNTS.format('{late: {type: u16, range: [0, 9]}}')}", "takes every value; remove its `range`"),
]


@pytest.mark.parametrize(("old", "new", "fragment"), MEANING)
def test_a_file_that_makes_no_sense_is_reported_at_its_place(old: str, new: str, fragment: str) -> None:
    text, place = marked(edited(old, new))
    assert [line for line in problems_of(text) if line.startswith(f"{place}: ") and fragment in line]


def test_all_problems_are_reported_at_once_and_in_order() -> None:
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
