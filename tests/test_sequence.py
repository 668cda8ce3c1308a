"""Frames that are missing are counted exactly, by the host's decoders and by generated C++ and C."""

from __future__ import annotations

import random
from collections.abc import Iterator

import pytest

import wirebond
from wirebond import _engine
from wirebond.link.settings import engine_settings
from wirebond.protocol import loads
from wirebond.protocol.model import End

HEAD = "wirebond: 1\nprotocol: counted\n"
FRAME = (
    "frame: [magic: 0xA5, {sequence: SEQUENCE}, {field: station, type: u8ADDRESS}, id: u8, payload: by_id, "
    "check: crc-16/modbus]\n"
)
MESSAGES = """messages:
  tick: {id: 1, sender: mcu, fields: {value: {type: u8}}}
  tock: {id: 2, sender: mcu, fields: {value: {type: u8}}}
"""


def codec_of(sequence: str = "u8", address: str = "") -> wirebond.Codec:
    frame = FRAME.replace("SEQUENCE", sequence).replace("ADDRESS", f", address: {address}" if address else "")
    return wirebond.Codec(loads(HEAD + frame + MESSAGES))


def stream(codec: wirebond.Codec, count: int, seed: int) -> Iterator[tuple[bytes, bool]]:
    """Numbered frames; for each, whether it is taken out: one of a hundred, the first and the last never."""
    draw = random.Random(seed)
    frames = [
        [codec.encode(name, value=value, header={"sequence": number}) for name in ("tick", "tock") for value in (0, 1)]
        for number in range(256)
    ]
    for index in range(count):
        yield draw.choice(frames[index % 256]), 0 < index < count - 1 and draw.random() < 0.01


def count_exactly(count: int) -> None:
    codec = codec_of()
    decoder = codec.decoder("mcu")
    missing, chunk = 0, bytearray()
    for frame, is_removed in stream(codec, count, 5):
        missing += is_removed
        chunk += b"" if is_removed else frame
        if len(chunk) > 4096:
            decoder.feed(chunk)
            chunk.clear()
    decoder.feed(chunk)
    found = decoder.stats.sequence
    assert found is not None
    assert missing > count / 200
    assert (found.numbered, found.gaps, found.repeats, found.restarts) == (count - missing, missing, 0, 0)
    assert found.loss == missing / count


def test_gaps_are_exact_where_one_frame_of_a_hundred_is_missing() -> None:
    count_exactly(20_000)


@pytest.mark.long
def test_gaps_are_exact_in_a_million_frames() -> None:
    count_exactly(1_000_000)


def fed(codec: wirebond.Codec, *headers: tuple[str, dict[str, int]], sender: str | None = "mcu") -> wirebond.Decoder:
    decoder = codec.decoder(sender)
    for name, header in headers:
        decoder.feed(codec.encode(name, value=0, header=header))
    return decoder


def test_each_message_has_its_own_count_where_the_file_says_so() -> None:
    numbers = [("tick", 0), ("tock", 0), ("tick", 1), ("tick", 2), ("tock", 1), ("tock", 3)]
    found = fed(codec_of("u8, per: message"), *((name, {"sequence": n}) for name, n in numbers)).stats.sequence
    assert found is not None
    assert (found.numbered, found.gaps, found.repeats, found.restarts) == (6, 1, 0, 0)


@pytest.mark.parametrize("address", ["mcu", "sender"])
def test_peers_are_distinguished_by_their_address(address: str) -> None:
    heard = [(1, 0), (2, 90), (1, 1), (2, 91), (1, 3), (2, 91)]
    found = fed(codec_of(address=address), *(("tick", {"station": s, "sequence": n}) for s, n in heard)).stats.sequence
    assert found is not None
    assert found.gaps == 1 and found.repeats == 1 and found.restarts == 0
    assert {peer: (counts.numbered, counts.gaps, counts.repeats) for peer, counts in found.peers.items()} == {
        1: (3, 1, 0),
        2: (3, 0, 1),
    }
    assert found.as_dict()["peers"]["1"]["loss"] == 0.25


def test_both_ends_in_one_stream_are_counted_only_if_frames_name_their_sender() -> None:
    assert fed(codec_of(), ("tick", {"sequence": 1}), sender=None).stats.sequence is None
    assert fed(codec_of(address="sender"), ("tick", {"sequence": 1}), sender=None).stats.sequence is not None


def test_frames_without_a_number_have_no_such_figure() -> None:
    codec = wirebond.Codec(loads(HEAD + "frame: [magic: 0xA5, id: u8, payload: by_id, check: xor8]\n" + MESSAGES))
    stats = codec.decoder("mcu").stats
    assert stats.sequence is None
    assert "sequence" not in stats.as_dict()


@pytest.mark.parametrize("threads", [1, 3])
def test_columns_count_the_same_whatever_the_number_of_threads(threads: int) -> None:
    codec = codec_of()
    capture = b"".join(frame for frame, is_removed in stream(codec, 60_000, 8) if not is_removed)
    decoder = codec.decoder("mcu")
    decoder.feed(capture)
    assert codec.decode_columns(capture, "mcu", threads=threads).stats.sequence == decoder.stats.sequence


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("{sequence: u8, per: frame}", "`frame` is not possible here"),
        ("{bits: u8, fields: {sequence: 4, other: {bits: 4, per: message}}}", "`per` is for a run `sequence`"),
        ("{sequence: u8}, {sequence: u8, name: second}", "a frame has one sequence number"),
    ],
)
def test_a_sequence_that_cannot_be_is_refused_with_a_sentence(text: str, sentence: str) -> None:
    with pytest.raises(wirebond.ProtocolFileError, match=sentence):
        loads(HEAD + f"frame: [magic: 0xA5, {text}, id: u8, payload: by_id, check: xor8]\n" + MESSAGES)


def test_per_message_is_in_the_hash_and_per_sender_changes_none() -> None:
    assert codec_of("u8").hash == codec_of("u8, per: sender").hash != codec_of("u8, per: message").hash


@pytest.mark.parametrize(
    ("parts", "fields"),
    [
        ("length: u8, id: u8, payload: by_length", "{data: {type: bytes, max: 8}}"),
        ("id: u8, payload: by_id", "{count: u8, data: {type: u8, max: 8, count: count}}"),
    ],
    ids=["by_length", "by_id"],
)
def test_the_host_numbers_frames_whose_form_only_their_size_decides(parts: str, fields: str) -> None:
    frame = f"frame: [magic: 0xA5, sequence: u8, {parts}, check: sum16, {{reserved: 2, when: size <= 4}}]\n"
    codec = wirebond.Codec(loads(HEAD + frame + f"messages: {{data: {{id: 1, sender: host, fields: {fields}}}}}\n"))
    core = _engine.LinkCore(
        codec.tables.protocol, codec.tables.format_for(End.MCU), engine_settings(codec, 115_200, paced=False), 0
    )
    core.port_up(0)
    for number in range(1, 9):
        values = {"data": b"12345678"[:number] if "bytes" in fields else [0x11] * number}
        now = number * 1_000_000
        assert core.send(0, codec.encode("data", values), -1, now) == 0
        core.poll(now)
        left = core.to_write(now)
        core.written(len(left), now)
        assert left == codec.encode("data", values, header={"sequence": number - 1})
