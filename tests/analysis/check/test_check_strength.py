"""Measures how many damaged frames pass, and compares that with the known strength of each check."""

from __future__ import annotations

import itertools

import pytest
from tests.analysis.check.files import made, shipped

from wirebond.analysis.check.check_strength import RULE, Strength, assess, measure_strength, uncovered
from wirebond.analysis.check.findings import Severity
from wirebond.analysis.check.places import Places
from wirebond.analysis.checksum import checksum

SAMPLES, SEED = 40_000, 7


def strength(name: str) -> Strength:
    return measure_strength(shipped(name), SAMPLES, SEED)


def test_the_high_byte_of_a_sum_lets_through_as_much_as_the_baseline_measured() -> None:
    """Seed 003's C listing: 72.6 % of bit-damaged frames, by a receiver that takes any id and any length."""
    found = strength("pid_tuner_listing")
    assert found.reference is not None
    assert found.reference.share == pytest.approx(0.726, abs=0.01)
    finding = assess(shipped("pid_tuner_listing").model, found, Places())[0]
    assert (finding.rule, finding.severity) == (RULE, Severity.WARNING)
    assert f"{100 * found.reference.share:.1f} % of those damaged where 1 bit in 10 000 is wrong" in finding.sentence
    assert "high byte of a sum" in finding.reason


def test_known_ids_and_sizes_refuse_some_of_it() -> None:
    """One wrong bit: refused in head, tail, length and check (4 of 18 bytes), nearly always in the id (1 of 18)."""
    share = strength("pid_tuner_listing").faults["1 bit"].share
    assert share == pytest.approx(13 / 18 * (1 - 255 / 256 / 8), abs=0.01)


def test_an_exclusive_or_misses_two_wrong_bits_of_one_column_and_no_odd_number() -> None:
    found = strength("diffdrive")
    assert found.faults["1 bit"].accepted == 0
    assert found.faults["3 bits"].accepted == 0
    columns = 8 * (7 * 6 / 2)  # pairs of equal bits among the seven bytes of data, reserve and check
    pairs = 88 * 87 / 2
    assert columns / pairs <= found.faults["2 bits"].share < columns / pairs + 0.005  # a few more by the id
    finding = assess(shipped("diffdrive").model, found, Places())[0]
    assert finding.severity == Severity.WARNING
    assert "with 2 bits wrong" in finding.sentence
    assert "1 bit " not in finding.sentence


@pytest.mark.parametrize("name", ["enterprize", "native"])
def test_a_crc_of_16_bits_sees_up_to_three_wrong_bits(name: str) -> None:
    protocol = shipped(name).model
    algorithm = next(part.algorithm for part in protocol.format.parts if part.algorithm is not None)
    size = protocol.max_wire_bytes()
    nothing = checksum(algorithm, bytes(size))
    changes = [1 << bit for bit in range(algorithm.width)]  # of the check, by each wrong bit of it and of the data
    for bit in range(8 * size):
        data = bytearray(size)
        data[bit // 8] = 1 << bit % 8
        changes.append(checksum(algorithm, bytes(data)) ^ nothing)
    assert len({0, *changes}) == len(changes) + 1  # one and two wrong bits
    assert not {first ^ second for first, second in itertools.combinations(changes, 2)} & set(changes)  # three
    found = strength(name)
    assert [found.faults[kind].accepted for kind in ("1 bit", "2 bits", "3 bits", "8-bit burst")] == [0, 0, 0, 0]
    assert assess(shipped(name).model, found, Places()) == []


def test_eight_bits_are_a_note() -> None:
    long_message = "{state: {id: 1, sender: mcu, fields: {x: {type: u8, count: 40}}}}"
    codec = made("[magic: 0xA5, id: u8, payload: by_id, check: crc-8/smbus]", long_message)
    found = measure_strength(codec, SAMPLES, SEED)
    assert 0.001 < found.faults["32-bit burst"].share < 0.005
    finding = assess(codec.model, found, Places())[0]
    assert finding.severity == Severity.NOTE
    assert "1 in 256" in finding.reason


def test_a_frame_without_a_check_is_reported() -> None:
    codec = made("[magic: 0xA5, id: u8, payload: by_id]")
    finding = assess(codec.model, measure_strength(codec, SAMPLES, SEED), Places())[0]
    assert "49.9 % with 1 bit wrong" in finding.sentence  # two of four bytes carry what only the range can tell
    assert "no check" in finding.reason


def test_a_sum_over_everything_misses_opposite_errors() -> None:
    codec = made("[magic: 0xA5, id: u8, payload: by_id, check: sum8]")
    found = measure_strength(codec, SAMPLES, SEED)
    assert found.faults["1 bit"].accepted == 0
    assert found.faults["2 bits"].share > 0.01
    assert "opposite sign" in assess(codec.model, found, Places())[0].reason


def test_a_command_left_out_of_the_sum_is_found() -> None:
    listing = shipped("pid_tuner_listing")
    found = uncovered(listing.model, Places())
    assert [(f.rule, f.sentence) for f in found] == [("uncovered-part", "no check covers the id")]
    assert uncovered(shipped("pid_tuner").model, Places()) == []


def test_a_frame_whose_id_gives_its_size_has_no_open_receiver() -> None:
    codec = made("[magic: 0xA5, id: u8, payload: by_id, check: xor8]")
    assert measure_strength(codec, 1000, SEED).reference is None


def test_the_same_seed_gives_the_same_figures() -> None:
    codec = shipped("pid_tuner")
    first = measure_strength(codec, 2000, 3)
    assert measure_strength(codec, 2000, 3) == first
    assert measure_strength(codec, 2000, 4) != first


def test_a_check_of_each_end_is_judged_by_that_ends_frames() -> None:
    """Both ends have a check in every frame; that of the MCU begins behind the id."""
    frame = """
  - magic: 0xDD
  - id: u8
  - length: u8
  - payload: by_length
  - {check: {type: sum16-negated, over: id..payload}, when: sender == host}
  - {check: {type: sum16-negated, over: length..payload}, name: reply_check, when: sender == mcu}
  - tail: 0x77
"""
    messages = "{a: {id: 3, sender: host, fields: {x: u16}}, b: {id: 4, sender: mcu, fields: {x: u16}}}"
    codec = made(frame, messages)
    [found] = uncovered(codec.model, Places())
    assert found.sentence == "no check covers the id of the MCU's frames"
    assert "let `over:` include `id`" in found.remedy
    finding = assess(codec.model, measure_strength(codec, 2000, 1), Places())[0]
    assert "in a sum two errors of opposite sign cancel" in finding.reason
