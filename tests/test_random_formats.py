"""Formats that nobody wrote: random files, random messages, hard streams, three decoders that must agree.

The engine, the generated C++ and the slow reference: on every frame, every discard by its cause and every sum. The
engine and the generated C++ also on every field, on what encodes again, and on what stands in an untouched struct.
"""

from __future__ import annotations

import random
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests import reference
from tests.conformance.build import BUILD
from tests.conformance.fields import difference
from tests.conformance.formats import Answer, Chunk, Job, build_formats, decode_all
from tests.random_formats import random_protocol
from tests.shared import account_closes, needs_sender
from tests.streams import Speaker, chunks, hard_pieces
from wirebond import Codec, Message, MessageError, ProtocolFileError, Stats
from wirebond.protocol import loads
from wirebond.protocol.model import End

BATCH = 50  # formats in one program
FOLDED = 25  # one in so many has a deframer of its own, as firmware has: that takes a second to compile
SENDERS = (None, End.HOST, End.MCU)


@dataclass(frozen=True)
class Drawn:
    """A format and the file that it came from."""

    seed: int
    text: str
    codec: Codec

    def __str__(self) -> str:
        return f"format {self.seed}\n{self.text}"


def drawn_format(seed: int) -> Drawn:
    """Nearly all drawn files load; the others break a rule of the loader (arrays of lists of flags, say)."""
    source = random.Random(f"format {seed}")
    for _ in range(5):
        text = random_protocol(source, seed)
        try:
            return Drawn(seed, text, Codec(loads(text)))
        except ProtocolFileError:
            continue
    raise AssertionError(f"five drawn files in a row do not load; the last is format {seed}\n{text}")


@dataclass(frozen=True)
class Heard:
    """What the engine found in one stream."""

    drawn: Drawn
    messages: list[Message]
    stats: Stats


def listen(drawn: Drawn, sender: End | None, source: random.Random, messages: int) -> tuple[Heard, list[Chunk]]:
    """A stream through the engine, compared with the reference; and the stream."""
    model, speaker = drawn.codec.model, Speaker(drawn.codec)
    pieces = [piece for piece in hard_pieces(lambda: speaker.any(source), source, messages) if piece]
    if model.format.ends_by_silence:
        expected = reference.decode_blocks(model, pieces, sender)
        step = 2 * round(model.idle_seconds * 1e6)
        stream = [Chunk(step * i, chunk) for i, piece in enumerate(pieces) for chunk in chunks(piece, source)]
    else:
        expected = reference.decode(model, b"".join(pieces), sender)
        stream = [Chunk(0, chunk) for chunk in chunks(b"".join(pieces), source)]
    decoder = drawn.codec.decoder(sender)
    found = []
    for chunk in stream:
        found += decoder.feed(chunk.data, chunk.time_us / 1e6)
        assert account_closes(decoder.stats), drawn
    found += decoder.finish()
    assert [reference.Frame(m.offset, m.raw, m.id, m.name, m.header) for m in found] == expected.frames, (
        sender,
        str(drawn),
    )
    stats = decoder.stats.as_dict()
    assert stats["discarded_bytes"] == dict(expected.discarded_bytes), (sender, str(drawn))
    assert stats["rejected_candidates"] == dict(expected.rejected_candidates), (sender, str(drawn))
    assert stats["fill_bytes"] == expected.fill_bytes, (sender, str(drawn))
    return Heard(drawn, found, decoder.stats), stream


def verify_generated(heard: Heard, answer: Answer) -> None:
    """The generated code against the engine, over one stream."""
    drawn, stats, account = heard.drawn, heard.stats, answer.deframed.account
    index = {message.name: i for i, message in enumerate(drawn.codec.model.messages)}
    assert [(f.offset, f.wire, f.id, f.message) for f in answer.deframed.frames] == [
        (m.offset, m.raw, m.id, index.get(m.name, -1)) for m in heard.messages
    ], str(drawn)
    for name in ("bytes", "frames", "unknown_frames", "frame_bytes", "fill_bytes", "pending_bytes"):
        assert account[name] == getattr(stats, name), (name, str(drawn))
    for cause, count in stats.discarded_bytes.items():
        assert account[f"discarded.{cause}"] == count, (cause, str(drawn))
        assert account[f"rejected.{cause}"] == stats.rejected_candidates[cause], (cause, str(drawn))
    for place, message in enumerate(heard.messages):
        assert (place in answer.handed) == (message.name in index), str(drawn)
        if message.name in index:
            found = difference(drawn.codec, message, answer.handed[place])
            assert not found, f"{message.name} {message.payload.hex()}: {found}\n{drawn}"


def verify_defaults(drawn: Drawn, row: int, defaults: dict[tuple[int, int], bytes | None]) -> None:
    """What is left out takes its default, or must be given."""
    for index, message in enumerate(drawn.codec.model.messages):
        try:
            frame = drawn.codec.encode(message.name)
        except MessageError:
            continue  # a value has no default
        assert defaults[row, index] == frame, f"{message.name}\n{drawn}"


def verify_formats(seeds: range, messages: int, folder: Path, build: Path) -> None:
    """All three decoders over ``messages`` messages of each format."""
    formats = [drawn_format(seed) for seed in seeds]
    program = build_formats([drawn.codec.model for drawn in formats], range(0, len(formats), FOLDED), build)
    jobs, heard = [], []
    for row, drawn in enumerate(formats):
        source = random.Random(f"streams {drawn.seed}")
        senders = [sender for sender in SENDERS if sender is not None or not needs_sender(drawn.codec.model)]
        for sender in senders:
            result, stream = listen(drawn, sender, source, -(-messages // len(senders)))
            if sender is not None:
                jobs.append(Job(row, sender, stream))
                heard.append(result)
    answers = decode_all(program, jobs, folder)
    for result, answer in zip(heard, answers.jobs, strict=True):
        verify_generated(result, answer)
    for row, drawn in enumerate(formats):
        verify_defaults(drawn, row, answers.defaults)


def test_nearly_all_drawn_files_load() -> None:
    """So that a rule of the loader that refuses too much shows, and the proofs below draw what they seem to draw."""
    refused = 0
    for seed in range(100):
        try:
            loads(random_protocol(random.Random(f"format {seed}"), seed))
        except ProtocolFileError:
            refused += 1
    assert refused <= 5


@pytest.mark.parametrize("first", [0, 12])
def test_three_decoders_agree_on_random_formats(first: int, tmp_path: Path) -> None:
    verify_formats(range(first, first + 12), 100, tmp_path, BUILD)


@pytest.mark.long
@pytest.mark.parametrize("first", range(0, 10_000, BATCH), ids=lambda first: f"from_{first:04}")
def test_three_decoders_agree_on_ten_thousand_random_formats(first: int, tmp_path: Path) -> None:
    """A hundred messages of each. `-k from_0450` runs the fifty formats from number 450 on."""
    verify_formats(range(first, first + BATCH), 100, tmp_path, tmp_path)
