"""The generated C++ against the engine: the constant format and the run-time format, with sanitizers where it counts.

One program per protocol and source is compiled from the generated code; it must find the very frames, and put every
byte into the very bucket, that the engine does, however the stream is cut.
"""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from tests.conformance.build import build_decoder, decode
from tests.shared import accepted_vectors, codec, loaded, rejected_vectors
from tests.streams import hard_stream
from tests.test_against_reference import FORMATS
from wirebond.protocol.model import End

pytestmark = pytest.mark.live

# The formats that are compiled in every test run: with the three framings. The others are proofs.
ALWAYS = {"diffdrive", "enterprize", "native", "brackets", "words"}
SANITIZED = {"enterprize"}
CHUNKS = (0, 1, 7, 4096)  # bytes; 0: random sizes

optimised = pytest.mark.parametrize(
    "optimise", [pytest.param(False, id="-O0"), pytest.param(True, id="-O2", marks=pytest.mark.long)]
)


def cases() -> list[object]:
    """Every format, sender and source, but those that end by silence: a file has no times."""
    found = []
    for name in sorted(FORMATS):
        model = loaded(FORMATS[name]).model
        if model.format.ends_by_silence:
            continue
        for end in (End.MCU, End.HOST):
            for run_time in (False, True):
                speaks_first = (end == End.HOST) == (name != "words")
                short = name in ALWAYS and speaks_first and (not run_time or name == "enterprize")
                if any(m.sent_by(end) for m in model.messages):
                    label = f"{name}-{end}-{'run-time' if run_time else 'constant'}"
                    marks = [] if short else [pytest.mark.long]
                    found.append(pytest.param(name, end, run_time, marks=marks, id=label))
    return found


@optimised
@pytest.mark.parametrize(("name", "sender", "run_time"), cases())
def test_generated_code_and_engine_agree(
    name: str, sender: End, run_time: bool, optimise: bool, tmp_path: Path
) -> None:
    proto = loaded(FORMATS[name])
    is_sanitized = name in SANITIZED and not run_time
    program = build_decoder(proto.model, sender, run_time=run_time, optimise=optimise, sanitize=is_sanitized)
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


@optimised
@pytest.mark.parametrize("sender", [End.HOST, End.MCU])
@pytest.mark.parametrize("name", ["enterprize", "diffdrive", "pid_tuner"])
def test_generated_code_finds_every_vector_between_noise(
    name: str, sender: End, optimise: bool, tmp_path: Path
) -> None:
    frames = [v.frame for v in accepted_vectors() if v.protocol == name and v.sender == sender.value]
    if not frames:
        return  # no vector of this end
    program = build_decoder(codec(name).model, sender, optimise=optimise, sanitize=name in SANITIZED)
    file = tmp_path / "vectors.bin"
    for gap in (b"", b"\x01\x02\x03noise\xff"):
        file.write_bytes(gap + gap.join(frames) + gap)
        for chunk in CHUNKS:
            found = decode(program, file, chunk=chunk, seed=1)
            assert [f.wire for f in found.frames] == frames


@optimised
def test_generated_code_refuses_what_must_be_refused(optimise: bool, tmp_path: Path) -> None:
    for rejected in rejected_vectors():
        program = build_decoder(codec(rejected.protocol).model, End.HOST, optimise=optimise)
        file = tmp_path / "rejected.bin"
        file.write_bytes(rejected.frame)
        for chunk in CHUNKS:
            result = decode(program, file, chunk=chunk, seed=1)
            assert result.frames == []
            assert result.account["discarded.check_mismatch"] == len(rejected.frame)
