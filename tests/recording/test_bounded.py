"""Recordings of any length are read and closed some MiB at a time."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import mcap.reader
import numpy as np
import pytest

import wirebond
from tests.recording.made import drive, made
from tests.shared import codec
from wirebond import _engine
from wirebond import recording as recordings
from wirebond.recording.closing import close_recording
from wirebond.recording.export import export


@pytest.fixture(scope="module")
def diffdrive() -> wirebond.Codec:
    return codec("diffdrive")


def said(path: Path) -> list[object]:
    found = recordings.open(path)
    assert not found.problems
    messages = [(m.t, m.name, m.fields, m.raw) for m in found]
    return [messages, list(found.chunks()), found.events, found.stats("mcu"), found.stats("host"), found.duration]


@pytest.mark.parametrize("window", [40, 1000])
def test_records_that_cross_the_bounds_of_a_read_are_whole(
    tmp_path: Path, diffdrive: wirebond.Codec, monkeypatch: pytest.MonkeyPatch, window: int
) -> None:
    path = made(tmp_path / "run.mcap", diffdrive, drive(diffdrive, 5.0))
    whole = said(path)
    with monkeypatch.context() as patch:
        patch.setattr("wirebond.recording.scan._WINDOW", window)
        assert said(path) == whole
        close_recording(path)
        assert said(path) == whole
    assert said(path) == whole
    found = recordings.open(path)
    for sender in ("mcu", "host"):
        assert found.columns(sender).stats == found.stats(sender)


def test_memory_does_not_grow_with_the_recording(
    tmp_path: Path, diffdrive: wirebond.Codec, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wirebond.recording.scan._WINDOW", 1 << 14)
    monkeypatch.setattr("wirebond.recording.closing.CHUNK", 1 << 14)
    peaks = []
    for number, seconds in enumerate((40.0, 200.0)):
        path = made(tmp_path / f"{number}.mcap", diffdrive, drive(diffdrive, seconds))
        recordings.open(path).stats()
        tracemalloc.start()
        try:
            close_recording(path)
            recordings.open(path).stats()
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
    assert peaks[1] < 1.5 * peaks[0], peaks


def test_an_exported_file_has_an_index_of_every_message(
    tmp_path: Path, diffdrive: wirebond.Codec, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("wirebond.recording.closing.CHUNK", 5000)
    found = recordings.open(made(tmp_path / "run.mcap", diffdrive, drive(diffdrive, 20.0)))
    (path,) = export(found, "mcap", tmp_path)
    with path.open("rb") as file:
        reader = mcap.reader.make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert len(summary.chunk_indexes) == summary.statistics.chunk_count > 5
        indexed = list(reader.iter_messages(topics=["mcu/odometry"], starting_at=found._start_ns))
        times = [message.publish_time for _, _, message in indexed]
        middle = (times[0] + times[-1]) // 2
        later = list(reader.iter_messages(topics=["mcu/odometry"], starting_at=middle))
    assert len(indexed) == found.stats().messages["odometry"]
    assert 0 < len(later) < len(indexed)
    start = found._start_ns
    assert [round((t - start) / 1e3) for t in times] == [round(m.t * 1e6) for m in found if m.name == "odometry"]


def test_the_engine_trusts_no_place_and_no_length() -> None:
    one = np.ones(1, np.uint64)
    decoder = codec("diffdrive").decoder("mcu").engine
    for places, sizes in ((one * 9, np.ones(1, np.uint32)), (one, np.full(1, 0xFFFFFFFF, np.uint32))):
        with pytest.raises(ValueError, match="a place is outside the data"):
            decoder.feed_reads(b"12345678", places, sizes, np.zeros(1), True)
        pieces = (np.ones(1, np.uint16), one, one, places, sizes)
        with pytest.raises(ValueError, match="a place is outside the data"):
            _engine.packed_records(b"12345678", pieces, (b"", b"", b"", b""), [])
    with pytest.raises(ValueError, match="fewer places or sizes"):
        decoder.feed_reads(b"", b"", b"", np.zeros(1), True)
    with pytest.raises(ValueError, match="a time is not finite"):
        decoder.feed_reads(b"12", one, np.ones(1, np.uint32), np.full(1, np.nan), True)
    with pytest.raises(ValueError, match="buffers of different lengths"):
        _engine.packed_records(b"", (b"", b"", b"", b"", b""), (b"", b"", b"", b""), [b"x"])
    with pytest.raises(TypeError):
        _engine.packed_records(b"", (b"", b"", b"", b"", b""), (bytes(4), bytes(2), bytes(8), bytes(8)), ["x"])  # type: ignore[list-item]
