"""A length whose width the magic chooses. Encoders take the first magic; the other frames are put together here."""

from __future__ import annotations

import random
import zlib
from pathlib import Path

import pytest

from tests.conformance.build import build_decoder, decode
from wirebond import Codec
from wirebond.analysis.explain import Kind, explain
from wirebond.protocol import loads
from wirebond.protocol.model import End

pytestmark = pytest.mark.live

FILE = """\
wirebond: 1
protocol: widths
frame:
  - magic: {any: [0xC3, 0xC4, 0xC1]}
  - {length: u24be, when: magic == 0xC3}
  - {length: u32, when: magic == 0xC4}
  - {length: u8, when: magic == 0xC1}
  - id: u32be
  - payload: by_length
  - check: crc-32
messages:
  block: {id: 0x01020304, sender: mcu, fields: {data: {type: bytes, max: 400}}}
  begin: {id: 0x81020304, sender: host, fields: {number: {type: u8}}}
"""
PROTO = Codec(loads(FILE))


def frame_of(magic: int, data: bytes) -> bytes:
    length = {
        0xC1: len(data).to_bytes(1, "big") if len(data) < 256 else b"",
        0xC3: len(data).to_bytes(3, "big"),
        0xC4: len(data).to_bytes(4, "little"),
    }[magic]
    covered = bytes([magic]) + length + bytes.fromhex("01020304") + data
    return covered + zlib.crc32(covered).to_bytes(4, "little")


@pytest.mark.parametrize("chunk", [1, 7, 4096])
def test_every_width_is_read_by_engine_and_generated_code(chunk: int, tmp_path: Path) -> None:
    source = random.Random(chunk)
    sizes = {0xC3: 400, 0xC4: 400, 0xC1: 255}
    sent = [(magic, source.randbytes(source.randint(0, sizes[magic]))) for magic in (*sizes, *sizes, *sizes)]
    frames = [frame_of(magic, data) for magic, data in sent]
    assert PROTO.encode("block", data=sent[0][1]) == frames[0]
    stream = b"\x00\xc4".join(frames) + bytes(410)  # so that the last false start is not a frame for certain

    decoder = PROTO.decoder("mcu")
    pieces = [stream[at : at + chunk] for at in range(0, len(stream), chunk)]
    messages = [m for piece in pieces for m in decoder.feed(piece)] + decoder.finish()
    assert [(m.raw, m.fields["data"]) for m in messages] == [
        (f, data) for f, (_, data) in zip(frames, sent, strict=True)
    ]

    file = tmp_path / "stream.bin"
    file.write_bytes(stream)
    found = decode(build_decoder(PROTO.model, End.MCU), file, chunk=chunk)
    assert [f.wire for f in found.frames] == frames
    assert found.account["unknown_frames"] == 0


def test_a_frame_of_another_magic_is_explained_with_the_length_of_its_form() -> None:
    covered = bytes.fromhex("55 00 00 03 01 02 03 04") + b"abc"  # 0xC3 has a length of three bytes
    frame = covered + zlib.crc32(covered).to_bytes(4, "little")
    (stretch,) = explain(PROTO.model, frame, End.MCU).stretches
    assert stretch.kind == Kind.NOISE
    assert any("magic" in guess.what for guess in stretch.guesses), stretch.guesses
