"""A protocol as data that forms and plots are made of: every value of a message has its form, and its columns."""

from __future__ import annotations

from typing import Any

import pytest

from tests.shared import ROOT, codec
from wirebond.codec import load
from wirebond.console.protocol_form import protocol_form
from wirebond.history.source import Source
from wirebond.protocol.model import End

FILES = ["diffdrive", "native", "servo_bus", "contrib/dynamixel_2", "contrib/robomaster_referee"]


def form_of(name: str) -> tuple[Source, dict[str, Any]]:
    proto = codec(name) if "/" not in name else load(ROOT / "protocols" / f"{name}.yaml")
    source = Source(proto, End.HOST, 0.01)
    return source, protocol_form(proto, source.history, "", "port", 9600)


def leaves(fields: list[dict[str, Any]], prefix: str) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = {}
    for field in fields:
        name = f"{prefix}{field['name']}"
        if field["kind"] == "struct" and field["max_count"] is None and field["count"] is None:
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
                assert columns and columns[0].partition("[")[0] == field_name
        assert told == all_columns


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
