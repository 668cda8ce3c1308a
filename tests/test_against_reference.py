"""The engine against a slow and obvious decoder: every frame, every discard by cause, every sum."""

from __future__ import annotations

import random

import pytest

from tests import reference
from tests.shared import PROTOCOLS, ROOT, account_closes, few_or_many, loaded, needs_sender
from tests.streams import chunks, hard_stream, random_frame, random_values
from wirebond import Codec
from wirebond.protocol.model import End

FORMATS = {path.stem: path for folder in (PROTOCOLS, ROOT / "tests" / "formats") for path in folder.glob("*.yaml")}
FORMATS |= {f"contrib-{path.stem}": path for path in (PROTOCOLS / "contrib").glob("*.yaml")}


def stream_for(proto: Codec, source: random.Random, pieces: int = 60) -> bytes:
    """Return a stream for the format. If silence ends a frame, a stream without times is one block: a frame, or
    something else."""
    if not proto.model.format.ends_by_silence:
        return hard_stream(proto, source, pieces)
    return source.choice([random_frame(proto, source), source.randbytes(12), random_frame(proto, source) * 9])


def can_be_told(proto: Codec, sender: End | None) -> bool:
    """Return whether this end sends messages; without an end, whether every id means one message."""
    if sender is None and needs_sender(proto.model):
        return False
    return any(m.sent_by(sender) for m in proto.model.messages)


@few_or_many(1, 30)
@pytest.mark.parametrize("sender", [None, End.HOST, End.MCU])
@pytest.mark.parametrize("name", sorted(FORMATS))
def test_engine_and_reference_agree_on_hard_streams(name: str, sender: End | None, number: int) -> None:
    proto = loaded(FORMATS[name])
    if not can_be_told(proto, sender):
        return
    for seed in range(number):
        source = random.Random(f"{name} {sender} {seed}")
        stream = stream_for(proto, source)
        expected = reference.decode(proto.model, stream, sender)

        decoder = proto.decoder(sender)
        messages = []
        for chunk in chunks(stream, source):
            messages += decoder.feed(chunk)
            assert account_closes(decoder.stats)
        messages += decoder.finish()

        found = [reference.Frame(m.offset, m.raw, m.id, m.name, m.header) for m in messages]
        assert found == expected.frames, f"seed {seed}"
        stats = decoder.stats.as_dict()
        assert stats["discarded_bytes"] == dict(expected.discarded_bytes), f"seed {seed}"
        assert stats["rejected_candidates"] == dict(expected.rejected_candidates), f"seed {seed}"
        assert (stats["fill_bytes"], stats["pending_bytes"]) == (expected.fill_bytes, 0)
        assert stats["bytes"] == len(stream)


@pytest.mark.parametrize("name", sorted(FORMATS))
def test_columns_hold_the_decoders_values(name: str) -> None:
    proto = loaded(FORMATS[name])
    stream = stream_for(proto, random.Random(name))
    sender = None if can_be_told(proto, None) else End.MCU
    decoder = proto.decoder(sender)
    messages = decoder.feed(stream) + decoder.finish()
    columns = proto.decode_columns(stream, sender)
    assert columns.stats == decoder.stats
    assert sum(table.rows for table in columns.values()) == len(messages)
    for message_name, table in columns.items():
        rows = [m for m in messages if m.name == message_name]
        assert table.offset.tolist() == [m.offset for m in rows]


@few_or_many(60, 600)
@pytest.mark.parametrize("name", sorted(FORMATS))
def test_every_message_survives_encoding_and_decoding(name: str, number: int) -> None:
    proto = loaded(FORMATS[name])
    source = random.Random(name)
    cut = 0
    for _ in range(number):
        sent = source.choice(proto.model.messages)
        frame = proto.encode(sent.name, random_values(sent, source))
        sender = End.HOST if sent.sender == End.BOTH else sent.sender
        decoder = proto.decoder(sender)
        decoder.expect(proto.tables.request_for(sent.name))
        found = decoder.feed(frame) + decoder.finish()
        if not found and not reference.decode(proto.model, frame, sender).frames:
            cut += 1  # it happens to hold its delimiter, which this format does not hide
            continue
        (message,) = found
        assert message.raw == frame
        assert message.violations == []
        again = proto.encode(message.name, message.fields, header=message.header)
        assert again == frame
    assert cut <= number // 50
