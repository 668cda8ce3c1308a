"""Formats that nobody wrote: random files, random messages, hard streams; the engine against the slow reference."""

from __future__ import annotations

import random

import pytest

from tests import reference
from tests.random_formats import random_protocol
from tests.shared import account_closes
from tests.streams import chunks, hard_stream, random_frame
from wirebond import Codec, ProtocolFileError
from wirebond.protocol import loads
from wirebond.protocol.model import End


def readable_protocol(source: random.Random, seed: int) -> str:
    """Most drawn files load; some break a rule of the loader (a length too small for its offset, say)."""
    for _ in range(20):
        text = random_protocol(source, seed)
        try:
            loads(text)
        except ProtocolFileError:
            continue
        return text
    raise AssertionError("twenty drawn files in a row do not load")


def check_format(seed: int, messages: int) -> None:
    source = random.Random(f"format {seed}")
    text = readable_protocol(source, seed)
    proto = Codec(loads(text))
    stuffed = proto.model.frame.stuffing != "none" or proto.model.frame.delimiter is None
    for _ in range(messages // 5 if stuffed else 0):
        frame = random_frame(proto, source)
        decoder = proto.decoder()
        found = decoder.feed(frame) + decoder.finish()
        assert [m.raw for m in found] == [frame], text
        if found[0].name != "unknown":
            again = proto.encode(found[0].name, found[0].fields, header=found[0].header)
            assert again == frame, text
    for sender in (None, End.HOST, End.MCU):
        stream = hard_stream(proto, source, pieces=messages // 3)
        expected = reference.decode(proto.model, stream, sender)
        decoder = proto.decoder(sender)
        delivered = []
        for chunk in chunks(stream, source):
            delivered += decoder.feed(chunk)
            assert account_closes(decoder.stats)
        delivered += decoder.finish()
        found = [reference.Frame(m.offset, m.raw, m.id, m.name) for m in delivered]
        assert found == expected.frames, text
        stats = decoder.stats.as_dict()
        assert stats["discarded_bytes"] == dict(expected.discarded_bytes), text
        assert stats["rejected_candidates"] == dict(expected.rejected_candidates), text
        assert stats["fill_bytes"] == expected.fill_bytes, text


@pytest.mark.parametrize("seed", range(10))
def test_engine_and_reference_agree_on_random_formats(seed: int) -> None:
    for i in range(12):
        check_format(1000 * seed + i, messages=60)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(100))
def test_engine_and_reference_agree_on_ten_thousand_random_formats(seed: int) -> None:
    for i in range(100):
        check_format(100_000 + 1000 * seed + i, messages=100)
