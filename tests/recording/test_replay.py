"""A recording again: through a port, a pty, a callable, a link, and into the rover's firmware under virtual time."""

from __future__ import annotations

import asyncio
import json
import os
import select
import subprocess
import sys
import threading
from pathlib import Path

import pytest

import wirebond
from tests.recording.made import WALL_NS, drive, made
from tests.shared import PROTOCOLS, codec, rover_program
from tests.waiting import PATIENCE, Stopwatch, moments, wait_until
from wirebond import recording as recordings
from wirebond.cli.main import main
from wirebond.errors import PortError, UsageError
from wirebond.link.tap import Chunk, LinkEvent
from wirebond.recording.into_firmware import RecordedFirmware, replay_into_firmware
from wirebond.recording.replay_port import ReplayOpener, ReplayPort
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live

DIFFDRIVE = codec("diffdrive")


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return made(tmp_path / "run.mcap", DIFFDRIVE, drive(DIFFDRIVE, 3.0))


def messages_of(port: str, role: str = "host") -> list[tuple[str, bytes, float]]:
    """All that a link reads, until the replay has ended; times since the first one."""
    found: list[wirebond.Message] = []
    with wirebond.open(DIFFDRIVE, port, role=role) as link:
        wait_until(lambda: found.extend(link.receive(0.1)) or link.state == "down", "the end of the replay")
        found += link.receive(0)
        assert "has ended" in link.why
        assert link.stats.dropped_messages == 0
    return [(m.name, m.raw, round(m.t - found[0].t, 6)) for m in found]


@pytest.mark.parametrize("speed", ["max", "30"])
def test_a_link_reads_the_same_messages_at_the_same_times(run: Path, speed: str) -> None:
    recorded = list(recordings.open(run).messages("mcu"))
    expected = [(m.name, m.raw, round(m.t - recorded[0].t, 6)) for m in recorded]
    for _ in range(2):
        assert messages_of(f"replay:{run}?speed={speed}") == expected


def test_a_frame_with_a_silence_inside_is_refused_at_any_speed(tmp_path: Path) -> None:
    frame = DIFFDRIVE.encode("odometry", left_ticks=1, right_ticks=2)
    pieces = [
        Chunk(0.1, 0.1, "received", frame[:5]),
        Chunk(0.105, 0.105, "received", frame[5:]),
        Chunk(0.2, 0.2, "received", frame[:5]),
        Chunk(0.3, 0.3, "received", frame[5:] + frame),
    ]
    path = made(tmp_path / "run.mcap", DIFFDRIVE, pieces)
    assert [t for _, _, t in messages_of(f"replay:{path}?speed=max")] == [0.0, 0.195]


def test_deadlines_strike_by_the_recordings_clock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    velocity = DIFFDRIVE.encode("velocity", linear=0.5)
    pieces = [Chunk(t, t, "sent", velocity) for t in (10.1, 11.9, 12.0)]
    path = made(tmp_path / "run.mcap", DIFFDRIVE, pieces)
    is_tapped, open_port = threading.Event(), ReplayOpener.open

    def open_then(opener: ReplayOpener) -> ReplayPort:  # else the replay may have ended before the tap is there
        if not is_tapped.is_set():
            raise PortError("the tap is not there yet; wait for it", None, str(path))
        return open_port(opener)

    monkeypatch.setattr(ReplayOpener, "open", open_then)
    with wirebond.open(DIFFDRIVE, f"replay:{path}?speed=40", role="mcu", wait_for_port=True) as link:
        tap = link.tap()
        is_tapped.set()
        wait_until(lambda: link.receive(0.05) is not None and "has ended" in link.why, "the end of the replay")
        found = tap.take().pieces
    first = next(p.t for p in found if isinstance(p, Chunk))
    events = [(p.kind, p.t - first) for p in found if isinstance(p, LinkEvent) and p.t >= first]
    assert next(t for kind, t in events if kind == "deadline_struck") == pytest.approx(1.005, abs=0.0051)
    ended = [t for kind, t in events if kind == "deadline_ended" and t > 0]
    assert ended[0] == pytest.approx(1.8, abs=0.0051)


def test_the_mcus_end_reads_what_the_host_sent(run: Path) -> None:
    names = [name for name, _, _ in messages_of(f"replay:{run}?speed=max", role="mcu")]
    assert names.count("velocity") == 60


def test_a_section_of_it(run: Path) -> None:
    found = messages_of(f"replay:{run}?speed=max&from=1s&to=2.0")
    assert [name for name, _, _ in found].count("odometry") == 20
    chunks: list[Chunk] = []
    count = recordings.open(run).replay(chunks.append, speed=0, start=1.0, stop=2.0, direction="sent")
    assert count == len(chunks) == 21
    assert chunks[0].t == pytest.approx(0.001)


def test_it_keeps_its_pace_and_loops(run: Path) -> None:
    ends = threading.Event()
    seen: list[float] = []

    def take(chunk: Chunk) -> None:
        seen.append(chunk.t)
        if chunk.t > 6.5:
            ends.set()

    watch = Stopwatch()
    recordings.open(run).replay(take, speed=20, loop=True, ends=ends)
    assert watch.seconds >= 6.5 / 20
    assert seen == sorted(seen)


def test_a_link_sends_again_what_was_sent(run: Path) -> None:
    far = PtyPort()
    with wirebond.open(DIFFDRIVE, far.path, paced=False) as link:
        recordings.open(run).replay(link, speed=0, stop=0.5)
        expected = b"".join(c.bytes for c in recordings.open(run).chunks("sent") if c.t <= 0.5)
        got = b""
        for _ in moments("all that was sent"):
            got += far.read(0.1)
            if len(got) >= len(expected):
                break
    far.close()
    assert got[: len(expected)] == expected


def test_the_command_replays_to_a_pty(run: Path) -> None:
    command = [sys.executable, "-m", "wirebond.cli.main", "replay", str(run), "--speed", "max", "--pty"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as replay:
        assert replay.stdout is not None
        path = replay.stdout.readline().decode().strip()
        expected = recordings.open(run).raw("received")
        with wirebond.open(DIFFDRIVE, path, hello=False) as link:
            wait_until(lambda: link.stats.receive.bytes >= len(expected), "all that was received")
            assert replay.wait(PATIENCE) == 0
            assert link.dump().received == expected


def test_bytes_on_their_way_to_the_program_count_as_unread() -> None:
    port = PtyPort()
    program = os.open(port.path, os.O_RDWR | os.O_NOCTTY)
    for _ in range(1000):
        port.write(b"abc")
        assert port.unread() == 3  # at once, before the kernel has handed them over
        assert os.read(program, 4096) == b"abc"
        assert port.unread() == 0
    os.close(program)
    port.close()


def test_a_replay_to_a_program_that_does_not_read_ends_when_it_closes_its_side(run: Path) -> None:
    command = [sys.executable, "-m", "wirebond.cli.main", "replay", str(run), "--speed", "max", "--pty"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as replay:
        assert replay.stdout is not None
        program = os.open(replay.stdout.readline().decode().strip(), os.O_RDWR | os.O_NOCTTY)
        assert select.select([program], [], [], PATIENCE)[0]
        os.close(program)
        assert replay.wait(PATIENCE) == 0


def test_monitor_ends_with_the_recording(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["monitor", str(PROTOCOLS / "diffdrive.yaml"), f"replay:{run}?speed=max", "--json"]) == 0
    told = capsys.readouterr()
    messages = [json.loads(line) for line in told.out.splitlines()]
    assert [m["message"] for m in messages if "message" in m].count("odometry") == 60
    assert "63 frames" in told.err
    assert "Waiting" not in told.err


def test_a_loop_over_messages_ends_with_the_recording(run: Path) -> None:
    with wirebond.open(PROTOCOLS / "diffdrive.yaml", f"replay:{run}?speed=max") as link:
        assert [m.name for m in link].count("odometry") == 60

    async def looped() -> int:
        async with wirebond.open(PROTOCOLS / "diffdrive.yaml", f"replay:{run}?speed=max").aio as aio:
            return [m.name async for m in aio].count("odometry")

    assert asyncio.run(looped()) == 60


def test_wrong_options_have_their_sentence(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for port, said in (
        ("replay:", "names no recording"),
        (f"replay:{run}?spped=2", "option 'spped'"),
        (f"replay:{run}?speed=fast", "is not a number"),
        (f"replay:{run}?speed=-1", "the speed is -1"),
        (f"replay:{run}?from=2&to=1", "more than the start"),
    ):
        with pytest.raises(UsageError, match=said):
            wirebond.open(DIFFDRIVE, port)
    for path in ("/none.mcap", str(PROTOCOLS / "diffdrive.yaml")):
        with pytest.raises(PortError, match="cannot be replayed"):
            wirebond.open(DIFFDRIVE, f"replay:{path}")
    for options, code, said in (
        (["--speed", "fast"], 2, "a number, or max"),
        (["--from", "soon"], 2, "seconds, such as 12.5s"),
        (["--from", "5", "--to", "1"], 2, "more than the start"),
        (["--out", "x.mcap"], 2, "--out goes with --into"),
        (["--into", str(tmp_path)], 2, "not a program that may be run"),
        (["--into", str(tmp_path / "none")], 2, "is not there"),
        (["--sender", "nobody"], 2, "expected 'mcu' or 'host'"),
    ):
        assert main(["replay", str(run), *options]) == code
        assert said in " ".join(capsys.readouterr().err.split())


# ---- into a firmware


@pytest.fixture(scope="module")
def program() -> Path:
    return rover_program()


def driven(path: Path, program: Path) -> Path:
    """The rover under virtual time, with a host that hangs for a while, and an operator."""
    with RecordedFirmware(program, path, DIFFDRIVE, WALL_NS) as firmware:
        for step in range(115):
            firmware.advance_to(0.05 * step + 0.000_137 * (step % 7))
            if step < 20 or step > 90:
                firmware.send(DIFFDRIVE.encode("velocity", linear=0.01 * step, angular=0.2))
            if step % 20 == 0:
                firmware.advance(0.001)
                firmware.send(DIFFDRIVE.encode("status_query"))
            if step == 105:
                firmware.tell("estop on")
        firmware.advance(0.3)
    return path


def test_a_firmware_does_again_what_it_did(tmp_path: Path, program: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording = recordings.open(driven(tmp_path / "run.mcap", program))
    assert [m.name for m in recording.messages("mcu")].count("odometry") > 80
    once = replay_into_firmware(recording, program, tmp_path / "once.mcap")
    assert once.sent == recording.raw("received")
    assert once.differs_at is None
    assert any(e.facts["text"] == "safe_mode" and 3.9 < e.t < 4.1 for e in once.events)
    assert replay_into_firmware(recording, program, tmp_path / "twice.mcap") == once
    assert (tmp_path / "once.mcap").read_bytes() == (tmp_path / "twice.mcap").read_bytes()
    assert recordings.open(tmp_path / "once.mcap").raw("received") == once.sent
    assert main(["replay", str(recording.path), "--into", str(program)]) == 0
    told = capsys.readouterr()
    assert "they are the bytes that were recorded" in told.err
    assert "safe_mode" in told.out


def test_a_recording_of_a_real_link_gives_the_same_bytes_twice(tmp_path: Path, program: Path) -> None:
    path = tmp_path / "run.mcap"
    with wirebond.open(PROTOCOLS / "diffdrive.yaml", "sim:") as link, link.record(path):
        for step in range(20):
            link.send("velocity", linear=0.05 * step, angular=0.1)
            link.request("status_query")
    recording = recordings.open(path)
    once = replay_into_firmware(recording, program)
    assert replay_into_firmware(recording, program) == once
    assert once.differs_at is not None  # a virtual MCU made up other values


def test_a_time_between_two_microseconds_holds_nothing_up(tmp_path: Path, program: Path) -> None:
    with RecordedFirmware(program) as firmware:
        firmware.advance_to(0.010_000_4)
        assert firmware.now == 0.01
        firmware.advance_to(0.010_000_6)
        assert firmware.now == 0.010_001


def test_a_firmware_that_ends_has_its_sentence(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ends = tmp_path / "ends"
    ends.write_text("#!/bin/sh\nexit 0\n")
    ends.chmod(0o755)
    assert main(["replay", str(run), "--into", str(ends)]) == 1
    assert "has ended" in capsys.readouterr().err
