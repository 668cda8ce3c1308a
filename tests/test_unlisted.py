"""Messages that the file does not list, where nothing lets them be delivered as unknown: reported, and no noise."""

from __future__ import annotations

import json
import random
from collections import Counter
from contextlib import closing

import pytest

import wirebond
from tests.waiting import moments, rounds_for, wait_until
from wirebond.analysis.explain import explain
from wirebond.cli.shown import stats_line
from wirebond.codec import Codec
from wirebond.protocol import loads
from wirebond.sim.pty_port import PtyPort

HEAD = "wirebond: 1\nprotocol: listed\n"
CHECK = "check: {type: crc-16/mcrf4xx, seed: message}"
SEEDED = f"frame: [magic: 0xFD, length: u8, sequence: u8, id: u8, payload: by_length, {CHECK}]\n"
WEAK = "frame: [magic: 0xA5 0x5A, length: u8, id: u8, payload: by_length, check: xor8]\nunknown: reject\n"
COBS = f"frame: [delimiter: 0x00, cobs: [id: u8, payload: rest, {CHECK}], delimiter: 0x00]\n"
ENDED = "frame: [cobs: [id: u8, payload: rest, check: crc-8/maxim-dow], delimiter: 0x00]\nunknown: reject\n"
BRACKETS = (
    "frame: [delimiter: 0x02, escaped: {escape: 0x10, xor: 0x40, parts: "
    "[length: u8, id: u8, payload: by_length, check: xor8]}, delimiter: 0x03]\nunknown: reject\n"
)
ESCAPED = (
    "frame: [magic: 0x7E, escaped: {escape: 0x7D, xor: 0x20, also: 0x61 0x74, parts: "
    "[length: u8, id: u8, payload: by_length, check: xor8]}]\nunknown: reject\n"
)
PARTLY_ESCAPED = (
    "frame: [magic: 0x7E, length: u8, escaped: {escape: 0x7D, xor: 0x20, parts: "
    f"[id: u8, payload: by_length]}}, {CHECK}]\n"
)
BY_LENGTH = {"escaped": ESCAPED, "partly escaped": PARTLY_ESCAPED}
SILENCE = "frame: [id: u8, payload: rest, check: xor8, silence: 2 ms]\nunknown: reject\n"
BLOCKS = {"cobs": COBS, "ended": ENDED, "brackets": BRACKETS}
LISTED = "  state: {id: 2, sender: mcu, seed: 50, fields: {x: {type: u32}, y: {type: u32}}}\n"
OTHERS = """  attitude: {id: 30, sender: mcu, seed: 39, fields: {a: {type: bytes, max: 60}}}
  status: {id: 1, sender: mcu, seed: 124, fields: {a: {type: bytes, max: 60}}}
"""


def pair(frame: str) -> tuple[Codec, Codec]:
    """Return the codec of the peer, and the one of the file."""
    bound = "max_payload: 60\n"
    if "seed" not in frame:
        listed, others = LISTED.replace("seed: 50, ", ""), OTHERS.replace("seed: 39, ", "").replace("seed: 124, ", "")
    else:
        listed, others = LISTED, OTHERS
    text = HEAD + frame + bound + "messages:\n"
    return Codec(loads(text + listed + others)), Codec(loads(text + listed))


def spoken(peer: Codec, number: int, seed: int) -> tuple[list[bytes], Counter[tuple[int, int]]]:
    """Frames of all messages, and the kinds of those that the file does not list, but for a last one."""
    source = random.Random(seed)
    frames, kinds = [], Counter[tuple[int, int]]()
    for _ in range(number):
        name = source.choice(["state", "attitude", "status"])
        if name == "state":
            frames.append(peer.encode(name, x=source.getrandbits(32), y=source.getrandbits(32)))
        else:
            frames.append(peer.encode(name, a=source.randbytes(source.choice([4, 22]))))
            kinds[peer.model.message(name).id, len(frames[-1])] += 1
    frames.append(peer.encode("state", x=1, y=2))
    return frames, kinds


@pytest.mark.parametrize("frame", [SEEDED, WEAK], ids=["seeded", "weak"])
@pytest.mark.parametrize("size", [1, 7, 100_000])
def test_their_ids_sizes_and_counts_are_reported_whatever_the_pieces(frame: str, size: int) -> None:
    peer, codec = pair(frame)
    frames, kinds = spoken(peer, 400, seed=3)
    stream = b"".join(frames)
    decoder = codec.decoder("mcu")
    got = [m for at in range(0, len(stream), size) for m in decoder.feed(stream[at : at + size])]
    got += decoder.finish()
    stats = decoder.stats
    listed = [raw for raw in frames if raw[3] == 2]
    assert [m.raw for m in got] == listed  # guarantee 1: what lies among them is still found
    assert stats.unlisted == dict(kinds)
    assert stats.unlisted_frames == sum(kinds.values())
    discarded = sum(stats.discarded_bytes.values())
    assert stats.bytes == stats.frame_bytes + stats.fill_bytes + stats.pending_bytes + discarded
    assert discarded == sum(size * count for (_, size), count in kinds.items())
    assert "not in the file (id " in stats_line(stats)
    assert json.loads(json.dumps(stats.as_dict()))["unlisted"][0].keys() == {"id", "bytes", "frames"}


@pytest.mark.parametrize("frame", BY_LENGTH.values(), ids=BY_LENGTH)
@pytest.mark.parametrize("size", [1, 7, 100_000])
def test_escapes_move_the_end_that_shows(frame: str, size: int) -> None:
    peer, codec = pair(frame)
    frames, kinds = spoken(peer, 400, seed=9)
    assert any(0x7D in raw[3:-3] for raw in frames)
    stream = b"".join(frames)
    decoder = codec.decoder("mcu")
    got = [m for at in range(0, len(stream), size) for m in decoder.feed(stream[at : at + size])]
    got += decoder.finish()
    stats = decoder.stats
    assert len(got) == len(frames) - sum(kinds.values())
    assert stats.unlisted == dict(kinds)
    assert stats.discarded_bytes["unknown_message"] > 0
    assert sum(stats.discarded_bytes.values()) == sum(size * count for (_, size), count in kinds.items())


@pytest.mark.parametrize("frame", BLOCKS.values(), ids=BLOCKS)
@pytest.mark.parametrize("size", [1, 7, 100_000])
def test_between_delimiters_they_are_reported_too(frame: str, size: int) -> None:
    peer, codec = pair(frame)
    frames, kinds = spoken(peer, 400, seed=5)
    stream = b"".join(frames)
    decoder = codec.decoder("mcu")
    got = [m for at in range(0, len(stream), size) for m in decoder.feed(stream[at : at + size])]
    got += decoder.finish()
    stats = decoder.stats
    assert len(got) == len(frames) - sum(kinds.values())
    assert stats.unlisted == dict(kinds)
    assert stats.discarded_bytes["unknown_message"] > 0


@pytest.mark.live
def test_between_silences_they_are_reported_too_and_keep_the_link_up() -> None:
    peer, codec = pair(SILENCE)
    frames, kinds = spoken(peer, 40, seed=6)
    decoder = codec.decoder("mcu")
    for i, frame in enumerate(frames):
        decoder.feed(frame, i)
        decoder.idle(i + 0.5)
    assert decoder.stats.unlisted == dict(kinds)
    with closing(PtyPort()) as port, wirebond.open(codec, port.path) as link:
        link.receive(0.05)
        port.write(peer.encode("attitude", a=bytes(22)))
        wait_until(lambda: link.stats.receive.unlisted_frames == 1, "the frame is counted")
        for _ in moments("it is up"):
            if link.state == "up":
                break
            port.write(peer.encode("attitude", a=bytes(22)))


@pytest.mark.parametrize("frame", BLOCKS.values(), ids=BLOCKS)
def test_a_damaged_block_is_not_reported(frame: str) -> None:
    peer, codec = pair(frame)
    sent = peer.encode("attitude", a=b"steady as she goes....")
    decoder = codec.decoder("mcu")
    begin = sent.index(b"steady")
    for at in range(begin, begin + 18):
        decoder.feed(sent[:at] + bytes([sent[at] ^ 1]) + sent[at + 1 :])
    decoder.finish()
    assert decoder.stats.unlisted_frames == (18 if frame == COBS else 0)  # a seed that is not known leaves no check


@pytest.mark.parametrize(
    "frame", [SEEDED, WEAK, *BLOCKS.values(), *BY_LENGTH.values()], ids=["seeded", "weak", *BLOCKS, *BY_LENGTH]
)
def test_columns_count_them_as_the_decoder_does(frame: str) -> None:
    peer, codec = pair(frame)
    frames, _ = spoken(peer, 30_000, seed=7)
    source = random.Random(8)
    pieces = [raw if source.random() < 0.98 else raw[: source.randrange(len(raw))] for raw in frames]
    stream = b"".join(pieces)
    decoder = codec.decoder("mcu")
    decoder.feed(stream)
    decoder.finish()
    assert decoder.stats.unlisted_frames > 10_000
    for threads in (1, 2, 7):
        assert codec.decode_columns(stream, "mcu", threads=threads).stats == decoder.stats


def test_parts_of_a_capture_join_where_a_false_start_reaches_over_frames() -> None:
    _, codec = pair(WEAK)
    good = codec.encode("state", x=7, y=8)
    false_start = bytes.fromhex("a5 5a") + bytes([len(good) * 3 - 1, 99])  # it ends where the fourth frame begins
    stream = (false_start + good * 9) * 5_000
    whole, pieces = codec.decoder("mcu"), codec.decoder("mcu")
    whole.feed(stream)
    for at in range(0, len(stream), 17):
        pieces.feed(stream[at : at + 17])
    whole.finish()
    pieces.finish()
    assert whole.stats == pieces.stats
    assert whole.stats.unlisted == {(99, len(good) * 3 + 4): 5_000}
    for threads in (1, 2, 7):
        assert codec.decode_columns(stream, "mcu", threads=threads).stats == whole.stats


def test_a_frame_within_a_false_start_is_found_and_the_false_start_is_not_reported() -> None:
    _, codec = pair(WEAK)
    good = codec.encode("state", x=7, y=8)
    false_start = bytes.fromhex("a5 5a 20 63")  # 32 bytes of message 99, which never come
    decoder = codec.decoder("mcu")
    got = decoder.feed(false_start + good * 5)
    assert [m.name for m in got] == ["state"] * 5
    assert decoder.stats.unlisted_frames == 0


def test_a_start_byte_ends_an_escaped_frame_that_was_cut_short() -> None:
    peer, codec = pair(ESCAPED)
    whole = peer.encode("attitude", a=b"}~}~")
    decoder = codec.decoder("mcu")
    for size in range(2, len(whole)):
        decoder.feed(whole[:size] + whole)
    decoder.feed(codec.encode("state", x=1, y=2))
    assert decoder.stats.unlisted == {(30, len(whole)): len(whole) - 2}


def test_noise_is_hardly_ever_reported() -> None:
    _, codec = pair(WEAK)
    decoder = codec.decoder("mcu")
    decoder.feed(random.Random(4).randbytes(2_000_000))
    assert decoder.stats.unlisted_frames < 3


@pytest.mark.live
def test_a_peer_that_sends_nothing_else_keeps_the_link_up() -> None:
    peer, codec = pair(SEEDED)
    frame = peer.encode("attitude", a=bytes(22))
    with closing(PtyPort()) as port, wirebond.open(codec, port.path) as link:
        for _ in rounds_for(1.6):
            port.write(frame)
            link.receive(0.05)
        for _ in moments("it is up"):  # it may be silent where the machine has paused
            if link.state == "up":
                break
            port.write(frame)
        kinds = link.stats.receive.unlisted
        assert set(kinds) == {(30, len(frame))}
        wait_until(lambda: link.state == "stale", "silence")


def test_explain_tries_the_seeds() -> None:
    peer, codec = pair(SEEDED)
    frame = peer.encode("status", a=bytes(range(25)))
    [stretch] = explain(codec.model, frame, None).stretches
    text = " ".join(f"{guess.what} {guess.remedy}" for guess in stretch.guesses)
    assert f"id 0x01, {len(frame)} bytes: seed 124 fits" in text
    assert "`id: 0x01` and `seed: 124`" in text
