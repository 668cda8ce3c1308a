"""Good frames behind a false header are late, by the computed time: fed to the real decoder byte by byte."""

from __future__ import annotations

import pytest
from tests.analysis.check.files import made, shipped
from tests.shared import PROTOCOLS

import wirebond
from wirebond.analysis.check.findings import Severity
from wirebond.analysis.check.holdback import assess, directions, measure_hold_back
from wirebond.analysis.check.places import Places
from wirebond.protocol.model import End


def test_a_length_that_is_believed_holds_257_bytes_back() -> None:
    """Baseline, section 1, seed 003. In this project `max_payload` (13, by the longest message) bounds it."""
    for name in ("pid_tuner", "pid_tuner_listing"):
        codec = shipped(name)
        found = measure_hold_back(codec, End.HOST, 1)
        assert found is not None
        assert found.unbounded_bytes == 257
        assert found.unbounded_seconds == pytest.approx(257 * 10 / 115200)
        finding = assess(codec.model, [found], Places())[0]
        assert finding.severity == Severity.NOTE
        assert "without max_payload it would be 257 bytes, 22.3 ms" in finding.sentence
    codec = shipped("pid_tuner")
    found = measure_hold_back(codec, End.HOST, 1)
    assert found is not None
    assert found.bytes == 13 + 2  # payload, check and tail behind the header; read_gains has 6 bytes in all
    assert "15 bytes (1.3 ms) here" in assess(codec.model, [found], Places())[0].sentence


def test_every_form_of_a_frame_counts() -> None:
    """A frame of a VESC that begins with 3 has a length of two bytes. From the motor controller `max_payload` bounds
    it, from the host the longest message."""
    codec = wirebond.load(PROTOCOLS / "contrib" / "vesc.yaml")
    from_mcu, from_host = (measure_hold_back(codec, end, 1) for end in (End.MCU, End.HOST))
    assert from_mcu is not None
    assert from_host is not None
    assert (from_mcu.bytes, from_host.bytes) == (1026, 515)
    assert from_mcu.seconds == pytest.approx(0.089, abs=0.0005)
    assert "up to 1 026 bytes, 89.1 ms" in assess(codec.model, [from_host, from_mcu], Places())[0].sentence
    assert from_host.seconds == pytest.approx(0.045, abs=0.0005)


@pytest.mark.parametrize("name", ["native", "enterprize", "diffdrive"])
def test_delimiters_a_header_check_or_a_fixed_size_leave_nothing_to_say(name: str) -> None:
    codec = shipped(name)
    assert assess(codec.model, directions(codec, 1), Places()) == []


def test_a_long_payload_on_a_slow_line_is_a_warning() -> None:
    messages = "{a: {id: 1, sender: mcu, fields: {x: {type: bytes, max: 250}}}, b: {id: 2, sender: mcu}}"
    codec = made("[magic: 0xA5, length: u8, id: u8, payload: by_length, check: crc-16/mcrf4xx]", messages, baud=9600)
    finding = assess(codec.model, directions(codec, 1), Places())[0]
    assert finding.severity == Severity.WARNING
    assert "up to 252 bytes, 262 ms" in finding.sentence


def test_a_bound_above_the_longest_message_counts() -> None:
    """A newer peer may send messages so long, and the receiver waits for them."""
    messages = "{a: {id: 1, sender: mcu, fields: {x: {type: u32}}}, b: {id: 2, sender: mcu}}"
    frame = "[magic: 0xA5, length: u8, id: u8, payload: by_length, check: crc-16/mcrf4xx]"
    found = measure_hold_back(made(frame, messages, "max_payload: 255"), End.MCU, 1)
    assert found is not None
    assert found.bytes == 255 + 2  # payload and check behind the header


def test_an_end_that_sends_nothing_has_no_figure() -> None:
    assert measure_hold_back(made(), End.HOST, 1) is None
