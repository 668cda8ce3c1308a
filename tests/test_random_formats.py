"""Formats that nobody wrote: random files, random messages, hard streams, three decoders that must agree.

The engine, the generated C++ and the slow decoder: on every frame, every discard by its cause and every sum. The
engine and the generated C++ also on every field, on what encodes again, and on what stands in an untouched struct.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests import reference
from tests.conformance.build import BUILD
from tests.conformance.fields import difference
from tests.conformance.formats import Answer, Chunk, Job, build_formats, decode_all
from tests.random_checks import random_check
from tests.random_formats import random_protocol
from tests.shared import account_closes, few_or_many, needs_sender
from tests.streams import Speaker, chunks, hard_pieces, header_bits, random_values
from tests.test_device_checks import FORMATS, FRAMES
from wirebond import Codec, Message, MessageError, ProtocolFileError, Stats, _engine
from wirebond.link.settings import engine_settings
from wirebond.protocol import loads
from wirebond.protocol.model import End, FrameFormat
from wirebond.protocol.model.forms import header_fields

pytestmark = pytest.mark.live

BATCH = 50  # formats in one program
FOLDED = 25  # one in this many has a deframer of its own, as firmware has: that takes a second to compile
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
    for _ in range(30):
        text = random_protocol(source, seed)
        try:
            return Drawn(seed, text, Codec(loads(text)))
        except ProtocolFileError:
            continue
    raise AssertionError(f"thirty drawn files in a row do not load; the last is format {seed}\n{text}")


def drawn_check(seed: int) -> Drawn:
    """A simple frame whose check is drawn."""
    check, _ = random_check(random.Random(f"check {seed}"))
    over = ", over: payload" if "refuse" in check else ""  # of which some size is a whole number of words
    text = (
        f"wirebond: 1\nprotocol: check_{seed}\nmax_payload: 60\nframe:\n  - magic: 0xA5\n  - length: u8\n  - id: u8\n"
        f"  - payload: by_length\n  - check: {{type: {check}{over}}}\nmessages:\n"
        "  data: {id: 1, sender: both, fields: {data: {type: bytes, max: 60}}}\n"
        "  number: {id: 2, sender: both, fields: {number: u32}}\n"
    )
    return Drawn(seed, text, Codec(loads(text)))


@dataclass(frozen=True)
class Heard:
    """The engine's result for one stream, and its receiver's."""

    drawn: Drawn
    messages: list[Message]
    stats: Stats
    own: int | None  # the receiver's address, as bits; None: the file's
    addressees: list[reference.Addressee]
    sequence: reference.Sequence | None  # where four peers are remembered


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
    whole = reference.sequence_of(model, expected.frames, sender, peers=len(expected.frames) or 1)
    assert numbers_of(decoder.stats.as_dict()) == whole, (sender, str(drawn))
    if sender is None:
        return Heard(drawn, found, decoder.stats, None, [], None), stream
    own, value = drawn_address(drawn, sender, expected.frames, source)
    addressees = reference.addressees(model, expected.frames, sender, value)
    if sender == End.MCU:
        verify_host(drawn, stream, expected.frames, own, addressees, whole)
    few = reference.sequence_of(model, expected.frames, sender, peers=4)
    return Heard(drawn, found, decoder.stats, own, addressees, few), stream


def numbers_of(stats: dict[str, Any]) -> reference.Sequence | None:
    if "sequence" not in stats:
        return None
    return reference.Sequence(**{name: stats["sequence"][name] for name in vars(reference.Sequence())})


def drawn_address(
    drawn: Drawn, sender: End, frames: list[reference.Frame], source: random.Random
) -> tuple[int | None, object]:
    """The address of the end that listens, as bits and as a value: the file's, or one that these frames have."""
    described = reference.receiver_field(drawn.codec.model, sender)
    used = [] if described is None else [f.header[described.name] for f in frames if described.name in f.header]
    if described is None or not used or source.random() < 0.4:
        return None, None
    value = source.choice(used)
    addresses = [field.value for field in header_fields(drawn.codec.model.format.parts) if field.address is not None]
    bits = header_bits(described.value, value)
    fits = bits < 2 ** min(field.width for field in addresses) and bits not in described.broadcast_bits
    return (bits, value) if fits else (None, None)


def verify_host(
    drawn: Drawn,
    stream: list[Chunk],
    frames: list[reference.Frame],
    own: int | None,
    addressees: list[reference.Addressee],
    sequence: reference.Sequence | None,
) -> None:
    """The host's link over the same stream: it hands over what is for its address, and counts the rest."""
    codec = drawn.codec
    core = _engine.LinkCore(codec.tables.protocol, codec.tables.format_for(End.MCU), engine_settings(codec, 115_200), 0)
    core.port_up(0)
    if own is not None:
        core.set_address(own)
    found = []
    for chunk in stream:
        core.idle(chunk.time_us)
        core.received(chunk.data, chunk.time_us, chunk.time_us)
        found += core.receive()
    core.idle(2**50)
    found += core.receive()
    wanted = [f for f, whom in zip(frames, addressees, strict=True) if whom != reference.Addressee.ANOTHER]
    assert [(m.offset, m.raw, m.id, m.name) for m in found] == [(f.offset, f.wire, f.id, f.name) for f in wanted], str(
        drawn
    )
    stats = core.stats()
    assert stats["frames"] == len(frames), str(drawn)
    assert stats["foreign_frames"] == len(frames) - len(wanted), str(drawn)
    foreign = sum(
        len(f.wire) for f, whom in zip(frames, addressees, strict=True) if whom == reference.Addressee.ANOTHER
    )
    assert stats["foreign_bytes"] == foreign, str(drawn)
    assert numbers_of(stats if stats["sequence"] is not None else {}) == sequence, str(drawn)


def verify_intact(drawn: Drawn, source: random.Random) -> None:
    """Verify that the other end receives everything that an end sends."""
    codec = drawn.codec
    for message in codec.model.messages:
        for end in (End.HOST, End.MCU):
            if not message.sent_by(end):
                continue
            values = random_values(message, source)
            try:
                frame = codec.encode(message.name, values, sender=end)
            except MessageError:
                continue  # empty, so that it cannot be told from none
            if holds_delimiter(codec.model.format, frame):
                continue
            decoder = codec.decoder(end)
            found = [(m.name, m.raw) for m in decoder.feed(frame) + decoder.finish()]
            assert found == [(message.name, frame)], f"{message.name} {values} {frame.hex()}\n{drawn}"


def holds_delimiter(frame_format: FrameFormat, frame: bytes) -> bool:
    """May a byte that is not stuffed look like a delimiter?"""
    marks = [mark for mark in (frame_format.opening, frame_format.delimiter) if mark]
    is_stuffed = frame_format.stuffing.hides_delimiters and not any(part.is_plain for part in frame_format.parts)
    if not marks or is_stuffed:
        return False
    inner = frame[len(frame_format.opening or b"") : -len(marks[-1])]
    return any(mark[:1] in inner for mark in marks)


def verify_sent(drawn: Drawn, source: random.Random) -> None:
    """The host's link raises the sequence number of each frame as it leaves, and changes nothing else."""
    codec = drawn.codec
    sent = [message for message in codec.model.messages if message.sent_by(End.HOST)]
    number = next((field for field in header_fields(codec.model.format.parts) if field.is_sequence), None)
    if number is None or not sent:
        return
    core = _engine.LinkCore(
        codec.tables.protocol, codec.tables.format_for(End.MCU), engine_settings(codec, 115_200, paced=False), 0
    )
    core.port_up(0)
    now = 0
    counts: Counter[str] = Counter()
    for _ in range(300 if number.value.width < 9 else 10):
        message = source.choice(sent)
        values = random_values(message, source)
        try:
            given = codec.encode(message.name, values, sender=End.HOST)
        except MessageError:
            continue  # empty, so that it cannot be told from none
        heard = reference.decode(codec.model, given, End.HOST).frames
        if len(heard) != 1:
            continue  # a delimiter stands among what is not stuffed
        frame = given
        if number.name in heard[0].header:
            counter = message.name if number.per_message else ""
            header = {number.name: counts[counter] % 2**number.value.width}
            frame = codec.encode(message.name, values, header=header, sender=End.HOST)
            counts[counter] += 1
        assert core.send(codec.tables.indices[message.name], given, -1, now) == 0
        now += 1_000_000
        core.poll(now)
        left = b""
        while chunk := core.to_write(now):
            left += chunk
            core.written(len(chunk), now)
        assert left == frame, f"{message.name} {values}: {left.hex()}, {frame.hex()}\n{drawn}"


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
    foreign = heard.addressees.count(reference.Addressee.ANOTHER)
    assert (account["heard"], account["foreign"]) == (len(heard.messages) - foreign, foreign), str(drawn)
    if answer.addressees:
        assert answer.addressees == [whom.value for whom in heard.addressees], str(drawn)
    for name, count in vars(heard.sequence or reference.Sequence()).items():
        assert account[f"sequence.{name}"] == count % 2**32, (name, str(drawn))  # the MCU counts in 32 bits
    for place, message in enumerate(heard.messages):
        assert (place in answer.handed) == (message.name in index), str(drawn)
        if message.name in index:
            found = difference(drawn.codec, message, answer.handed[place])
            assert not found, f"{message.name} {message.payload.hex()}: {found}\n{drawn}"


def verify_defaults(drawn: Drawn, row: int, defaults: dict[tuple[int, int], bytes | None]) -> None:
    """Verify that omitted values take their default, or are refused."""
    for index, message in enumerate(drawn.codec.model.messages):
        try:
            frame = drawn.codec.encode(message.name)
        except MessageError:
            continue  # a value has no default
        assert defaults[row, index] == frame, f"{message.name}\n{drawn}"


def verify_formats(formats: list[Drawn], messages: int, folder: Path, build: Path) -> None:
    """All three decoders over ``messages`` messages of each format."""
    program = build_formats([drawn.codec.model for drawn in formats], range(0, len(formats), FOLDED), build)
    jobs, heard = [], []
    for row, drawn in enumerate(formats):
        source = random.Random(f"streams {drawn.seed}")
        senders = [sender for sender in SENDERS if sender is not None or not needs_sender(drawn.codec.model)]
        for sender in senders:
            result, stream = listen(drawn, sender, source, -(-messages // len(senders)))
            if sender is not None:
                jobs.append(Job(row, sender, stream, result.own))
                heard.append(result)
        verify_intact(drawn, source)
        verify_sent(drawn, source)
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


@pytest.mark.parametrize("seed", [2602, 4596, 5587])
def test_formats_that_once_disagreed(seed: int) -> None:
    """2602, 4596: a number, and a part that some sizes have; 5587: a field that a range and a mask ask for."""
    drawn, source = drawn_format(seed), random.Random(f"streams {seed}")
    senders = [sender for sender in SENDERS if sender is not None or not needs_sender(drawn.codec.model)]
    for sender in senders:
        listen(drawn, sender, source, -(-100 // len(senders)))
    verify_sent(drawn, source)


CHECKS_IN_BITS = (65, 74, 145)


@pytest.mark.parametrize("seeds", [range(12), (*range(12, 24), *CHECKS_IN_BITS)], ids=["first", "others"])
def test_three_decoders_agree_on_random_formats(seeds: Sequence[int], tmp_path: Path) -> None:
    verify_formats([drawn_format(seed) for seed in seeds], 100, tmp_path, BUILD)


def test_some_formats_have_checks_in_bits() -> None:
    parts = [part for seed in CHECKS_IN_BITS for part in drawn_format(seed).codec.model.format.parts]
    assert sum(part.in_bits is not None for part in parts) == len(CHECKS_IN_BITS)


def test_three_decoders_agree_on_random_checks(tmp_path: Path) -> None:
    verify_formats([drawn_check(seed) for seed in range(20)], 100, tmp_path, BUILD)


@pytest.mark.long
def test_three_decoders_agree_on_a_thousand_messages_of_a_hundred_random_checks(tmp_path: Path) -> None:
    for first in (0, BATCH):
        verify_formats([drawn_check(seed) for seed in range(first, first + BATCH)], 1000, tmp_path, tmp_path)


def devices() -> list[Drawn]:
    """The files of devices whose checks are combinations."""
    texts = [(FORMATS / f"{name}.yaml").read_text("utf-8") for name in dict.fromkeys(row[0] for row in FRAMES)]
    return [Drawn(seed, text, Codec(loads(text))) for seed, text in enumerate(texts)]


@few_or_many(100, 10_000)
def test_three_decoders_agree_on_messages_of_devices(number: int, tmp_path: Path) -> None:
    """Both ways, among noise, cut and damaged."""
    verify_formats(devices(), number, tmp_path, BUILD)


@pytest.mark.long
@pytest.mark.parametrize("first", range(0, 10_000, BATCH), ids=lambda first: f"from_{first:04}")
def test_three_decoders_agree_on_ten_thousand_random_formats(first: int, tmp_path: Path) -> None:
    """A hundred messages of each. `-k from_0450` runs the fifty formats from number 450 on."""
    verify_formats([drawn_format(seed) for seed in range(first, first + BATCH)], 100, tmp_path, tmp_path)
