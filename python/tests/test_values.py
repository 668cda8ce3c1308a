"""What a command line's words become, and the made-up values of the simulator, for every shape of fields."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import wirebond
from wirebond import WirebondError
from wirebond.cli.output import values_text
from wirebond.cli.values import parse_assignments
from wirebond.sim.virtual_mcu import VirtualMcu

SHAPES = wirebond.load(Path(__file__).parent / "gen" / "every_shape.yaml")


@pytest.mark.parametrize(
    ("message", "words", "values"),
    [
        (
            "scan",
            ["origin.at.x=1.5", "origin.mode=moving", "own.raw=09 08"],
            {"origin": {"at": {"x": 1.5}, "mode": "moving"}, "own": {"raw": b"\x09\x08"}},
        ),
        ("scan", ['points=[{"x": 1}]', "echoes=1,2"], {"points": [{"x": 1}], "echoes": [1, 2]}),
        ("scan", ['own={"raw": "0908"}'], {"own": {"raw": b"\x09\x08"}}),
        ("bits", ["low.mode=fast", "low.armed=yes"], {"low": {"mode": "fast", "armed": True}}),
        ("streams", ["switches=1,0", "modes=a,c"], {"switches": [True, False], "modes": ["a", "c"]}),
        ("defaults", ["modes=on,off", "faults=hot"], {"modes": ["on", "off"], "faults": ["hot"]}),
    ],
)
def test_words_become_values_within_structs(message: str, words: list[str], values: dict[str, Any]) -> None:
    assert parse_assignments(SHAPES.model.message(message), words) == values


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["origin.x=1"], "scan.origin has no field 'x'; it has at, mode"),
        (["points.x=1"], "points has no fields of its own to give one by one"),
        (["n.x=1"], "n has no fields of its own to give one by one"),
        (["points=[{x:1}]"], 'is not JSON (Expecting property name enclosed in double quotes); write \'points=[{"x"'),
        (["points=" + "[" * 100000], "is not JSON (nested too deep)"),
        (["origin.at.x=1", "origin.at.x=2"], "origin.at.x is given twice"),
        (["origin=3", "origin.mode=moving"], "origin is given twice"),
        (["origin"], "'origin' is no assignment; write field=value, for example n=0"),
    ],
    ids=range(8),
)
def test_wrong_words_are_told(words: list[str], sentence: str) -> None:
    with pytest.raises(WirebondError) as caught:
        parse_assignments(SHAPES.model.message("scan"), words)
    assert sentence in str(caught.value)


def test_padding_is_no_field() -> None:
    with pytest.raises(WirebondError, match="streams has no field 'gap'"):
        parse_assignments(SHAPES.model.message("streams"), ["gap=1"])


def test_structs_are_shown_in_braces() -> None:
    assert values_text({"a": {"x": 1.5, "on": True}, "b": [{"y": 2}]}) == "a {x 1.5  on yes}  b [{y 2}]"


def test_simulator_makes_up_valid_values_of_every_shape() -> None:
    text = (Path(__file__).parent / "gen" / "every_shape.yaml").read_text(encoding="utf-8")
    proto = wirebond.Codec(wirebond.protocol.loads(text.replace("sender: mcu", "sender: mcu\n    every: 10 ms")))
    mcu = VirtualMcu(proto, 0.0)
    decoder = proto.decoder("mcu")
    seen = set()
    for step in range(50):
        for message in decoder.feed(mcu.tick(step * 0.013)):
            assert message.violations == []
            seen.add(message.name)
    assert seen == {m.name for m in proto.model.messages if m.sender == "mcu"}
