"""If one end cannot change, `check` gives advice only to the owner of the other end."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from tests.shared import loaded

from wirebond.analysis.check import Finding, Severity, lint
from wirebond.codec import Codec
from wirebond.protocol import loads, protocol_hash

CONTRIB = sorted((Path(__file__).parents[3] / "protocols" / "contrib").glob("*.yaml"))
TEXT = """
wirebond: 1
protocol: device
link: {baud: 9600}
frame: [magic: 0xFF, {length: {type: u16}}, id: u8, payload: by_length, {check: {type: xor8, over: payload}}]
max_payload: 900
unknown: reject
messages:
  drive: {id: 1, sender: host, every: 20 ms, fields: {speed: {type: i16}, rest: {type: bytes, max: 60}}}
  state: {id: 1, sender: mcu, every: 10 ms, queue: urgent, fields: {x: {type: i16}}}
  long:  {id: 2, sender: mcu, fields: {data: {type: bytes, max: 500}}}
  rare:  {id: 3, sender: mcu, fields: {x: {type: i16}}}
deadlines:
  - {message: state, at: host, after: 11 ms, then: warn}
  - {message: rare, at: host, after: 1 s, then: warn}
"""
# Words of a remedy that only the maker of the fixed end, or of the format, can follow.
NOT_OURS = re.compile(
    r"if the format|take `?check|take a CRC|take a check|crc-16/ibm|check of its own|delimiters|the peer|"
    r"let `over:`|max_run|ids of their own|shorten the frames|send it more often|add `deadlines|`0x80"
)


def found(fixed: str) -> dict[str, Finding]:
    text = TEXT if not fixed else TEXT.replace("link:", f"fixed: {fixed}\nlink:")
    return {finding.rule: finding for finding in lint(Codec(loads(text))).findings}


def test_without_it_the_format_is_ours_to_change() -> None:
    rules = found("")
    assert NOT_OURS.search(rules["check-strength"].remedy)
    assert {"frequent-magic", "urgent-wait", "hold-back", "shared-id", "uncovered-part"} <= rules.keys()
    assert sum(bool(NOT_OURS.search(finding.remedy)) for finding in rules.values()) >= 8


@pytest.mark.parametrize("fixed", ["mcu", "both"])
def test_with_a_fixed_device_every_remedy_is_the_hosts(fixed: str) -> None:
    rules = found(fixed)
    assert not [finding for finding in rules.values() if NOT_OURS.search(finding.remedy)]
    assert not {"frequent-magic", "urgent-wait"} & rules.keys()
    assert rules["check-strength"].severity == rules["uncovered-part"].severity == Severity.NOTE
    assert rules["hold-back"].remedy == "lower `max_payload` to the largest message that you need"
    assert "how often the device sends it" in rules["unscheduled-deadline"].remedy
    assert rules["tight-deadline"].remedy == "write `after: 30 ms` or more"
    assert ("no-emergency-stop" in rules) == (fixed == "mcu")


def test_a_fixed_host_leaves_the_devices_queue_to_us() -> None:
    rules = found("host")
    assert "frequent-magic" not in rules
    assert not {"no-emergency-stop", "no-deadline"} & rules.keys()
    long_runs = TEXT.replace("baud: 9600", "baud: 9600, max_run: 100 ms").replace("max: 500", "max: 4")
    for fixed in ("host", "mcu", "both"):
        findings = lint(Codec(loads(long_runs.replace("link:", f"fixed: {fixed}\nlink:")))).findings
        remedies = [finding.remedy for finding in findings if finding.rule == "urgent-wait"]
        assert ["max_run" in remedy for remedy in remedies] == ([True] if fixed == "host" else [])


def test_it_changes_no_byte() -> None:
    assert protocol_hash(loads(TEXT)) == protocol_hash(loads(TEXT.replace("link:", "fixed: mcu\nlink:")))


@pytest.mark.parametrize(
    "path",
    [pytest.param(path, id=path.stem, marks=[pytest.mark.long] if n % 4 else []) for n, path in enumerate(CONTRIB)],
)
def test_no_public_format_is_asked_to_change(path: Path) -> None:
    codec = loaded(path)
    if codec.model.fixed is None:
        pytest.skip("a format for devices of one's own")
    assert not [finding for finding in lint(codec).findings if NOT_OURS.search(finding.remedy)]
