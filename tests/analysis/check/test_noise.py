"""False frames in random bytes: what is worked out is what is counted, where there is enough to count."""

from __future__ import annotations

import pytest
from tests.analysis.check.files import made, shipped

from wirebond.analysis.check.noise import assess, measure_noise
from wirebond.analysis.check.places import Places
from wirebond.protocol.model import End

MESSAGES = "{a: {id: 1, sender: mcu, fields: {x: {type: i16}}}, b: {id: 2, sender: mcu, fields: {y: {type: u8}}}}"
TEXT = "{note: {id: 1, sender: mcu, fields: {text: {type: bytes, max: 40}}}}"


@pytest.mark.parametrize(
    ("frame", "messages", "rest"),
    [
        ("[magic: 0xA5, id: u8, payload: by_id]", MESSAGES, ""),
        ("[magic: 0xA5, payload: 3, check: xor8]", "{a: {sender: mcu, fields: {x: {type: i16}}}}", ""),
        ("[magic: 0xA5, length: u8, payload: by_length, check: xor8]", TEXT.replace("id: 1, ", ""), ""),
        ("[magic: 0xA5, length: u8, id: u8, payload: by_length, check: xor8]", TEXT, "unknown: deliver"),
        ("[delimiter: 0x00, cobs: [payload: rest], delimiter: 0x00]", TEXT.replace("id: 1, ", ""), ""),
        ("[delimiter: 0x00, cobs: [id: u8, payload: rest], delimiter: 0x00]", TEXT, "unknown: deliver"),
        (
            "[delimiter: 0x00, cobs: [payload: rest], delimiter: 0x00]",
            "{a: {sender: mcu, fields: {x: {type: bytes, max: 600}}}}",
            "",
        ),
    ],
)
def test_the_rate_worked_out_is_the_rate_counted(frame: str, messages: str, rest: str) -> None:
    noise = measure_noise(made(frame, messages, rest), End.MCU, 64_000_000, 1)
    assert noise.frames > 100
    tolerance = max(0.05, 4 / noise.frames**0.5)
    assert noise.measured == pytest.approx(noise.expected, rel=tolerance)


def test_noise_that_yields_frames_is_a_finding() -> None:
    codec = made("[magic: 0xA5, id: u8, payload: by_id]", MESSAGES)
    noise = measure_noise(codec, End.MCU, 1_000_000, 1)
    finding = assess(codec.model, [noise], Places())[0]
    assert f"{noise.measured:.3g} false frames a million (MCU to host)" in finding.sentence
    assert "11 520 a second" in finding.reason


@pytest.mark.parametrize("name", ["native", "enterprize", "diffdrive", "pid_tuner"])
def test_formats_that_noise_does_not_pass_say_how_rare_it_is(name: str) -> None:
    codec = shipped(name)
    noise = measure_noise(codec, End.HOST, 1_000_000, 1)
    assert noise.frames == 0
    assert noise.at_most == pytest.approx(3.0)
    assert 0 < noise.expected < 1e-3
    assert assess(codec.model, [noise], Places()) == []
