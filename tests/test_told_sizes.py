"""Payloads that tell their own size by counts among their fields, in formats without a length and without silence."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from tests import reference
from tests.conformance.build import build_decoder, decode
from tests.shared import ROOT, account_closes
from tests.streams import Speaker, chunks, hard_pieces
from wirebond import MessageError, load
from wirebond.analysis.checksum import checksum
from wirebond.analysis.explain import explain
from wirebond.protocol.algorithms import ALGORITHMS
from wirebond.protocol.model import End

CODEC = load(ROOT / "tests" / "formats" / "told_sizes.yaml")

# Printed by https://www.simplymodbus.ca/FC03.htm
REQUEST = bytes.fromhex("11 03 00 6B 00 03 76 87")
REPLY = bytes.fromhex("11 03 06 AE 41 56 52 43 40 49 AD")


def hard_frames(source: random.Random, pieces: int) -> bytes:
    """Frames whose checks hold, with payloads that are cut or changed, between what misleads decoders."""
    speaker = Speaker(CODEC)
    return b"".join(hard_pieces(lambda: speaker.any(source), source, pieces))


def test_real_frames_are_read_and_written() -> None:
    assert CODEC.encode("read_holding", first=0x6B, number=3) == REQUEST
    (request,) = CODEC.decoder("host").feed(REQUEST)
    assert request.fields == {"first": 0x6B, "number": 3}
    registers = [0xAE41, 0x5652, 0x4340]
    assert CODEC.encode("holding", registers=registers) == REPLY
    (reply,) = CODEC.decoder("mcu").feed(REPLY)
    assert reply.fields == {"byte_count": 6, "registers": registers}


def test_replies_of_every_length_and_shorter_errors_follow_each_other_without_a_pause() -> None:
    sent = [CODEC.encode("holding", registers=[7] * number) for number in (0, 1, 125, 2)]
    sent.insert(2, CODEC.encode("read_error", code=2))
    for size in (1, 3, 4096):
        decoder = CODEC.decoder("mcu")
        stream = b"".join(sent)
        found = [m for at in range(0, len(stream), size) for m in decoder.feed(stream[at : at + size])]
        assert [m.raw for m in found] == sent
        assert decoder.stats.pending_bytes == 0


def test_a_frame_waits_for_no_more_bytes_than_its_counts_give() -> None:
    frame = CODEC.encode("two_counts", values=[1, -2], samples=[{"level": 1, "quality": 2}], inner={"text": "abc"})
    decoder = CODEC.decoder("host")
    assert decoder.feed(frame[:-1]) == []
    (message,) = decoder.feed(frame[-1:])
    assert message.fields["inner"] == {"size": 3, "text": "abc"}


def test_columns_read_what_bits_count() -> None:
    """The bits are columns of their own, and one of them says how long the list behind them is."""
    frames = [
        CODEC.encode("in_bits", head={"kind": 1}, levels=[*range(n)], samples=[], name={"text": "x" * n})
        for n in (0, 3, 9)
    ]
    columns = CODEC.decode_columns(b"".join(frames), sender="host")
    table = columns["in_bits"]
    assert list(table["head.number"]) == [0, 3, 9]
    assert [list(levels) for levels in table["levels"]] == [list(range(n)) for n in (0, 3, 9)]


def test_a_count_beyond_its_bound_is_a_false_start_at_once() -> None:
    decoder = CODEC.decoder("mcu")
    found = decoder.feed(bytes([0x11, 3, 251]) + REPLY)
    assert [m.raw for m in found] == [REPLY]
    assert decoder.stats.rejected_candidates["length_out_of_range"] >= 1
    stretch = explain(CODEC.model, bytes([0x11, 3, 251]) + bytes(6), End.MCU).stretches[0]
    assert stretch.summary == "payload: expected byte_count at most 250, found 251"


def test_counts_are_the_encoders() -> None:
    assert CODEC.encode("holding", byte_count=4, registers=[1, 2]) == CODEC.encode("holding", registers=[1, 2])
    with pytest.raises(MessageError, match=r"holding\.byte_count is 3, and .* has 4 bytes; leave byte_count out"):
        CODEC.encode("holding", byte_count=3, registers=[1, 2])
    with pytest.raises(MessageError, match=r"in_bits\.head\.number is 1, and in_bits\.levels, .* has 2 elements"):
        CODEC.encode("in_bits", head={"kind": 0, "number": 1}, levels=[1, 2])


def test_a_count_may_be_bytes_or_bits_and_two_may_count_one_list() -> None:
    sent = CODEC.encode("write_many", first=1, registers=[10, 11, 12])
    assert sent[2:7].hex() == "0001000306"
    (written,) = CODEC.decoder("host").feed(sent)
    assert written.fields == {"first": 1, "number": 3, "byte_count": 6, "registers": [10, 11, 12]}
    sample = {"level": 1, "quality": 2}
    sent = CODEC.encode("in_bits", head={"kind": 5}, levels=[1, -2], samples=[sample] * 20, name={"text": "abc"})
    assert sent[2:4] == bytes([0b101_0010_0, 60])
    (received,) = CODEC.decoder("host").feed(sent)
    assert received.fields["head"] == {"kind": 5, "number": 2, "size": 60}
    assert received.fields["name"] == {"of": {"size": 3}, "text": "abc"}
    assert (received.fields["levels"], received.fields["samples"]) == ([1, -2], [sample] * 20)


@pytest.mark.parametrize(
    ("payload", "sender", "sentence"),
    [
        ("03 03 0001", End.MCU, "byte_count a multiple of 2, found 3"),
        ("03 FC 0001", End.MCU, "byte_count at most 250, found 252"),
        ("10 0001 0002 06 0001 0002 0003", End.HOST, "byte_count 4, found 6"),
        ("10 0001 0002 02 0001", End.HOST, "byte_count 4, found 2"),
        ("42 0007 7E 0001 02 0003 04", End.HOST, "head.size a multiple of 3, found 7"),
    ],
)
def test_a_count_of_bytes_that_is_no_number_of_elements_is_a_false_start(
    payload: str, sender: End, sentence: str
) -> None:
    body = bytes([0x11]) + bytes.fromhex(payload)
    frame = body + checksum(ALGORITHMS["crc-16/modbus"], body).to_bytes(2, "little")
    decoder = CODEC.decoder(sender)
    assert [m.name for m in decoder.feed(frame) + decoder.finish()] == []
    assert decoder.stats.rejected_candidates["length_out_of_range"] >= 1
    assert reference.decode(CODEC.model, frame, sender).frames == []
    assert explain(CODEC.model, frame, sender).stretches[0].summary == f"payload: expected {sentence}"


LONGER = """
wirebond: 1
protocol: longer
byte_order: big
frame: [magic: 0xA5, length: u8, id: u8, payload: by_length, check: crc-8/smbus]
messages:
  readings:
    id: 1
    sender: mcu
    fields:
      {size: {type: u8}, number: {type: u8}, values: {type: u16, count: {elements: number, bytes: size}, max: 4}}
  marked:
    id: 2
    sender: mcu
    fields:
      {size: {type: u8}, values: {type: u16, count: {bytes: size}, max: 4}, end: {type: u8, constant: 0x7E}}
"""


def framed(body: bytes) -> bytes:
    whole = bytes([0xA5, len(body) - 1]) + body
    return whole + bytes([checksum(ALGORITHMS["crc-8/smbus"], whole)])


def test_with_a_length_wrong_counts_are_violations(tmp_path: Path) -> None:
    file = tmp_path / "longer.yaml"
    file.write_text(LONGER)
    codec = load(file)
    for counts, values, faults in (
        ((4, 2), [1, 2], []),
        ((3, 1), [1], ["readings.size says 3 bytes, and readings.values has 2 for each element"]),
        ((2, 2), [1, 2], ["readings.size says 2 bytes, and readings.values has 4 in this payload"]),
        ((10, 2), [1, 2], ["readings.size says 10 bytes, and readings.values has at most 8"]),
    ):
        elements = b"".join(value.to_bytes(2, "big") for value in values)
        (message,) = codec.decoder("mcu").feed(framed(bytes([1, *counts]) + elements))
        assert message.fields["values"] == values
        assert message.violations == faults


def test_a_constant_after_bytes_that_are_no_number_of_elements_has_no_place(tmp_path: Path) -> None:
    file = tmp_path / "longer.yaml"
    file.write_text(LONGER)
    codec = load(file)
    frame = framed(bytes.fromhex("02 03 0001 7E 7E"))
    decoder = codec.decoder("mcu")
    assert decoder.feed(frame) + decoder.finish() == []
    assert decoder.stats.rejected_candidates["constant_mismatch"] >= 1
    assert reference.decode(codec.model, frame, End.MCU).frames == []
    (stretch, *_) = explain(codec.model, frame, End.MCU).stretches
    assert stretch.summary == "constant field: expected size a multiple of 2, found 3"


@pytest.mark.parametrize("sender", [End.HOST, End.MCU])
def test_engine_and_reference_agree_however_the_stream_is_cut(sender: End) -> None:
    names = set()
    for seed in range(8):
        source = random.Random(f"{sender} {seed}")
        stream = hard_frames(source, 60)
        expected = reference.decode(CODEC.model, stream, sender)
        decoder = CODEC.decoder(sender)
        found = []
        for chunk in chunks(stream, source):
            found += decoder.feed(chunk)
            assert account_closes(decoder.stats)
        found += decoder.finish()
        assert [(m.offset, m.raw, m.name) for m in found] == [(f.offset, f.wire, f.name) for f in expected.frames]
        assert decoder.stats.as_dict()["discarded_bytes"] == dict(expected.discarded_bytes)
        assert decoder.stats.as_dict()["rejected_candidates"] == dict(expected.rejected_candidates)
        names |= {m.name for m in found}
    assert {"two_counts", "in_bits"} <= names


@pytest.mark.live
def test_generated_code_agrees(tmp_path: Path) -> None:
    stream = hard_frames(random.Random(5), 300)
    file = tmp_path / "stream.bin"
    file.write_bytes(stream)
    decoder = CODEC.decoder("mcu")
    messages = decoder.feed(stream) + decoder.finish()
    for run_time in (False, True):
        program = build_decoder(CODEC.model, End.MCU, run_time=run_time)
        for chunk in (0, 1, 4096):
            result = decode(program, file, chunk=chunk, seed=1)
            assert [(f.offset, f.wire, f.id) for f in result.frames] == [(m.offset, m.raw, m.id) for m in messages]
            for cause, count in decoder.stats.rejected_candidates.items():
                assert result.account[f"rejected.{cause}"] == count
