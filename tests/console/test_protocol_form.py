"""A protocol as data that forms and plots are made of: every value of a message has its form, and its columns."""

from __future__ import annotations

import re
from typing import Any

import pytest

from tests.shared import ROOT, codec
from wirebond.codec import Codec, load
from wirebond.console.protocol_form import protocol_form
from wirebond.protocol import loads
from wirebond.protocol.model import End
from wirebond.recording.history.source import Source

pytestmark = pytest.mark.live

FILES = ["diffdrive", "native", "servo_bus", "contrib/dynamixel_2", "contrib/robomaster_referee"]


def form_of(name: str) -> tuple[Source, dict[str, Any]]:
    proto = codec(name) if "/" not in name else load(ROOT / "protocols" / f"{name}.yaml")
    source = Source(proto, End.HOST, 0.01)
    return source, protocol_form(proto, source.history, "", "port", 9600)


def leaves(fields: list[dict[str, Any]], prefix: str) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = {}
    for field in fields:
        name = f"{prefix}{field['name']}"
        if field["kind"] == "struct":
            found |= leaves(field["fields"], f"{name}.")
        else:
            found[name] = field
    return found


@pytest.mark.parametrize("name", FILES)
def test_every_number_can_be_plotted_and_every_column_has_its_form(name: str) -> None:
    source, form = form_of(name)
    for message in form["messages"]:
        end = End.HOST if message["sender"] == "host" else End.MCU
        all_columns = {c for c in source.history.columns(end, message["name"]) if not c.startswith("header.")}
        told: set[str] = set()
        for field_name, field in leaves(message["fields"], "").items():
            columns = [column.removeprefix(f"{message['name']}.") for column in field["columns"]]
            told |= set(columns)
            if field["kind"] in ("number", "bool", "enum", "flags") and field["max_count"] is None:
                assert columns and re.sub(r"\[\d+\]", "", columns[0]) == field_name
        assert told == all_columns


def test_elements_of_groups_are_columns_that_can_be_plotted() -> None:
    proto = Codec(
        loads("""
wirebond: 1
protocol: arm
frame: [magic: 0xA5, length: u8, id: u8, payload: by_length, check: crc-16/modbus]
messages:
  state:
    id: 1
    sender: mcu
    fields:
      joints: {group: {count: 2, fields: {position: {type: i16, scale: 0.001}, currents: {type: u8, count: 2}}}}
      points: {group: {count: to_end, max: 2, fields: {x: {type: i8}}}}
""")
    )
    source = Source(proto, End.HOST, 0.01)
    joints, points = protocol_form(proto, source.history, "", "port", 9600)["messages"][0]["fields"]
    position, currents = joints["fields"]
    assert position["columns"] == ["state.joints[0].position", "state.joints[1].position"]
    assert currents["columns"] == [f"state.joints[{i}].currents[{n}]" for i in range(2) for n in range(2)]
    assert points["fields"][0]["columns"] == ["state.points[0].x", "state.points[1].x"]
    assert joints["columns"] == points["columns"] == []


@pytest.mark.parametrize(
    ("field", "least", "greatest"),
    [
        ("{type: i8}", -128, 127),
        ("{type: u16, scale: 0.5, offset: 1}", 1, 32768.5),
        ("{type: i8, scale: -1}", -127, 128),
        ("{type: s16}", -32767, 32767),
        ("{type: bcd16}", 0, 9999),
        ("{type: i16, text: decimal, size: 3}", -99, 999),
        ("{type: u16, text: hex, size: 2}", 0, 255),
        ("{type: u8, range: [0, 50]}", 0, 50),
    ],
)
def test_a_number_is_bounded_by_what_the_wire_can_carry(field: str, least: float, greatest: float) -> None:
    proto = Codec(
        loads(f"""
wirebond: 1
protocol: bounds
frame: [magic: 0xA5, length: u8, id: u8, payload: by_length, check: crc-16/modbus]
messages: {{state: {{id: 1, sender: host, fields: {{x: {field}}}}}}}
""")
    )
    source = Source(proto, End.HOST, 0.01)
    (x,) = protocol_form(proto, source.history, "", "port", 9600)["messages"][0]["fields"]
    assert (x["min"], x["max"]) == (least, greatest)


def test_bits_that_share_a_number_are_a_struct() -> None:
    _, form = form_of("contrib/robomaster_referee")
    game = next(m for m in form["messages"] if m["name"] == "game_state")["fields"][0]
    assert game["kind"] == "struct" and [field["name"] for field in game["fields"]] == ["type", "stage"]
    assert game["fields"][0]["columns"] == ["game_state.game.type"]


def test_parameters_have_their_names_and_the_form_of_a_value() -> None:
    _, form = form_of("native")
    assert form["parameters"] is not None
    assert set(form["parameters"]) == {"names", "field", "read", "set", "value"}
    assert form_of("diffdrive")[1]["parameters"] is None
