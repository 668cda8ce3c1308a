"""Under `unknown: reject` a payload that is longer than the counts in it tell is a false start, at every end."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from tests import reference
from tests.conformance.build import build_decoder, decode
from tests.shared import ROOT, account_closes
from tests.streams import Speaker, chunks, hard_pieces
from wirebond import Codec, load
from wirebond.analysis.checksum import checksum
from wirebond.analysis.explain import explain
from wirebond.protocol import loads
from wirebond.protocol.algorithms import ALGORITHMS
from wirebond.protocol.model import End

FILE = ROOT / "tests" / "formats" / "counted.yaml"
CODEC = load(FILE)
DELIVERING = Codec(loads(FILE.read_text() + "unknown: deliver\n"))


def framed(number: int, payload: bytes) -> bytes:
    whole = bytes([0xA5, len(payload), number]) + payload
    return whole + bytes([checksum(ALGORITHMS["crc-8/smbus"], whole)])


def payload_of(name: str, /, **values: object) -> bytes:
    return CODEC.encode(name, values)[3:-1]


# id, sender, a payload that is right, and where bytes are put in that no count tells.
LONGER = [
    (1, End.MCU, payload_of("readings", values=[1, 2]), 5),
    (1, End.MCU, payload_of("readings", values=[]), 1),
    (2, End.MCU, payload_of("named", name="abc", rows=[{"at": 1, "level": -2}], sizes={"free": 0}), 9),
    (3, End.HOST, payload_of("in_bytes", values=[7], shape=[{"label": "ab"}, {"label": ""}]), 8),
    (4, End.MCU, payload_of("mixed", label="twelve bytes", values=[1], rest=[5] * 30), 46),
]


@pytest.mark.parametrize(("number", "sender", "payload", "at"), LONGER)
def test_a_payload_longer_than_its_counts_allow_is_a_false_start(
    number: int, sender: End, payload: bytes, at: int
) -> None:
    good = framed(number, payload)
    inner = CODEC.encode("fixed", value=7)  # whole, within the bytes that no count tells
    longer = framed(number, payload[:at] + inner + payload[at:])
    for size in (1, 5, 4096):
        decoder = CODEC.decoder(sender)
        stream = good + longer + good
        found = [m for place in range(0, len(stream), size) for m in decoder.feed(stream[place : place + size])]
        assert [m.raw for m in found] == [good, inner, good]
        assert decoder.stats.rejected_candidates["unknown_message"] >= 1
        assert decoder.stats.discarded_bytes["unknown_message"] == len(longer) - len(inner)
        assert account_closes(decoder.stats)
    columns = CODEC.decode_columns(good + longer + good, sender=sender)
    name = next(m.name for m in CODEC.model.messages if m.id == number)
    assert len(columns[name]) == 2


@pytest.mark.parametrize(("number", "sender", "payload", "at"), LONGER)
def test_where_unknown_is_delivered_the_rest_is_ignored(number: int, sender: End, payload: bytes, at: int) -> None:
    longer = framed(number, payload + bytes(4))
    if len(longer) - 4 > DELIVERING.model.format.max_payload:
        pytest.skip("the longest payload of the format")
    (message,) = DELIVERING.decoder(sender).feed(longer)
    assert (message.id, message.raw) == (number, longer)
    assert message.fields == DELIVERING.decoder(sender).feed(framed(number, payload))[0].fields


def test_it_explains_the_counts() -> None:
    (stretch, *_) = explain(CODEC.model, framed(1, bytes.fromhex("02 0100 0200 0300")), End.MCU).stretches
    assert stretch.cause == "unknown_message"
    assert stretch.summary == "payload: expected at most 5 payload bytes with number 2 for readings, found 7"
    (guess,) = stretch.guesses
    assert guess.what == "Everything holds, but readings has at most 5 payload bytes with number 2, and here are 7."


def hard_frames(source: random.Random, pieces: int) -> bytes:
    speaker = Speaker(CODEC)
    return b"".join(hard_pieces(lambda: speaker.any(source), source, pieces))


@pytest.mark.parametrize("seeds", [range(4), pytest.param(range(4, 12), marks=pytest.mark.long)])
@pytest.mark.parametrize("sender", [End.HOST, End.MCU])
def test_engine_and_slow_decoder_agree_however_the_stream_is_cut(sender: End, seeds: range) -> None:
    refused = 0
    for seed in seeds:
        source = random.Random(f"{sender} {seed}")
        stream = hard_frames(source, 60)
        expected = reference.decode(CODEC.model, stream, sender)
        decoder = CODEC.decoder(sender)
        found = [message for chunk in chunks(stream, source) for message in decoder.feed(chunk)]
        found += decoder.finish()
        assert [(m.offset, m.raw, m.name) for m in found] == [(f.offset, f.wire, f.name) for f in expected.frames]
        assert decoder.stats.as_dict()["discarded_bytes"] == dict(expected.discarded_bytes)
        assert decoder.stats.as_dict()["rejected_candidates"] == dict(expected.rejected_candidates)
        refused += expected.rejected_candidates["unknown_message"]
    assert refused > 50


@pytest.mark.live
@pytest.mark.parametrize("sender", [End.HOST, End.MCU])
def test_generated_code_agrees(sender: End, tmp_path: Path) -> None:
    stream = hard_frames(random.Random(5), 300)
    file = tmp_path / "stream.bin"
    file.write_bytes(stream)
    decoder = CODEC.decoder(sender)
    messages = decoder.feed(stream) + decoder.finish()
    for run_time in (False, True):
        program = build_decoder(CODEC.model, sender, run_time=run_time)
        for chunk in (0, 1, 4096):
            result = decode(program, file, chunk=chunk, seed=1)
            assert [(f.offset, f.wire, f.id) for f in result.frames] == [(m.offset, m.raw, m.id) for m in messages]
            for cause, count in decoder.stats.rejected_candidates.items():
                assert result.account[f"rejected.{cause}"] == count
