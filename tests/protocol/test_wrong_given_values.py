"""Wrong values of a message that the file gives: of the emergency stop, of `recover_by`. Each names the exact place.

In the tables `@` marks the place that the error must name; it is taken out before the file is read.
"""

import pytest
from tests.protocol.wrong_files import marked, problems_of

from wirebond.protocol import loads

GOOD = """\
wirebond: 1
protocol: legs
frame: [magic: 0xAA, length: u8, id: u8, payload: by_length, check: crc-16/modbus]
messages:
  joints:
    id: 1
    sender: host
    fields:
      pose:   {struct: {x: {type: i8}, deep: {struct: {y: {type: i8, range: [-9, 9]}, z: {type: i8, default: 0}}}}}
      joints: {group: {count: 2, fields: {at: {type: f32}, on: {type: bool}}}}
      gains:  {type: u8, count: 3}
      state:  {bits: {type: u8, fields: {many: {type: u4}, level: {type: u4}}}}
      steps:  {type: u8, count: state.many, max: 4}
      marks:  {type: u8, count: state.many, max: 4, default: []}
      modes:  {type: u8, flags: {hot: 0, cold: 2}}
      key:    {type: bytes, size: 2}
      size:   {type: u8}
      name:   {type: text, size: size, max: 4}
      header: {type: u8, count: 2}
emergency_stop:
  message: joints
  pose: {x: 1, deep: {y: -9}}
  joints: [{at: 0.5, on: false}, {at: 0, on: true}]
  gains: [1, 2, 3]
  state: {level: 3}
  steps: [1, 2]
  marks: [3, 4]
  modes: [hot]
  key: "01 FF"
  name: "stop"
  header: [0, 1]
"""


def test_the_file_that_the_table_spoils_is_good() -> None:
    [stop] = loads(GOOD).emergency_stop
    assert stop.fields == {
        "pose": {"x": 1, "deep": {"y": -9}},
        "joints": [{"at": 0.5, "on": False}, {"at": 0.0, "on": True}],
        "gains": [1, 2, 3],
        "state": {"level": 3},
        "steps": [1, 2],
        "marks": [3, 4],
        "modes": ["hot"],
        "key": b"\x01\xff",
        "name": "stop",
        "header": [0, 1],
    }


WRONG = [
    (
        "  gains: [1, 2, 3]\n  state: {level: 3}\n",
        "",
        "leaves `gains`, `state` of `joints` open; add for example `gains: [0, 0, …]`",
    ),
    (
        "message: joints\n  pose: {x: 1, deep: {y: -9}}",
        "message: @joints",
        "leaves `pose` of `joints` open; add for example `pose: {x: 0, deep: {y: 0}}`",
    ),
    (
        "  joints: [{at: 0.5, on: false}, {at: 0, on: true}]\n",
        "",
        "leaves `joints` of `joints` open; add for example `joints: [{at: 0, on: false}, {at: 0, on: false}]`",
    ),
    ("  gains: [1, 2, 3]\n", "", "leaves `gains` of `joints` open; add for example `gains: [0, 0, …]`"),
    ("  steps: [1, 2]\n  marks: [3, 4]\n", "", "leaves `steps` of `joints` open; add for example `steps: [0]`"),
    ("  header: [0, 1]\n", "", "add for example `fields: {header: [0, 0]}`"),
    ("{x: 1, deep", "@{deep", "leaves `x` of `pose` open; add for example `x: 0`"),
    ("y: -9}", "y: @-10}", "-10 does not fit `y`, which takes values from -9 to 9"),
    ("y: -9}", "y: -9, @w: 1}", "`deep` has no field `w`; "),
    ("deep: {y: -9}", "deep: @4", "`deep` has fields; write a mapping of y, z"),
    (
        "[{at: 0.5, on: false}, {at: 0, on: true}]",
        "@[{at: 0.5, on: false}]",
        "1 elements do not fit `joints`; it has 2",
    ),
    (
        "[{at: 0.5, on: false}, {at: 0, on: true}]",
        "@{at: 0.5, on: false}",
        "`joints` has 2 elements; write a list, such as [{at: 0, on: false}, {at: 0, on: false}]",
    ),
    ("{at: 0, on: true}", "@{at: 0}", "leaves `on` of `joints` open; add for example `on: false`"),
    ("{at: 0, on: true}", "{at: 0, on: @7}", "`on` is a bool; write true or false"),
    ("{at: 0, on: true}", "@7", "`joints` has fields; write a mapping of at, on"),
    ("gains: [1, 2, 3]", "gains: [1, @256, 3]", "256 does not fit `gains`"),
    ("gains: [1, 2, 3]", "gains: [1, @[2], 3]", "`gains` is one value; write it without [ and ]"),
    ("gains: [1, 2, 3]", "gains: [1, @{a: 2}, 3]", "`gains` is one value; write it without { and }"),
    ("gains: [1, 2, 3]", "gains: @0", "`gains` has 3 elements; write a list, such as [0, 0, …]"),
    ("steps: [1, 2]", "steps: @[1, 2, 3, 4, 5]", "5 elements do not fit `steps`; it has at most 4"),
    ("[hot]", "@[warm]", "`warm` is not a flag of `modes`"),
    ('"01 FF"', '@"01 FF 02"', "these are 3 bytes, and `key` has room for 2; write no more"),
    ('"01 FF"', "@[1, 255]", "`key` is a byte string; write two hex digits a byte in quotes"),
    ('name: "stop"', 'name: @"stopped"', "the text has 7 bytes, and `name` has room for 4; shorten it"),
]


@pytest.mark.parametrize(("old", "new", "fragment"), WRONG)
def test_a_wrong_value_is_reported_at_its_place(old: str, new: str, fragment: str) -> None:
    spoilt = GOOD.replace(old, new)
    assert GOOD.count(old) == 1
    if "@" not in new:
        spoilt = spoilt.replace("message: joints", "message: @joints")
    text, place = marked(spoilt)
    found = problems_of(text)
    assert [line for line in found if line.startswith(f"{place}: ") and fragment in line], found


@pytest.mark.parametrize(
    ("old", "new", "fragment"),
    [
        (
            "marks: [3, 4]",
            "marks: [3]",
            "`state.many` of `joints` counts `steps` and `marks`; give both the same number",
        ),
        ("  marks: [3, 4]\n", "", "`state.many` of `joints` counts `steps` and `marks`"),
        (
            "{level: 3}",
            "{level: 3, many: 3}",
            "`state.many` of `joints` counts `steps`, so it is 2; leave it out, or write 2",
        ),
        ('name: "stop"', 'name: "stop"\n  size: 3', "`size` of `joints` counts `name`, so it is 4"),
    ],
)
def test_a_given_count_agrees_with_its_elements(old: str, new: str, fragment: str) -> None:
    assert GOOD.count(old) == 1
    text, place = marked(GOOD.replace(old, new).replace("message: joints", "message: @joints"))
    found = problems_of(text)
    assert [line for line in found if line.startswith(f"{place}: ") and fragment in line], found
    right = GOOD.replace("{level: 3}", "{level: 3, many: 2}").replace('name: "stop"', 'name: "stop"\n  size: 4')
    loads(right)
