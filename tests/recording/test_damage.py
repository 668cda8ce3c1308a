"""Recordings that are cut short, damaged, or no recordings: a sentence each, and what can be read is read."""

from __future__ import annotations

import errno
import json
import os
import random
import resource
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import pytest
from mcap.reader import NonSeekingReader
from mcap.writer import Writer

import wirebond
from tests.recording.made import drive, made
from tests.shared import PROTOCOLS, codec, few_or_many
from tests.waiting import PATIENCE, let_pass, wait_until
from wirebond import recording as recordings
from wirebond.cli.main import main
from wirebond.errors import WirebondError
from wirebond.link.tap import Chunk, LinkEvent
from wirebond.recording.closing import close_recording
from wirebond.recording.mcap_file import CHUNK, DATA_END, HEAD, MAGIC
from wirebond.recording.writer import RecordingWriter

pytestmark = pytest.mark.live


@pytest.fixture(scope="module")
def diffdrive() -> wirebond.Codec:
    return codec("diffdrive")


def small(tmp_path: Path, codec: wirebond.Codec, *, closed: bool = False) -> bytes:
    path = made(tmp_path / "small.mcap", codec, drive(codec, 0.2), batch=1)
    if closed:
        close_recording(path)
    data = path.read_bytes()
    path.unlink()
    return data


def read(path: Path, protocol: wirebond.Codec | None) -> recordings.Recording | str:
    """Everything of it; or the sentence that says why not. ``protocol``: that of the file is not read, it is slow."""
    try:
        found = recordings.open(path, protocol)
        for sender in ("mcu", "host"):
            assert found.columns(sender).stats.frames == sum(1 for _ in found.messages(sender))
        found.events  # noqa: B018
        assert found.duration >= 0
        repr(found.started)
        return found
    except WirebondError as error:
        return str(error)


@few_or_many(7, 1)  # bytes between two cuts
def test_cut_anywhere_a_recording_keeps_its_whole_part(tmp_path: Path, diffdrive: wirebond.Codec, number: int) -> None:
    data = small(tmp_path, diffdrive)
    pieces = [p for p in drive(diffdrive, 0.2) if isinstance(p, Chunk)]
    path = tmp_path / "cut.mcap"
    counts = set()
    text = data.index(diffdrive.model.text.encode()) + len(diffdrive.model.text)
    for end in [*range(0, text, 301), *range(text, len(data), number), len(data)]:
        path.write_bytes(data[:end])
        found = read(path, diffdrive if end > text + 4 and end % 50 else None)
        if isinstance(found, str):
            assert end <= text + 4
            assert any(said in found for said in ("not an MCAP file", "is empty", "no protocol file", "no raw bytes"))
            continue
        chunks = list(found.chunks())
        counts.add(len(chunks))
        assert [c.bytes for c in chunks] == [p.bytes for p in pieces[: len(chunks)]]
        if not found.is_finished:
            assert found.problems
    assert counts == set(range(len(pieces) + 1))


@few_or_many(300, 20_000)
@pytest.mark.parametrize("closed", [False, True])
def test_flipped_bits_never_do_harm(tmp_path: Path, diffdrive: wirebond.Codec, closed: bool, number: int) -> None:
    data = small(tmp_path, diffdrive, closed=closed)
    source = random.Random(f"flips {closed}")
    path = tmp_path / "flipped.mcap"
    for turn in range(number):
        flipped = bytearray(data)
        for _ in range(source.choice([1, 1, 1, 3, 50])):
            flipped[source.randrange(len(data))] ^= 1 << source.randrange(8)
        path.write_bytes(flipped)
        found = read(path, diffdrive if turn % 10 else None)
        assert isinstance(found, str) or len(found.raw("received")) < 10 * len(data)


def test_a_damaged_chunk_is_skipped_and_reported(tmp_path: Path, diffdrive: wirebond.Codec) -> None:
    path = made(tmp_path / "run.mcap", diffdrive, drive(diffdrive, 500.0))
    close_recording(path)
    before = recordings.open(path).raw("received")
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0x10
    path.write_bytes(data)
    after = recordings.open(path)
    assert len(after.problems) == 1
    assert "damaged" in after.problems[0]
    assert 0 < len(after.raw("received")) < len(before)


@pytest.fixture(scope="module")
def minute(tmp_path_factory: pytest.TempPathFactory, diffdrive: wirebond.Codec) -> Minute:
    """A closed recording of a minute, and the messages in it."""
    path = made(tmp_path_factory.mktemp("minute") / "run.mcap", diffdrive, drive(diffdrive, 60.0))
    close_recording(path)
    return Minute(path.read_bytes(), rows(recordings.open(path)))


@dataclass(frozen=True)
class Minute:
    data: bytes
    rows: list[Row]

    def without_bit(self, path: Path, at: int, bit: int, protocol: wirebond.Codec | None) -> recordings.Recording:
        """Opens it with one bit flipped, and checks that at most a second is lost, and nothing is invented."""
        flipped = bytearray(self.data)
        flipped[at] ^= 1 << bit
        path.write_bytes(flipped)
        found = recordings.open(path, protocol)
        kept = Counter(rows(found))
        lost = Counter(self.rows) - kept
        times = [row[0] for row in lost]
        assert not times or max(times) - min(times) <= 1.1, (at, bit)  # a frame may lie in two chunks
        assert not kept - Counter(self.rows), (at, bit)
        assert not lost or found.problems, (at, bit)
        return found


Row = tuple[float, str, str]


def rows(found: recordings.Recording) -> list[Row]:
    return [(round(m.t, 4), m.name, str(m.fields)) for sender in ("mcu", "host") for m in found.messages(sender)]


def chunks_of(data: bytes) -> list[int]:
    """Return the position of each chunk."""
    at, found = len(MAGIC), []
    while True:
        opcode, length = HEAD.unpack_from(data, at)
        if opcode == DATA_END:
            return found
        if opcode == CHUNK:
            found.append(at)
        at += HEAD.size + length


def test_a_closed_recording_has_a_chunk_for_each_second(minute: Minute) -> None:
    assert 60 <= len(chunks_of(minute.data)) <= 62


@few_or_many(20, 20_000)
def test_a_flipped_bit_costs_a_second_at_most(
    tmp_path: Path, diffdrive: wirebond.Codec, minute: Minute, number: int
) -> None:
    source = random.Random("a bit")
    for _ in range(number):
        at = source.randrange(len(minute.data))
        minute.without_bit(tmp_path / "flipped.mcap", at, source.randrange(8), diffdrive)


@few_or_many(40, 2000)
def test_a_flipped_bit_where_the_file_says_what_follows_costs_a_second_at_most(
    tmp_path: Path, diffdrive: wirebond.Codec, minute: Minute, number: int
) -> None:
    first, middle = chunks_of(minute.data)[0], chunks_of(minute.data)[30]
    source = random.Random("a head")
    end = len(minute.data)
    places = [*range(40), *range(first, first + 64), *range(middle, middle + 64), *range(end - 60, end)]
    for _ in range(number):
        minute.without_bit(tmp_path / "flipped.mcap", source.choice(places), source.randrange(8), diffdrive)


def test_the_protocol_and_the_files_own_description_survive_a_flipped_bit(
    tmp_path: Path, diffdrive: wirebond.Codec, minute: Minute
) -> None:
    (tmp_path / "whole.mcap").write_bytes(minute.data)
    whole = recordings.open(tmp_path / "whole.mcap")
    begin = minute.data.index(b"started_ns")
    text = minute.data.index(diffdrive.model.text.encode())
    for at in (begin + 2, begin + 15, begin + 25, text - 40, text - 9, text + 5, text + len(diffdrive.model.text) - 1):
        found = minute.without_bit(tmp_path / "flipped.mcap", at, 1, None)
        assert found.codec.hash == diffdrive.hash
        assert (found.started, found.port) == (whole.started, "made")


YEARS = 5e8  # seconds


def test_a_damaged_time_moves_nothing_else(tmp_path: Path, diffdrive: wirebond.Codec) -> None:
    pieces = [p for p in drive(diffdrive, 2.0) if isinstance(p, Chunk)]
    whole = recordings.open(made(tmp_path / "whole.mcap", diffdrive, pieces))
    for far in (Chunk(YEARS, YEARS, "", b""), Chunk(0.0, 0.0, "", b"")):
        for at in (0, 20, 21, -1):
            damaged = list(pieces)
            t = far.t or -1e6
            damaged[at] = Chunk(t, t if at >= 0 else damaged[at].before, damaged[at].direction, damaged[at].bytes)
            path = made(tmp_path / "damaged.mcap", diffdrive, damaged)
            found = recordings.open(path)
            assert found.duration == pytest.approx(whole.duration, abs=0.001)
            for was, now in zip(whole.messages(), found.messages(), strict=True):
                assert now.t == pytest.approx(was.t, abs=0.06)
            path.unlink()


def test_a_last_piece_that_is_years_away_ends_in_time(
    tmp_path: Path, diffdrive: wirebond.Codec, capsys: pytest.CaptureFixture[str]
) -> None:
    pieces = [*drive(diffdrive, 1.0), Chunk(YEARS, YEARS, "received", diffdrive.encode("status_query"))]
    path = made(tmp_path / "run.mcap", diffdrive, pieces)
    assert main(["monitor", str(PROTOCOLS / "diffdrive.yaml"), f"replay:{path}?speed=max", "--json"]) == 0
    assert capsys.readouterr().out.count('"odometry"') == 20
    assert main(["replay", str(path), "--into", sys.executable]) == 2
    assert "lasts 500000000 s, and at most 86400 s go into a firmware" in " ".join(capsys.readouterr().err.split())


def test_info_repairs_a_file_cut_short(
    tmp_path: Path, diffdrive: wirebond.Codec, capsys: pytest.CaptureFixture[str]
) -> None:
    path = made(tmp_path / "run.mcap", diffdrive, drive(diffdrive, 2.0), finished=False)
    path.write_bytes(path.read_bytes()[:-7])
    assert main(["info", str(path), "--no-repair"]) == 0
    assert "bytes after that are lost" in " ".join(capsys.readouterr().err.split())
    assert not recordings.open(path).is_closed
    assert main(["info", str(path)]) == 0
    assert "repaired" in capsys.readouterr().out
    found = recordings.open(path)
    assert found.is_closed
    assert not found.problems
    assert "the last whole record" in found.repaired
    assert main(["info", str(path)]) == 0
    assert "repaired before: " in capsys.readouterr().out


def test_info_does_not_call_a_healthy_file_repaired(
    tmp_path: Path, diffdrive: wirebond.Codec, capsys: pytest.CaptureFixture[str]
) -> None:
    """One that was ended as it should, and not compressed yet."""
    path = made(tmp_path / "run.mcap", diffdrive, drive(diffdrive, 1.0))
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(path.read_bytes())
    assert not recordings.open(path).is_closed
    assert main(["info", str(path)]) == 0
    assert "repaired" not in capsys.readouterr().out
    assert recordings.open(path).is_closed
    assert main(["info", str(copy), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["repaired"] is False


def test_a_file_that_is_no_recording_gets_a_sentence(
    tmp_path: Path, diffdrive: wirebond.Codec, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "x.mcap"
    for content, said in (
        (b"", "is empty"),
        (b"hello", "is not an MCAP file"),
        (b"\x89MCAP0\r\n", "of another program"),
    ):
        path.write_bytes(content)
        for command in (["info", str(path)], ["export", str(path), "--to", "csv"]):
            assert main(command) == 1
            assert said in capsys.readouterr().err
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "somebody else")
        channel = writer.register_channel("/chatter", "cdr", 0)
        writer.add_message(channel, 1, b"hello", 1)
        writer.finish()
    assert main(["info", str(path)]) == 1
    error = capsys.readouterr().err
    assert "of another program (somebody else)" in error
    assert "Traceback" not in error
    assert main(["info", str(tmp_path)]) == 1
    assert "folder" in capsys.readouterr().err
    assert main(["info", str(tmp_path / "none.mcap")]) == 1
    assert "there is no such file" in capsys.readouterr().err


def test_a_recording_without_its_protocol_asks_for_one(
    tmp_path: Path, diffdrive: wirebond.Codec, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "x.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("rx", "raw", 0)
        writer.add_message(channel, 10**18, diffdrive.encode("odometry", left_ticks=1, right_ticks=2), 10**18)
        writer.finish()
    assert main(["info", str(path)]) == 1
    assert "--protocol FILE" in capsys.readouterr().err
    assert main(["info", str(path), "--no-repair", "--protocol", str(PROTOCOLS / "diffdrive.yaml")]) == 0
    assert "odometry: 1" in capsys.readouterr().out


@pytest.mark.skipif(os.geteuid() == 0, reason="the system's administrator may write everywhere")
def test_a_folder_that_may_not_be_written(tmp_path: Path, diffdrive: wirebond.Codec) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    folder.chmod(0o555)
    assert main(["record", str(PROTOCOLS / "diffdrive.yaml"), "sim:", "-o", str(folder / "run.mcap")]) == 1


def test_a_recording_that_cannot_be_closed_is_reported_all_the_same(
    tmp_path: Path, diffdrive: wirebond.Codec, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = made(tmp_path / "run.mcap", diffdrive, drive(diffdrive, 1.0), finished=False)
    before = path.read_bytes()

    def refuse(*_: object, **__: object) -> int:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("wirebond.recording.whole.os.open", refuse)
    assert main(["info", str(path)]) == 0
    monkeypatch.undo()
    told = capsys.readouterr()
    assert "odometry: 20" in told.out
    assert "cannot be closed here (Permission denied)" in " ".join(told.err.split())
    assert path.read_bytes() == before


def test_a_recording_that_grows_is_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "run.mcap"
    with wirebond.open(PROTOCOLS / "diffdrive.yaml", "sim:") as link, link.record(path):
        assert main(["info", str(path)]) == 0
        assert "is being recorded; stop the recording" in " ".join(capsys.readouterr().err.split())
        assert main(["record", str(PROTOCOLS / "diffdrive.yaml"), "sim:", "-o", str(path)]) == 2
        assert "exists already" in capsys.readouterr().err
    assert recordings.open(path).is_closed


def test_a_full_disk_ends_the_recording_and_not_the_link(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "run.mcap"
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with wirebond.open(PROTOCOLS / "diffdrive.yaml", "sim:") as link:
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, hard))  # the system refuses larger files
        try:
            recorder = link.record(path)
            wait_until(lambda: link.note("big", text="x" * 1000) or recorder.error, "the end of the recording")
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        assert "may not become larger" in recorder.error
        assert link.receive(PATIENCE)
        link.send("velocity", linear=0.1)
        recorder.close()
        assert link.state == "up"
    assert [record.message for record in caplog.records if "ended early" in record.message] == [recorder.error]
    found = recordings.open(path)
    assert 0 < sum(event.kind == "big" for event in found.events) < 20
    assert found.problems


@pytest.mark.parametrize("safe_times", [0, 1])
def test_a_disk_that_does_not_keep_what_was_written_is_reported_at_once(
    tmp_path: Path, safe_times: int, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    real, calls = os.fdatasync, list[int]()

    def fails(descriptor: int) -> None:
        calls.append(descriptor)
        if len(calls) > safe_times:
            raise OSError(errno.EIO, "Input/output error")
        real(descriptor)

    path = tmp_path / "run.mcap"
    with wirebond.open(PROTOCOLS / "diffdrive.yaml", "sim:") as link:
        monkeypatch.setattr(os, "fdatasync", fails)
        recorder = link.record(path)
        wait_until(lambda: link.note("lap") or recorder.error, "the error, not only when it is closed")
        assert "the disk did not store the data (Input/output error)" in recorder.error
        if safe_times:
            assert "bytes after them are not" in recorder.error
            assert 0 < recorder.safe_size < recorder.size
        else:
            assert "are safe on the disk" in recorder.error and "None of its" in recorder.error
            assert recorder.safe_size == 0
        assert link.receive(PATIENCE)  # the link goes on
        recorder.close()
    assert [record.message for record in caplog.records if "ended early" in record.message] == [recorder.error]
    assert len(calls) == safe_times + 1  # the system says it once: a later success would prove nothing
    assert "lap" in [event.kind for event in recordings.open(path).events]


def test_the_disk_is_waited_for_only_where_something_is_new(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []
    monkeypatch.setattr(os, "fdatasync", calls.append)
    writer = RecordingWriter(tmp_path / "run.mcap", codec("diffdrive"), "host", 0.0, 0, {})
    writer.flush()
    writer.sync()
    writer.sync()
    assert len(calls) == 1
    writer.add(LinkEvent(1.0, "lap", {}))
    writer.flush()
    writer.sync()
    assert (len(calls), writer.safe_size) == (2, writer.size)
    writer.close()


def test_record_says_what_is_not_safe_on_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fails(_: int) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(os, "fdatasync", fails)
    assert main(["record", str(PROTOCOLS / "diffdrive.yaml"), "sim:", "-o", str(tmp_path / "run.mcap")]) == 1
    told = " ".join(capsys.readouterr().err.split())
    assert "did not store the data (Input/output error)" in told
    assert "bytes are safe on the disk" in told


def test_a_disk_that_fails_at_the_end_is_reported_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(_: int) -> None:
        raise OSError(errno.EIO, "Input/output error")

    with wirebond.open(PROTOCOLS / "diffdrive.yaml", "sim:") as link:
        recorder = link.record(tmp_path / "run.mcap")
        monkeypatch.setattr(os, "fdatasync", fails)
        recorder.close()
    assert "did not store the data" in recorder.error
    assert not recordings.open(tmp_path / "run.mcap").is_closed


def test_a_disk_without_room_for_the_closed_file_keeps_the_open_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(*_: object, **__: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    path = tmp_path / "run.mcap"
    with wirebond.open(PROTOCOLS / "diffdrive.yaml", "sim:") as link:
        recorder = link.record(path)
        link.note("lap")
        with monkeypatch.context() as patch:
            patch.setattr("wirebond.recording.closing.whole_file", refuse)
            recorder.close()
    assert "is whole, and was not compressed: No space left" in caplog.text
    found = recordings.open(path)
    assert found.is_finished
    assert not found.is_closed
    assert "lap" in [event.kind for event in found.events]


# A program that records what it makes itself, and tells how much that is: what it printed is at least 100 ms old.
_WRITER = """
import sys, time, wirebond
from wirebond.sim.pty_port import PtyPort
codec = wirebond.load(sys.argv[1])
far = PtyPort()
frame = codec.encode("odometry", left_ticks=1, right_ticks=2)
with wirebond.open(codec, far.path) as link:
    recorder = link.record(sys.argv[2])
    sent = []
    print("ready", flush=True)
    while True:
        far.write(frame)
        far.read(0)
        sent.append((time.monotonic(), len(frame)))
        sys.stdout.write(f"{sent[-1][0]} {len(sent)}\\n"); sys.stdout.flush()
        time.sleep(0.002)
"""


@pytest.mark.timed(tolerance=0.05)
@few_or_many(2, 100)
def test_a_killed_writer_loses_the_last_100_ms_at_most(tmp_path: Path, number: int) -> None:
    source = random.Random("kill")
    for attempt in range(number):
        path = tmp_path / f"{attempt}.mcap"
        with subprocess.Popen(
            [sys.executable, "-c", _WRITER, str(PROTOCOLS / "diffdrive.yaml"), str(path)], stdout=subprocess.PIPE
        ) as writer:
            assert writer.stdout is not None
            assert writer.stdout.readline() == b"ready\n"
            let_pass(source.uniform(0.15, 0.6))
            killed = time.monotonic()
            writer.send_signal(signal.SIGKILL)
            lines = writer.stdout.read().split(b"\n")
        times = [float(line.split()[0]) for line in lines[:-1] if len(line.split()) == 2]
        due = sum(t < killed - 0.1 for t in times)
        found = recordings.open(path)
        assert len(found.raw("received")) // 11 >= due > 0
        with path.open("rb") as file:
            assert next(NonSeekingReader(file).iter_attachments()).name == "protocol.yaml"
