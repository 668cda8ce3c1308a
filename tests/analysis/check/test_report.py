"""All rules together: silent where nothing is wrong, worst first, at the right place, and the same each time."""

from __future__ import annotations

import functools
import json

import pytest
from tests.analysis.check.files import PROTOCOLS, made, shipped

from wirebond.analysis.check import Places, Report, Severity, lint
from wirebond.codec import Codec, load
from wirebond.protocol import loads


@functools.cache
def report(name: str, traffic: str | None = None) -> Report:
    codec = load(PROTOCOLS / f"{name}.yaml")
    return lint(codec, Places.of_text(codec.model.text), traffic=traffic)


def test_the_recommended_format_has_no_finding() -> None:
    found = report("native")
    assert found.findings == ()
    assert found.inserted_zero is not None
    assert found.inserted_zero.any_size.accepted == 0


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("diffdrive", {"check-strength"}),
        ("pid_tuner", {"check-strength", "hold-back"}),
        ("pid_tuner_listing", {"check-strength", "uncovered-part", "hold-back", "no-deadline", "no-emergency-stop"}),
        ("enterprize", {"no-deadline", "no-emergency-stop"}),
    ],
)
def test_the_seeds_protocols_have_the_findings_of_the_baseline(name: str, expected: set[str]) -> None:
    found = report(name)
    assert {finding.rule for finding in found.findings} == expected
    assert found.number_of(Severity.ERROR) == 0
    assert all(finding.line > 0 for finding in found.findings)


def test_a_crc_without_final_xor_under_cobs_is_reported_once() -> None:
    text = (PROTOCOLS / "native.yaml").read_text(encoding="utf-8").replace("crc-16/ibm-sdlc", "crc-16/mcrf4xx")
    found = lint(Codec(loads(text)))
    assert [finding.rule for finding in found.findings] == ["inserted-zero"]
    assert 0.005 < found.strength.faults["1 bit"].share < 0.02  # the lowest bit of a delimiter


def test_findings_stand_at_the_line_that_causes_them() -> None:
    lines = (PROTOCOLS / "pid_tuner.yaml").read_text(encoding="utf-8").splitlines()
    at = {finding.rule: lines[finding.line - 1] for finding in report("pid_tuner").findings}
    assert "- check:" in at["check-strength"]
    assert "- length:" in at["hold-back"]


def test_errors_come_first() -> None:
    found = report("enterprize", traffic="mcu:47=3992").findings
    assert [finding.severity for finding in found] == [Severity.ERROR, Severity.NOTE, Severity.NOTE]


def test_a_protocol_without_a_file_has_findings_without_a_place() -> None:
    found = lint(made("[magic: 0xA5, id: u8, payload: by_id]")).findings
    assert found
    assert {(finding.line, finding.column) for finding in found} == {(0, 0)}


def test_the_figures_are_json_and_the_same_each_time() -> None:
    first = json.dumps(report("diffdrive").as_dict(), allow_nan=False)
    codec = shipped("diffdrive")
    again = lint(codec, Places.of_text(codec.model.text))
    assert json.dumps(again.as_dict(), allow_nan=False) == first
    strength = json.loads(first)["figures"]["check_strength"]
    assert strength["accepted"]["2 bits"]["share"] == pytest.approx(0.046, abs=0.004)


def test_messages_of_every_field_type_are_sampled() -> None:
    messages = """
  everything:
    id: 1
    sender: both
    fields:
      a: {type: u64}
      b: {type: i24, scale: 0.3, offset: -1, range: [-2, 2]}
      c: {type: f64}
      d: {type: u8, flags: {x: 0, y: 7}}
      e: {type: bool, count: 3}
      f: {type: text, size: 5}
      g: {type: i8, range: [-3, 3]}
      h: {type: f32, range: [-0.1, 0.1], count: 2}
      i: {type: bytes, max: 9}
"""
    assert lint(made(messages=messages)).strength.bit_errors.samples > 1000


def test_an_end_that_sends_nothing_and_messages_without_fields_are_no_trouble() -> None:
    found = lint(made(messages="{beat: {id: 1, sender: mcu}}"))
    assert [each.sender for each in found.noise] == ["mcu"]
    assert shipped("pid_tuner_listing").model.message("pid").sender == "host"
    assert [each.sender for each in report("pid_tuner_listing").budgets] == ["host"]


def test_places_in_a_text_that_is_no_yaml_are_unknown() -> None:
    assert Places.of_text("messages: [").at("messages").line == 0
