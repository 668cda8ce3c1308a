"""The engine against a slow and obvious decoder: every frame, every discard by cause, every sum."""

from __future__ import annotations

import random

import pytest

from tests import reference
from tests.shared import account_closes, codec
from tests.streams import chunks, hard_stream
from wirebond.protocol.model import End

NAMES = ["diffdrive", "enterprize", "pid_tuner", "pid_tuner_listing", "native"]


@pytest.mark.parametrize("sender", [None, End.HOST, End.MCU])
@pytest.mark.parametrize("name", NAMES)
def test_engine_and_reference_agree_on_hard_streams(name: str, sender: End | None) -> None:
    proto = codec(name)
    for seed in range(25):
        source = random.Random(f"{name} {sender} {seed}")
        stream = hard_stream(proto, source, pieces=60)
        expected = reference.decode(proto.model, stream, sender)

        decoder = proto.decoder(sender)
        messages = []
        for chunk in chunks(stream, source):
            messages += decoder.feed(chunk)
            assert account_closes(decoder.stats)
        messages += decoder.finish()

        found = [reference.Frame(m.offset, m.raw, m.id, m.name) for m in messages]
        assert found == expected.frames, f"seed {seed}"
        stats = decoder.stats.as_dict()
        assert stats["discarded_bytes"] == dict(expected.discarded_bytes), f"seed {seed}"
        assert stats["rejected_candidates"] == dict(expected.rejected_candidates), f"seed {seed}"
        assert (stats["fill_bytes"], stats["pending_bytes"]) == (expected.fill_bytes, 0)
        assert stats["bytes"] == len(stream)


@pytest.mark.parametrize("name", NAMES)
def test_columns_hold_what_the_decoder_delivers(name: str) -> None:
    proto = codec(name)
    stream = hard_stream(proto, random.Random(name), pieces=300)
    decoder = proto.decoder()
    messages = decoder.feed(stream) + decoder.finish()
    columns = proto.decode_columns(stream)
    assert columns.stats == decoder.stats
    assert sum(table.rows for table in columns.values()) == len(messages)
    for message_name, table in columns.items():
        rows = [m for m in messages if m.name == message_name]
        assert table.offset.tolist() == [m.offset for m in rows]
