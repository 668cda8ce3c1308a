"""The layout of payloads: which steps a message's fields become, and where they are."""

from __future__ import annotations

from typing import get_args

import pytest
from tests.shared import ROOT

import wirebond
from wirebond.protocol import loads
from wirebond.protocol.model.layout import Bits, Characters, Constant, Group, List, Number, Step, Told

TESTS = ROOT / "tests"

MESSAGE = """
wirebond: 1
protocol: laid_out
types:
  point: {x: {type: i16}, y: {type: i16}}
frame: [magic: 0xA5, id: u8, payload: by_id, check: crc-16/modbus]
messages:
  scan:
    id: 1
    sender: mcu
    fields:
      version: {type: u8, constant: 3}
      state: {bits: {type: u16be, fields: {mode: {type: u3}, spare: {type: padding, size: 1}, number: {type: u4}}}}
      pose: {struct: point}
      points: {group: {count: state.number, max: 15, fields: point}}
      bytes: {type: u8}
      name: {type: text, size: bytes, max: 20}
      last: {type: u32}
"""


@pytest.fixture(scope="module")
def layout() -> tuple[Step, ...]:
    return loads(MESSAGE).message("scan").layout


def test_places_are_those_of_a_payload_in_which_all_that_varies_is_empty(layout: tuple[Step, ...]) -> None:
    assert [(type(step).__name__, step.field.name, step.at) for step in layout] == [
        ("Constant", "version", 0),
        ("Bits", "state", 1),
        ("Group", "pose", 3),
        ("List", "points", 7),
        ("Number", "bytes", 7),
        ("Characters", "name", 8),
        ("Number", "last", 8),
    ]


def test_bits_have_places_of_their_own_and_say_which_they_are(layout: tuple[Step, ...]) -> None:
    state = layout[1]
    assert isinstance(state, Bits)
    assert [(run.field.name, run.low, run.text) for run in state.members] == [
        ("mode", 0, "bits 0 to 2"),
        ("spare", 3, "bit 3"),
        ("number", 4, "bits 4 to 7"),
    ]
    assert [run.bits_of(0x1A5) for run in state.members] == [5, 0, 10]


def test_counts_of_elements_or_bytes_are_found_by_their_slot(layout: tuple[Step, ...]) -> None:
    _, state, _, points, size, name, last = layout
    assert isinstance(state, Bits)
    assert isinstance(points, List)
    assert isinstance(size, Number)
    assert isinstance(name, Characters)
    assert isinstance(last, Number)
    assert [run.slot for run in state.members] == [None, None, 0]
    assert points.told == (Told("state.number", 0, 1),)
    assert (size.slot, name.told, last.slot) == (1, (Told("bytes", 1, 1),), None)


def test_steps_within_others_begin_at_0(layout: tuple[Step, ...]) -> None:
    pose, points = layout[2], layout[3]
    assert isinstance(pose, Group)
    assert isinstance(points, List)
    for step in (pose, points):
        assert [(inner.field.name, inner.at) for inner in step.steps] == [("x", 0), ("y", 2)]
        assert step.stride == 4
    assert isinstance(layout[0], Constant)
    assert layout[0].wire == b"\x03"


def test_the_tests_of_all_that_walks_a_layout_meet_every_kind_of_step() -> None:
    """Engine, generated code and `explain` are compared on the messages of these files."""
    met: set[type] = set()

    def visit(steps: tuple[Step, ...]) -> None:
        for step in steps:
            met.add(type(step))
            visit(step.steps if isinstance(step, Group | List) else ())

    for path in [TESTS / "generate" / "code" / "every_shape.yaml", *(TESTS / "formats").glob("*.yaml")]:
        for message in wirebond.load(path).model.messages:
            visit(message.layout)
    assert met == set(get_args(Step))
