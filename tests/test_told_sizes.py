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
from wirebond.explain import explain
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
    registers = REPLY[3:9]
    assert CODEC.encode("holding", registers=registers) == REPLY
    (reply,) = CODEC.decoder("mcu").feed(REPLY)
    assert reply.fields == {"byte_count": 6, "registers": registers}


def test_replies_of_every_length_and_shorter_errors_follow_each_other_without_a_pause() -> None:
    sent = [CODEC.encode("holding", registers=bytes(size)) for size in (0, 1, 250, 2)]
    sent.insert(2, CODEC.encode("read_error", code=2))
    for size in (1, 3, 4096):
        decoder = CODEC.decoder("mcu")
        stream = b"".join(sent)
        found = [m for at in range(0, len(stream), size) for m in decoder.feed(stream[at : at + size])]
        assert [m.raw for m in found] == sent
        assert decoder.stats.pending_bytes == 0


def test_a_frame_waits_for_no_byte_more_than_its_counts_tell() -> None:
    frame = CODEC.encode("two_counts", values=[1, -2], samples=[{"level": 1, "quality": 2}], inner={"text": "abc"})
    decoder = CODEC.decoder("host")
    assert decoder.feed(frame[:-1]) == []
    (message,) = decoder.feed(frame[-1:])
    assert message.fields["inner"] == {"size": 3, "text": "abc"}


def test_a_count_beyond_its_bound_is_a_false_start_at_once() -> None:
    decoder = CODEC.decoder("mcu")
    found = decoder.feed(bytes([0x11, 3, 251]) + REPLY)
    assert [m.raw for m in found] == [REPLY]
    assert decoder.stats.rejected_candidates["length_out_of_range"] >= 1
    stretch = explain(CODEC.model, bytes([0x11, 3, 251]) + bytes(6), End.MCU).stretches[0]
    assert stretch.summary == "payload: expected byte_count at most 250, found 251"


def test_counts_are_the_encoders() -> None:
    with pytest.raises(MessageError, match="byte_count"):
        CODEC.encode("holding", byte_count=3, registers=b"12")


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
    assert "two_counts" in names


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
