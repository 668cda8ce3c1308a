"""Records on a disk that is full. Run in a mount namespace of its own, in which a file system of 256 KiB is mounted at
the given folder; prints the name of each case that held."""

from __future__ import annotations

import contextlib
import io
import logging
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import wirebond
from tests.waiting import PATIENCE, moments, wait_until
from wirebond import recording as recordings
from wirebond.cli.main import main
from wirebond.server import Server

DISK = Path(sys.argv[1])
DIFFDRIVE = sys.argv[2]
PAGE = 4096
SAID: list[str] = []


class Keep(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        SAID.append(record.getMessage())


@contextlib.contextmanager
def room_for(size: int) -> Iterator[None]:
    """All of the disk but ``size`` bytes is taken."""
    ballast = DISK / "ballast"
    with ballast.open("wb", buffering=0) as file:
        with contextlib.suppress(OSError):
            while file.write(bytes(PAGE)) == PAGE:
                pass
        file.truncate(max(0, file.tell() // PAGE * PAGE - size))
    try:
        yield
    finally:
        ballast.unlink()


def run(*arguments: str) -> tuple[int, str, str]:
    """The command: its exit code, stdout and stderr."""
    out, said = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(said):
        code = main(list(arguments))
    return code, out.getvalue(), " ".join(said.getvalue().split())


def bulk(path: Path) -> list[int]:
    return [int(event.facts["number"]) for event in recordings.open(path).events if event.kind == "bulk"]


def goes_on(link: wirebond.Link) -> None:
    assert link.request("status_query", timeout=PATIENCE)
    assert link.state == "up"


def a_recorder_in_a_program() -> None:
    path = DISK / "run.mcap"
    with wirebond.open(DIFFDRIVE, "sim:") as link, room_for(5 * PAGE):
        recorder = link.record(path)
        for number, _ in enumerate(moments("the disk is full")):
            if recorder.error:
                break
            link.note("bulk", number=number, text="x" * 500)
        assert "no space is left on the disk; make room, or record to another one" in recorder.error
        assert "Everything written before that can be read" in recorder.error
        goes_on(link)
        recorder.close()
        assert SAID.count(recorder.error) == 1
        kept = bulk(path)
        assert kept == list(range(len(kept)))
        assert 10 < len(kept) < number
        before = path.read_bytes()
        code, _, said = run("info", str(path))
        assert code == 0
        assert "cannot be closed here (No space left on device); it is as it was" in said
        assert path.read_bytes() == before
    code, shown, _ = run("info", str(path))
    assert code == 0
    assert "repaired" in shown
    assert bulk(path) == kept
    assert recordings.open(path).is_closed
    path.unlink()


def a_recorder_that_closes() -> None:
    path = DISK / "run.mcap"
    with wirebond.open(DIFFDRIVE, "sim:") as link:
        recorder = link.record(path)
        for number in range(20):
            link.note("bulk", number=number, text="x" * 500)
        goes_on(link)  # a message is in the recording, for the export below
        wait_until(lambda: recorder.size > 10_000, SAID)
        with room_for(PAGE):
            recorder.close()
        assert not recorder.error
        assert any("is whole, and was not compressed: No space left on device" in said for said in SAID), SAID
        goes_on(link)
    assert bulk(path) == list(range(20))
    assert not recordings.open(path).problems
    assert not recordings.open(path).is_closed
    with room_for(0):
        code, _, said = run("export", str(path), "--to", "csv", "-o", str(DISK / "out"))
        assert code != 0
        assert "no space is left on the disk; nothing was changed" in said, said
    assert not list(DISK.glob("out/*"))
    path.rename(DISK / "kept.mcap")


def the_command() -> None:
    """A replayed recording is a port with much to say."""
    path = DISK / "again.mcap"
    with room_for(3 * PAGE):
        codec = wirebond.load(DIFFDRIVE)
        frames = DISK.parent / "frames.mcap"
        writer = recordings.writer.RecordingWriter(frames, codec, "host", 0.0, time.time_ns(), {})
        odometry = codec.encode("odometry", left_ticks=1, right_ticks=2)
        for step in range(2000):
            writer.add(recordings.recorder.Chunk(step * 0.05, step * 0.05, "received", odometry))
        writer.finish()
        writer.close()
        code, _, said = run("record", DIFFDRIVE, f"replay:{frames}?speed=max", "-o", str(path))
        assert code == 1
        assert f"the recording {path} ended early: no space is left on the disk" in said
        kept = recordings.open(path)
        assert 0 < kept.stats().messages["odometry"] < 2000
        assert "Traceback" not in said
    path.unlink()


def a_server() -> None:
    with (
        wirebond.open(DIFFDRIVE, "sim:") as own,
        Server(own, DISK.parent / "socket", recordings=DISK / "kept") as server,
        wirebond.open(f"wirebond://{DISK.parent / 'socket'}") as link,
    ):
        with room_for(0):
            with pytest.raises(wirebond.UsageError, match=r"cannot record to .*: No space left on device; check the"):
                link.recordings.start()
            assert not list((DISK / "kept").iterdir())
        with room_for(4 * PAGE):
            began = link.recordings.start()
            for number, _ in enumerate(moments("the disk is full")):
                if link.recordings.current is None:
                    break
                link.note("bulk", number=number, text="x" * 500)
            (listed,) = link.recordings.list()
            assert listed.state == "unclosed"
            assert "ended early: no space is left on the disk" in listed.error
            goes_on(link)
        kept = bulk(Path(began.path))
        assert kept == list(range(len(kept)))
        assert kept
        again = link.recordings.start()
        assert link.recordings.stop().state == "closing"
        wait_until(lambda: {one.name: one.state for one in link.recordings.list()}[again.name] == "closed", SAID)
        with room_for(0):
            path = server.recordings.path(again.name)
            while path.stat().st_size % PAGE < PAGE - 600:  # the last page takes this one
                link.recordings.annotate(again.name, "x" * 300)
            before = path.read_bytes()
            with pytest.raises(wirebond.UsageError, match=r"cannot write to .*: No space left on device"):
                link.recordings.annotate(again.name, "x" * 4000)
            assert server.recordings.path(again.name).read_bytes() == before
        assert recordings.open(server.recordings.path(again.name)).is_closed


if __name__ == "__main__":
    logging.getLogger("wirebond").addHandler(Keep())
    for case in (a_recorder_in_a_program, a_recorder_that_closes, the_command, a_server):
        case()
        print(case.__name__, flush=True)
