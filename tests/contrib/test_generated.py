"""Every public format in the generated C++: it must read and write the other implementation's
frames, headers included, and find in noisy streams what the engine finds."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conformance.fields import difference
from tests.conformance.formats import Answer, Chunk, Job, build_formats, decode_all
from tests.contrib.cases import CONTRIB, frame_of, random_case
from tests.contrib.oracles import ORACLES
from tests.shared import few_or_many, loaded
from tests.streams import chunks, hard_pieces
from wirebond import Codec, Decoder
from wirebond.protocol.model import End
from wirebond.protocol.planning import plan_for

pytestmark = pytest.mark.live

NAMES = sorted(ORACLES)
ENDS = (End.HOST, End.MCU)
CODECS = {name: loaded(CONTRIB / f"{name}.yaml") for name in NAMES}


@pytest.fixture(scope="module")
def program() -> Path:
    """Frames of several forms need an encoder of their own, which chooses."""
    models = [codec.model for codec in CODECS.values()]
    several = [row for row, model in enumerate(models) if any(len(plan_for(model, end).forms) > 1 for end in ENDS)]
    return build_formats(models, several)


def senders(codec: Codec) -> list[End]:
    return [end for end in ENDS if any(m.sent_by(end) for m in codec.model.messages)]


def drawing(name: str, end: End, source: random.Random) -> Callable[[], bytes]:
    """Draws frames that this end sends, as the other implementation writes them."""
    return lambda: frame_of(CODECS[name], ORACLES[name], *random_case(CODECS[name], ORACLES[name], source, end))


def sent(codec: Codec, pieces: list[bytes], source: random.Random) -> list[Chunk]:
    """In pieces of any size; where silence ends a frame, each piece stands alone."""
    if not codec.model.format.ends_by_silence:
        return [Chunk(0, chunk) for chunk in chunks(b"".join(pieces), source)]
    step = 2 * round(codec.model.idle_seconds * 1e6)
    return [Chunk(step * i, chunk) for i, piece in enumerate(pieces) for chunk in chunks(piece, source)]


def heard(codec: Codec, end: End, stream: list[Chunk]) -> tuple[list, Decoder]:
    decoder = codec.decoder(end)
    messages = [message for chunk in stream for message in decoder.feed(chunk.data, chunk.time_us / 1e6)]
    return messages + decoder.finish(), decoder


@few_or_many(60, 10_000)
def test_it_reads_and_writes_what_the_other_side_does(number: int, program: Path, tmp_path: Path) -> None:
    jobs, expected = [], []
    for row, name in enumerate(NAMES):
        codec = CODECS[name]
        for end in senders(codec):
            source = random.Random(f"{name} {end} {number}")
            draw = drawing(name, end, source)
            frames = [draw() for _ in range(number)]
            stream = sent(codec, frames, source)
            jobs.append(Job(row, end, stream))
            expected.append((name, end, frames, stream))
    answers = decode_all(program, jobs, tmp_path).jobs
    for (name, end, frames, stream), answer in zip(expected, answers, strict=True):
        assert [frame.wire for frame in answer.deframed.frames] == frames, (name, end)
        messages, _ = heard(CODECS[name], end, stream)
        for place, message in enumerate(messages):
            handed = answer.handed[place]
            assert not difference(CODECS[name], message, handed), (name, message)
            assert (handed.with_header if message.header else handed.again) == message.raw, (name, message)


@few_or_many(60, 10_000)
def test_it_finds_the_engines_frames_in_noisy_streams(number: int, program: Path, tmp_path: Path) -> None:
    jobs = []
    for row, name in enumerate(NAMES):
        codec = CODECS[name]
        for end in senders(codec):
            source = random.Random(f"noisy {name} {end} {number}")
            pieces = hard_pieces(drawing(name, end, source), source, number)
            jobs.append(Job(row, end, sent(codec, [piece for piece in pieces if piece], source)))
    for job, answer in zip(jobs, decode_all(program, jobs, tmp_path).jobs, strict=True):
        verify(NAMES[job.row], job, answer)


def verify(name: str, job: Job, answer: Answer) -> None:
    codec = CODECS[name]
    messages, decoder = heard(codec, job.sender, job.chunks)
    found = [(frame.offset, frame.wire, frame.id) for frame in answer.deframed.frames]
    assert found == [(message.offset, message.raw, message.id) for message in messages], (name, job.sender)
    account = answer.deframed.account
    assert account["fill_bytes"] == decoder.stats.fill_bytes
    for cause, count in decoder.stats.discarded_bytes.items():
        assert account[f"discarded.{cause}"] == count, (name, job.sender, cause)
    for place, message in enumerate(messages):
        if message.name != "unknown":
            assert not difference(codec, message, answer.handed[place]), (name, message)
