"""Values from the words of a command line, and made-up values of the simulator, for every shape of fields."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import wirebond
from wirebond import WirebondError
from wirebond.cli.shown import values_text
from wirebond.cli.values import parse_assignments
from wirebond.sim.virtual_mcu import VirtualMcu

SHAPES = wirebond.load(Path(__file__).parent / "generate" / "code" / "every_shape.yaml")


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
        (["origin"], "'origin' is not an assignment; write field=value, for example origin.at=0"),
        (['points=[{"x": 1, "y": 2, "x": 3}]'], "points has 'x' twice in one JSON object; give it once"),
        (['origin={"at": {"x": 1, "x": 1}}'], "origin has 'x' twice in one JSON object; give it once"),
        (["origin.at.x=1_0"], "x is '1_0'; expected a number"),
        (["origin.at.x=1_0.5"], "x is '1_0.5'; expected a number"),
        (["origin.at.x=0x1_0"], "x is '0x1_0'; expected a number"),
        (["origin.at.x=\u0661\u0662"], "x is '\u0661\u0662'; expected a number"),
        (["echoes=1,\uff12"], "echoes is '\uff12'; expected a number"),
        (["echoes=1,,2"], "echoes is '1,,2'; a value is missing next to a comma"),
        (["echoes=1,2,"], "echoes is '1,2,'; a value is missing next to a comma"),
        (["echoes=[1,2"], "echoes is '[1,2'; write 'echoes=[1, 2]', or without brackets"),
    ],
    ids=range(18),
)
def test_wrong_words_are_told(words: list[str], sentence: str) -> None:
    with pytest.raises(WirebondError) as caught:
        parse_assignments(SHAPES.model.message("scan"), words)
    assert sentence in str(caught.value)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("12", 12), ("-7", -7), ("+7", 7), ("007", 7), ("0x1F", 31), ("-0b11", -3), ("0o17", 15), ("0.5", 0.5),
        (".5", 0.5), ("5.", 5.0), ("1e3", 1000.0), ("-2.5E-1", -0.25),
    ],
)  # fmt: skip
def test_numbers_are_written_as_usual(text: str, value: float) -> None:
    given = parse_assignments(SHAPES.model.message("scan"), [f"origin.at.x={text}"])
    assert given == {"origin": {"at": {"x": value}}}


def test_a_whole_number_in_json_may_have_any_number_of_digits() -> None:
    """`encode` refuses such a number, as it does one that stands by itself."""
    values = parse_assignments(SHAPES.model.message("scan"), ['points=[{"x": ' + "1" * 5000 + "}]"])
    assert values == {"points": [{"x": float("inf")}]}


def test_nothing_is_an_empty_list() -> None:
    message = SHAPES.model.message("scan")
    assert parse_assignments(message, ["echoes="]) == parse_assignments(message, ["echoes=[]"]) == {"echoes": []}


def test_padding_is_no_field() -> None:
    with pytest.raises(WirebondError, match="streams has no field 'gap'"):
        parse_assignments(SHAPES.model.message("streams"), ["gap=1"])


def test_structs_are_shown_in_braces() -> None:
    assert values_text({"a": {"x": 1.5, "on": True}, "b": [{"y": 2}]}) == "a.x 1.5  a.on yes  b.y [2]"


def test_simulator_makes_up_valid_values_of_every_shape() -> None:
    text = (Path(__file__).parent / "generate" / "code" / "every_shape.yaml").read_text(encoding="utf-8")
    proto = wirebond.Codec(wirebond.protocol.loads(text.replace("sender: mcu", "sender: mcu\n    every: 10 ms")))
    mcu = VirtualMcu(proto, 0.0)
    decoder = proto.decoder("mcu")
    seen = set()
    for step in range(50):
        for message in decoder.feed(mcu.tick(step * 0.013)):
            assert message.violations == []
            seen.add(message.name)
    assert seen == {m.name for m in proto.model.messages if m.sender == "mcu"}
