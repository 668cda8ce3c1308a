"""A raw capture wherever a recording is taken: its bytes come one after the other, as on a full line."""

from __future__ import annotations

import csv
import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import wirebond
from tests.shared import PROTOCOLS, codec
from tests.waiting import wait_until
from wirebond import recording as recordings
from wirebond.cli.main import main
from wirebond.errors import PortError, UsageError, WirebondError
from wirebond.protocol.model import End

pytestmark = pytest.mark.live
DIFFDRIVE = codec("diffdrive")
FILE = str(PROTOCOLS / "diffdrive.yaml")
BYTE = 10 / 115200  # seconds
COUNT = 300


def frames(count: int = COUNT) -> bytes:
    return b"".join(DIFFDRIVE.encode("odometry", left_ticks=n, right_ticks=-n) for n in range(count))


@pytest.fixture
def capture(tmp_path: Path) -> Path:
    """Noise, then odometry."""
    path = tmp_path / "line.bin"
    path.write_bytes(b"\x01\x02\x03" + frames())
    return path


def as_hex(data: bytes) -> str:
    return "".join(f"{data[at : at + 16].hex(' ').upper()}\n" for at in range(0, len(data), 16))


def test_it_gives_messages_columns_and_an_account_at_the_times_of_a_full_line(capture: Path) -> None:
    recording = recordings.open(capture, FILE)
    assert recording.is_capture and recording.is_finished and not recording.problems
    assert recording.raw("received") == capture.read_bytes() and not recording.raw("sent")
    assert [m.fields["left_ticks"] for m in recording] == list(range(COUNT))
    table = recording.columns()["odometry"]
    assert list(table["right_ticks"]) == [-n for n in range(COUNT)]
    behind = [(3 + 11 * (n + 1)) * BYTE for n in range(COUNT)]  # when the last byte of each frame has come
    assert all(0 <= end - t <= 0.0021 for t, end in zip(table.t, behind, strict=True))
    assert list(table.t) == [m.t for m in recording]
    assert recording.duration == pytest.approx((3 + 11 * COUNT) * BYTE, abs=1e-5)
    assert sum(recording.stats().discarded_bytes.values()) == 3
    assert recording.started.timestamp() == pytest.approx(capture.stat().st_mtime, abs=0.001)
    assert recording.size == capture.stat().st_size


@pytest.mark.parametrize("name", ["line.hex", "line.txt"])
def test_one_of_hex_digits_is_the_same(capture: Path, name: str) -> None:
    text = capture.with_name(name)
    text.write_text(as_hex(capture.read_bytes()))
    found, expected = recordings.open(text, FILE), recordings.open(capture, DIFFDRIVE)
    assert found.raw("received") == expected.raw("received")
    assert [m.raw for m in found] == [m.raw for m in expected]


def test_an_invalid_hex_digit_is_named_with_its_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "line.hex"
    path.write_text("AA 55\n01 zz\n")
    with pytest.raises(UsageError, match=r"line\.hex:2: 'z' is not a hex digit"):
        recordings.open(path, FILE)
    for command in (["info", str(path), "--protocol", FILE], ["decode", FILE, str(path)], ["identify", str(path)]):
        assert main(command) == 2
        assert "line.hex:2: 'z' is not a hex digit" in " ".join(capsys.readouterr().err.split())


def test_bytes_of_the_host_are_the_sent_ones(tmp_path: Path) -> None:
    path = tmp_path / "host.bin"
    path.write_bytes(b"".join(DIFFDRIVE.encode("velocity", linear=0.001 * n) for n in range(50)))
    recording = recordings.open(path, FILE)
    assert recording.raw("sent") == path.read_bytes()
    assert [end for end, _ in recording.messages_of()] == [End.HOST] * 50


def test_without_a_protocol_a_sentence_asks_for_one(capture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(WirebondError, match="name the protocol of a raw capture"):
        recordings.open(capture)
    assert main(["info", str(capture)]) == 1
    assert "--protocol FILE" in capsys.readouterr().err
    empty = capture.with_name("empty.bin")
    empty.touch()
    with pytest.raises(WirebondError, match="is empty"):
        recordings.open(empty, FILE)
    recording = capture.rename(capture.with_name("line.mcap"))
    with pytest.raises(WirebondError, match="is not an MCAP file"):
        recordings.open(recording, FILE)


def test_frames_that_silence_ends_cannot_be_found_and_a_sentence_says_so(tmp_path: Path) -> None:
    path = tmp_path / "bus.bin"
    path.write_bytes(bytes.fromhex("0103 0000 0001 840A".replace(" ", "")))
    [said] = recordings.open(path, PROTOCOLS / "contrib" / "modbus_rtu.yaml").problems
    assert "frames of modbus_rtu end by silence" in said


def test_info_and_export_take_it_and_leave_it_as_it_is(
    capture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = capture.read_bytes(), capture.stat().st_mtime_ns
    assert main(["info", str(capture), "--protocol", FILE]) == 0
    said = capsys.readouterr().out
    assert "a raw capture without times: these are of a full line of 115200 baud" in said
    assert f"odometry: {COUNT}" in said and "repaired" not in said
    assert main(["info", str(capture), "--protocol", FILE, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["capture"] and not told["repaired"] and told["accounts"]["mcu"]["messages"] == {"odometry": COUNT}
    out = tmp_path / "out"
    assert main(["export", str(capture), "--to", "csv", "-o", str(out), "--protocol", FILE]) == 0
    rows = list(csv.DictReader((out / "odometry.csv").open()))
    assert [int(row["left_ticks"]) for row in rows] == list(range(COUNT))
    assert (capture.read_bytes(), capture.stat().st_mtime_ns) == before


def test_a_full_disk_is_a_sentence_and_leaves_nothing(
    capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))

    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patched:
        patched.setattr("wirebond.recording.writer.os.write", full)
        assert main(["info", str(capture), "--protocol", FILE]) != 0
    assert "no space is left on the disk" in capsys.readouterr().err
    assert not list(folder.iterdir())
    recordings.open(capture, FILE)
    assert not list(folder.iterdir())


def test_a_link_replays_it_with_its_own_protocol(capture: Path) -> None:
    with wirebond.open(DIFFDRIVE, f"replay:{capture}?speed=max") as link:
        found: list[wirebond.Message] = []
        wait_until(lambda: found.extend(link.receive(0.1)) or link.state == "down", "the end of the replay")
        found += link.receive(0)
    assert [m.fields["left_ticks"] for m in found] == list(range(COUNT))
    with pytest.raises(PortError, match="No such file"):
        wirebond.open(DIFFDRIVE, f"replay:{capture}.bin")


def test_the_command_replays_it_on_a_pty(capture: Path) -> None:
    command = [sys.executable, "-m", "wirebond", "replay", str(capture), "--speed", "max", "--protocol", FILE]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        with wirebond.open(DIFFDRIVE, process.stdout.readline().strip()) as link:
            wait_until(lambda: link.stats.receive.frames >= COUNT, lambda: link.stats)
        assert process.wait() == 0


def test_decode_and_identify_read_hex_files(capture: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = capture.with_name("line.hex")
    text.write_text(as_hex(capture.read_bytes()))
    printed = []
    for path in (capture, text):
        assert main(["decode", FILE, str(path)]) == 0
        printed.append(capsys.readouterr().out)
    assert printed[0] == printed[1] and printed[0].count("odometry") == COUNT
    assert main(["identify", str(text)]) == 0
    assert "diffdrive" in capsys.readouterr().out
