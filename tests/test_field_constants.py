"""Constants among a message's fields: each sender writes them; a frame that breaks one is not a frame at either end."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from tests import reference
from tests.conformance.build import build_decoder, decode
from tests.shared import ROOT, few_or_many
from tests.streams import random_values
from wirebond import Codec, load
from wirebond.analysis.explain import explain
from wirebond.generate.doc import markdown
from wirebond.protocol.model import End

CODEC = load(ROOT / "tests" / "formats" / "constants.yaml")
STATE = {"motor": {"speed": 3}, "cells": [{"volts": 3.7}, {"volts": 3.6}]}


def sealed(payload: bytes, number: int) -> bytes:
    """A frame of the format whose checks hold, whatever its payload is."""
    frame = bytes([0x5A, len(payload), number, *payload])
    check = 0
    for byte in frame:
        check ^= byte
    return frame + bytes([check])


def broken(source: random.Random) -> tuple[bytes, str]:
    """A frame with good checks, in which one bit may be the wrong one."""
    name = source.choice(["state", "named", "empty"])
    frame = CODEC.encode(name, random_values(CODEC.model.message(name), source))
    payload = bytearray(frame[3:-1])
    payload[source.randrange(len(payload))] ^= 1 << source.randrange(8)
    return sealed(bytes(payload), frame[2]), name


def test_every_constant_is_written_and_is_no_value() -> None:
    frame = CODEC.encode("state", STATE)
    assert frame[3:-1].hex(" ") == "01 02 1d 40 74 0e 40 10 0e fe"
    (message,) = CODEC.decoder("host").feed(frame)
    assert message.fields == STATE
    assert CODEC.encode("named", name="ab", readings=[1]).hex(" ")[9:-3] == ("41 42 02 61 62 00 01 01 00 0d 0a 00 00")
    assert CODEC.encode("empty").hex(" ")[9:-3] == "89 ab cd ef"


@pytest.mark.parametrize("place", range(10))
def test_a_frame_that_breaks_a_constant_is_no_frame_and_is_looked_through_again(place: int) -> None:
    good = CODEC.encode("empty")
    payload = bytearray(CODEC.encode("state", STATE)[3:-1])
    is_free = {2: 0x38, 4: 0xFF, 5: 0xFF, 7: 0xFF, 8: 0xFF}.get(place, 0)
    for bit in range(8):
        changed = bytearray(payload)
        changed[place] ^= 1 << bit
        decoder = CODEC.decoder("host")
        names = [m.name for m in decoder.feed(sealed(bytes(changed), 1) + good)]
        expected = ["state", "empty"] if is_free >> bit & 1 else ["empty"]
        assert names == expected, (place, bit)
        assert decoder.stats.rejected_candidates.get("constant_mismatch", 0) == (len(names) == 1)


def test_constants_after_variable_parts_are_found() -> None:
    for count in range(7):
        values = {"name": "x" * (2 * count), "readings": [5] * count, "rest": b"\1\2"}
        frame = CODEC.encode("named", values)
        (message,) = CODEC.decoder("mcu").feed(frame)
        assert message.fields == {**values, "size": 2 * count, "number": count}
        assert frame[-7:-3] == b"\r\n\0\0"
        for place in (-7, -6, -5, -4):
            payload = bytearray(frame[3:-1])
            payload[place + 1] ^= 1
            assert CODEC.decoder("mcu").feed(sealed(bytes(payload), 2)) == []


@few_or_many(200, 2000)
def test_engine_and_slow_decoder_agree_on_broken_constants(number: int) -> None:
    source = random.Random(7)
    refused = 0
    for _ in range(number):
        frame, _ = broken(source)
        decoder = CODEC.decoder("host")
        found = [(m.offset, m.raw, m.name) for m in decoder.feed(frame) + decoder.finish()]
        slow = reference.decode(CODEC.model, frame, End.HOST)
        assert found == [(f.offset, f.wire, f.name) for f in slow.frames]
        assert decoder.stats.rejected_candidates == {
            **dict.fromkeys(decoder.stats.rejected_candidates, 0),
            **slow.rejected_candidates,
        }
        refused += not found
    assert refused > number // 4


@pytest.mark.live
@pytest.mark.parametrize("run_time", [False, True])
def test_generated_code_agrees_on_broken_constants(run_time: bool, tmp_path: Path) -> None:
    source = random.Random(8)
    stream = b"".join(broken(source)[0] for _ in range(1500))
    file = tmp_path / "stream.bin"
    file.write_bytes(stream)
    program = build_decoder(CODEC.model, End.HOST, run_time=run_time)
    for chunk in (0, 1, 4096):
        result = decode(program, file, chunk=chunk, seed=1)
        decoder = CODEC.decoder("host")
        messages = decoder.feed(stream) + decoder.finish()
        assert [(f.offset, f.wire, f.id) for f in result.frames] == [(m.offset, m.raw, m.id) for m in messages]
        assert result.account["rejected.constant_mismatch"] == decoder.stats.rejected_candidates["constant_mismatch"]


def test_it_says_which_constant_is_broken() -> None:
    payload = bytearray(CODEC.encode("state", STATE)[3:-1])
    payload[6] = 0x41
    (stretch,) = explain(CODEC.model, sealed(bytes(payload), 1), End.HOST).stretches
    assert stretch.cause == "constant_mismatch"
    assert stretch.summary == "constant field: expected cells[1].tag 0x40, found 0x41"
    assert "always 0x0102" in markdown(Codec(CODEC.model))
