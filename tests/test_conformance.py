"""The generated C++ against the engine: the constant format and the run-time format, with sanitizers where it counts.

One program per protocol and source is compiled from the generated code; it must find the very frames, and put every
byte into the very bucket, that the engine does, however the stream is cut.
"""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from tests.conformance.build import build_decoder, decode
from tests.shared import accepted_vectors, codec
from tests.streams import hard_stream
from tests.test_against_reference import FORMATS
from wirebond import load
from wirebond.protocol.model import End

SANITIZED = {"diffdrive", "enterprize", "native", "mavlink", "brackets"}
CHUNKS = (0, 1, 7, 4096)  # bytes; 0: random sizes


def senders(name: str) -> list[End]:
    return [end for end in (End.MCU, End.HOST) if any(m.sent_by(end) for m in load(FORMATS[name]).model.messages)]


CASES = [
    pytest.param(name, end, marks=[] if end == senders(name)[0] else [pytest.mark.long])
    for name in sorted(FORMATS)
    for end in senders(name)
    if not load(FORMATS[name]).model.frame.ends_by_silence  # a file has no times
]


@pytest.mark.parametrize("run_time", [False, True], ids=["constant", "run-time"])
@pytest.mark.parametrize(("name", "sender"), CASES)
def test_generated_code_and_engine_agree(name: str, sender: End, run_time: bool, tmp_path: Path) -> None:
    proto = load(FORMATS[name])
    program = build_decoder(proto.model, sender, run_time=run_time, sanitize=name in SANITIZED and not run_time)
    source = random.Random(f"{name} {sender}")
    file = tmp_path / "stream.bin"
    for chunk in CHUNKS:
        stream = hard_stream(proto, source, pieces=150)
        file.write_bytes(stream)
        result = decode(program, file, chunk=chunk, seed=chunk)
        decoder = proto.decoder(sender)
        messages = decoder.feed(stream) + decoder.finish()
        assert [(f.offset, f.wire, f.id) for f in result.frames] == [(m.offset, m.raw, m.id) for m in messages]
        stats = decoder.stats
        assert result.account["fill_bytes"] == stats.fill_bytes
        for cause, count in stats.discarded_bytes.items():
            assert result.account[f"discarded.{cause}"] == count
        for cause, count in stats.rejected_candidates.items():
            assert result.account[f"rejected.{cause}"] == count


@pytest.mark.parametrize("run_time", [False, True], ids=["constant", "run-time"])
def test_generated_code_finds_every_vector_between_noise(run_time: bool, tmp_path: Path) -> None:
    for name in ("enterprize", "diffdrive"):
        for sender in (End.HOST, End.MCU):
            program = build_decoder(codec(name).model, sender, run_time=run_time, sanitize=name == "enterprize" and not run_time)
            frames = [v.frame for v in accepted_vectors() if v.protocol == name and v.sender == sender.value]
            file = tmp_path / "vectors.bin"
            for gap in (b"", b"\x01\x02\x03noise\xff"):
                file.write_bytes(gap + gap.join(frames) + gap)
                for chunk in (0, 1, 4096):
                    found = decode(program, file, chunk=chunk, seed=1)
                    assert [f.wire for f in found.frames] == frames
