"""The newest values of messages in a terminal: all of them, in places that they keep."""

from __future__ import annotations

import io
from typing import Any

import pytest
from rich.console import Console
from rich.text import Text

from wirebond.cli.message_rows import MessageRows, Row, Widths
from wirebond.cli.shown import units_of, values_text
from wirebond.generate.new.template import template_text
from wirebond.protocol import loads

JOINTS = [{"position": 0.1234 * (n - 6), "velocity": -1.5 * n, "torque": n} for n in range(12)]
HEAD = "joint_states     12  50.0 Hz"


def lines(fields: dict[str, Any], width: int = 80, widths: Widths | None = None, **others: Any) -> list[str]:
    """Return the lines below the headings."""
    console = Console(width=width, file=io.StringIO(), record=True)
    console.print(MessageRows([Row("joint_states", "12", "50.0 Hz", fields, widths or Widths(), **others)]))
    return [line.rstrip() for line in console.export_text().splitlines()][1:]


def test_values_that_have_room_stand_beside_the_name() -> None:
    assert lines({"left": 3, "mode": "idle", "faults": ["hot", "stalled"]}) == [
        f"{HEAD}  left 3  mode idle  faults [hot stalled]"
    ]
    assert lines({}) == [HEAD]


@pytest.mark.parametrize("width", [80, 50, 40])
def test_twelve_joints_are_all_there(width: int) -> None:
    shown = lines({"measured": 123456, "joints": JOINTS}, width)
    assert shown[:2] == [HEAD, "  measured 123456"]
    assert all(len(line) <= width for line in shown)
    words = " ".join(shown[2:]).split()
    expected = values_text({"joints": JOINTS}).replace("[", "").replace("]", "").split()
    assert words == expected and len(words) == 3 + 36


def test_values_keep_their_places_while_they_change() -> None:
    widths = Widths()
    before = lines({"joints": JOINTS}, widths=widths)
    after = lines({"joints": [dict.fromkeys(one, 0) for one in JOINTS]}, widths=widths)
    assert [len(line) for line in after] == [len(line) for line in before]
    assert lines({"speed": -100, "mode": "automatic"}, widths=widths) == [f"{HEAD}  speed -100  mode automatic"]
    assert lines({"speed": 7, "mode": "idle"}, widths=widths) == [f"{HEAD}  speed    7  mode idle"]


def test_units_follow_their_values() -> None:
    model = loads(template_text("native", "legs", {"joints": 3, "battery": 1}), "legs.yaml")
    units = units_of(model.message("joint_states").fields)
    assert units == {
        "measured": "us",
        "joints.position": "rad",
        "joints.velocity": "rad/s",
        "joints.torque": "N·m",
    }
    shown = lines({"measured": 123456, "joints": JOINTS}, units=units)
    assert shown[1] == "  measured 123456 us"
    assert [line.rsplit(" ", 1)[1] for line in shown if line.endswith(("rad", "rad/s", "N·m"))] == [
        "rad",
        "rad/s",
        "N·m",
    ]
    assert all(len(line) <= 80 for line in shown)
    assert lines({"voltage": 12.3, "mode": "idle"}, units=units_of(model.message("status").fields)) == [
        f"{HEAD}  voltage 12.3 V  mode idle"
    ]


def test_a_value_that_is_wider_than_the_terminal_is_broken_and_not_cut() -> None:
    text = "".join(chr(ord("a") + n % 26) for n in range(100))
    shown = lines({"text": text}, 40)
    assert all(len(line) <= 40 for line in shown)
    assert text in "".join(line.strip() for line in shown)


def test_texts_and_faults_are_shown_whole() -> None:
    wrong = "position 9 rad is outside -3 ... 3 rad; velocity 99 rad/s is outside -9 ... 9 rad/s"
    shown = lines({"joints": JOINTS}, said=Text("[servo 3]"), wrong=wrong)
    assert shown[1] == "  [servo 3]"
    assert " ".join(" ".join(shown).split()).endswith(wrong)
    assert lines({}, said=Text("warning: too hot")) == [f"{HEAD}  warning: too hot"]
