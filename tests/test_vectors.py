"""The frames that must come out byte for byte, and those that must be refused, through the Python API."""

from __future__ import annotations

import random

import pytest

from tests.shared import Rejected, Vector, accepted_vectors, account_closes, codec, rejected_vectors

NOISE = 40  # bytes on either side


def noise(seed: int, vector: Vector) -> bytes:
    """Random bytes without the format's start byte: they cannot begin a frame, and must not hide one."""
    start = vector.frame[0]
    source = random.Random(seed)
    return bytes(byte for byte in source.randbytes(2 * NOISE) if byte != start)[:NOISE]


@pytest.mark.parametrize("vector", accepted_vectors(), ids=str)
class TestAcceptedVector:
    def test_encodes_to_exactly_these_bytes(self, vector: Vector) -> None:
        assert codec(vector.protocol).encode(vector.message, vector.fields) == vector.frame

    def test_decodes_whole(self, vector: Vector) -> None:
        decoder = codec(vector.protocol).decoder(vector.sender)
        (message,) = decoder.feed(vector.frame, t=1.5)
        assert (message.name, message.sender, message.raw) == (vector.message, vector.sender, vector.frame)
        assert message.fields == vector.fields
        assert (message.t, message.offset, message.violations) == (1.5, 0, [])
        assert decoder.stats.bytes == decoder.stats.frame_bytes == len(vector.frame)

    def test_decodes_byte_by_byte(self, vector: Vector) -> None:
        decoder = codec(vector.protocol).decoder(vector.sender)
        for byte in vector.frame[:-1]:
            assert decoder.feed(bytes([byte])) == []
            assert account_closes(decoder.stats)
        (message,) = decoder.feed(vector.frame[-1:])
        assert (message.name, message.fields) == (vector.message, vector.fields)

    @pytest.mark.parametrize("chunk", [1, 3, 64, 1000])
    def test_decodes_between_noise(self, vector: Vector, chunk: int) -> None:
        stream = noise(1, vector) + vector.frame + noise(2, vector) + vector.frame + noise(3, vector)
        decoder = codec(vector.protocol).decoder(vector.sender)
        messages = [m for at in range(0, len(stream), chunk) for m in decoder.feed(stream[at : at + chunk])]
        messages += decoder.finish()
        assert [m.raw for m in messages] == [vector.frame] * 2
        assert [m.offset for m in messages] == [NOISE, 2 * NOISE + len(vector.frame)]
        assert decoder.stats.discarded_bytes["no_start"] == 3 * NOISE

    def test_is_found_without_naming_the_sender(self, vector: Vector) -> None:
        (message,) = codec(vector.protocol).decoder().feed(vector.frame)
        assert (message.name, message.sender) == (vector.message, vector.sender)

    def test_comes_out_as_columns(self, vector: Vector) -> None:
        columns = codec(vector.protocol).decode_columns(vector.frame * 3, vector.sender)
        table = columns[vector.message]
        assert table.offset.tolist() == [0, len(vector.frame), 2 * len(vector.frame)]
        for name, value in vector.fields.items():
            if isinstance(value, list) and value and isinstance(value[0], str):
                continue  # flags stay integers in columns
            assert table[name][1].tolist() == value


@pytest.mark.parametrize("rejected", rejected_vectors(), ids=str)
@pytest.mark.parametrize("chunk", [1, 4, 1000])
def test_refused_frame_is_discarded_and_counted(rejected: Rejected, chunk: int) -> None:
    decoder = codec(rejected.protocol).decoder("host")
    frame = rejected.frame
    assert [m for at in range(0, len(frame), chunk) for m in decoder.feed(frame[at : at + chunk])] == []
    assert decoder.finish() == []
    assert decoder.stats.discarded_bytes["check_mismatch"] == len(frame)
    assert account_closes(decoder.stats)


def test_the_listing_of_the_c_code_accepts_its_own_checksum() -> None:
    """Other delimiters, and the command left out of the sum."""
    (rejected,) = [r for r in rejected_vectors() if r.protocol == "pid_tuner"]
    frame = b"\xfa" + rejected.frame[1:-1] + b"\xfb"
    (message,) = codec("pid_tuner_listing").decoder("host").feed(frame)
    assert (message.name, message.fields["p"]) == ("pid", 33.0)
