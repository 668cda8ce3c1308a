"""The measuring rules over the whole vocabulary of frames: the formats of the repository's tests."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.shared import loaded

from wirebond.analysis.check import check_strength, cut_frames, holdback, line_budget, noise, stuffing
from wirebond.analysis.check.damage import decode_blocks
from wirebond.analysis.check.frame_facts import senders, wire_bytes
from wirebond.analysis.check.places import Places
from wirebond.analysis.samples import asked, pool
from wirebond.codec import Codec

FORMATS = Path(__file__).parents[3] / "tests" / "formats"
NAMES = sorted(path.stem for path in FORMATS.glob("*.yaml"))
SAMPLES = 4000


def format_of(name: str) -> Codec:
    return loaded(FORMATS / f"{name}.yaml")


@pytest.mark.parametrize("name", NAMES)
def test_every_format_is_assessed(name: str) -> None:
    codec = asked(format_of(name))
    model = codec.model
    strength = check_strength.measure_strength(codec, SAMPLES, 1)
    assert strength.bit_errors.samples == SAMPLES  # few enough for frames that are decoded one by one
    check_strength.assess(model, strength, Places())
    check_strength.uncovered(model, Places())
    noises = [noise.measure_noise(codec, end, 200_000, 1) for end in senders(model)]
    noise.assess(model, noises, Places())
    holdback.assess(model, holdback.directions(codec, 1), Places())
    stuffing.assess(model, stuffing.measure_inserted_zero(codec, 1), Places())
    assert line_budget.budgets(model, line_budget.scheduled_loads(model))


@pytest.mark.parametrize("name", ["hdlc", "mavlink", "modbus_rtu", "slip", "whole"])
def test_a_crc_over_everything_sees_one_wrong_bit_in_every_framing(name: str) -> None:
    codec = format_of(name)
    strength = check_strength.measure_strength(codec, SAMPLES, 1)
    assert strength.faults["1 bit"].accepted == 0
    assert check_strength.assess(codec.model, strength, Places()) == []


def test_frames_that_silence_ends_are_decoded_one_by_one() -> None:
    codec = format_of("modbus_rtu")
    own = pool(codec, senders(codec.model)[0], 1)
    assert own is not None
    assert list(decode_blocks(own, own.frames)) == [1] * len(own.frames)


def test_a_check_in_hex_digits_takes_either_case() -> None:
    """One wrong bit turns `A` into `a`: the receiver reads the same number."""
    found = check_strength.measure_strength(format_of("nmea"), SAMPLES, 1).faults["1 bit"]
    assert 0 < found.share < 0.01


def test_a_zero_inserted_into_a_sum_passes_and_into_a_crc_with_final_xor_does_not() -> None:
    summed, crc = (stuffing.measure_inserted_zero(format_of(name), 1) for name in ("brackets", "hdlc"))
    assert summed is not None
    assert crc is not None
    assert summed.any_size.share == 1
    assert crc.any_size.accepted == 0


def test_the_pause_that_ends_a_frame_is_counted_as_line() -> None:
    """Modbus: address, id, four bytes, CRC; and 4 ms at 19200 baud with parity, 11 bits a byte."""
    model = format_of("modbus_rtu").model
    assert wire_bytes(model, senders(model)[0], 4) == 8 + 7


def test_the_usual_form_of_a_frame_is_what_the_line_budget_counts() -> None:
    """MAVLink 2 without its signature: 10 bytes of header, payload, 2 of check."""
    model = format_of("mavlink").model
    assert wire_bytes(model, senders(model)[0], 9) == 10 + 9 + 2


def test_texts_and_hex_digits_hold_no_delimiter() -> None:
    for name in ("nmea", "lines", "modbus_ascii"):
        assert cut_frames.assess(format_of(name), 1, Places()) == []
