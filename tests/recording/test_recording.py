"""A recording returns everything that the link did: bytes, messages, times, events; also through the public MCAP
reader."""

from __future__ import annotations

import csv
import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from pyarrow import parquet

import wirebond
from tests.recording.made import WALL_NS, drive, made
from tests.shared import PROTOCOLS, codec
from tests.waiting import PATIENCE, Stopwatch
from wirebond import recording as recordings
from wirebond.cli.main import main
from wirebond.errors import UsageError
from wirebond.link.tap import Chunk, LinkEvent
from wirebond.protocol import loads
from wirebond.recording import export as export_module
from wirebond.recording.closing import close_recording
from wirebond.recording.export import export

pytestmark = pytest.mark.live

KINDS = """
wirebond: 1
protocol: kinds
link: {baud: 115200}
frame:
  - delimiter: 0x00
  - cobs:
    - id: u8
    - payload: rest
    - check: crc-16/ibm-sdlc
  - delimiter: 0x00
messages:
  all:
    id: 1
    sender: mcu
    fields:
      size: {type: u8}
      name: {type: text, size: size, max: 20}
      data: {type: bytes, size: 3}
      axes: {type: i16, count: 2, scale: 0.5}
      mode: {type: u8, enum: {idle: 0, drive: 1}}
      bits: {type: u8, flags: {a: 0, b: 1}}
      list: {type: u8, count: to_end, max: 8}
"""


@pytest.fixture
def diffdrive() -> wirebond.Codec:
    return codec("diffdrive")


def same(a: wirebond.Message, b: wirebond.Message) -> bool:
    return (a.name, a.raw, a.sender) == (b.name, b.raw, b.sender) and abs(a.t - b.t) < 2e-6


def test_a_recording_gives_the_same_messages_as_the_live_link(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    live = []
    with wirebond.open(PROTOCOLS / "diffdrive.yaml", "sim:") as link, link.record(path) as recorder:
        while len(live) < 5:
            link.send("velocity", linear=0.5, angular=0.1)
            live += link.receive(PATIENCE)
        link.note("control", to="anna")
    found = recordings.open(path)
    assert found.is_closed
    assert recorder.bytes == len(found.raw("received")) + len(found.raw("sent"))
    tapped = recorder.started + found.events[0].t  # `port_up`: how the link stood when it was opened
    live = [message for message in live if message.t > tapped]
    again = list(found.messages("mcu"))
    assert len(again) >= len(live)
    assert [m.raw for m in again[: len(live)]] == [m.raw for m in live]
    offset = live[0].t - again[0].t
    assert offset == pytest.approx(recorder.started, abs=1e-5)
    assert all(abs(m.t - offset - a.t) < 1e-5 for m, a in zip(live, again, strict=False))
    sent = [message["linear"] for message in found.messages("host")]
    assert sent
    assert set(sent) == {0.5}
    assert [(e.kind, dict(e.facts)) for e in found.events if e.kind == "control"] == [("control", {"to": "anna"})]
    assert found.codec.hash == link.codec.hash
    assert found.port == "sim:"


def test_a_long_recording_has_each_piece_once_and_in_order(tmp_path: Path, diffdrive: wirebond.Codec) -> None:
    pieces = [Chunk(n * 1e-4, n * 1e-4, "received", n.to_bytes(3, "big")) for n in range(20_000)]
    run = recordings.open(made(tmp_path / "long.mcap", diffdrive, pieces, batch=97))
    assert not run.problems
    assert [chunk.bytes for chunk in run.chunks("received")] == [piece.bytes for piece in pieces]
    assert run.raw("received") == b"".join(piece.bytes for piece in pieces)


@pytest.mark.parametrize("closed", [False, True])
def test_every_piece_keeps_its_time(tmp_path: Path, diffdrive: wirebond.Codec, closed: bool) -> None:
    pieces = list(drive(diffdrive, 2.0))
    path = made(tmp_path / "run.mcap", diffdrive, pieces)
    if closed:
        close_recording(path)
    found = recordings.open(path)
    assert found.is_closed == closed
    assert [(round(c.t, 6), round(c.before, 6), c.direction, c.bytes) for c in found.chunks()] == [
        (round(c.t, 6), round(c.before, 6), c.direction, c.bytes) for c in pieces if isinstance(c, Chunk)
    ]
    assert [(e.kind, dict(e.facts)) for e in found.events] == [("port_up", {}), ("port_down", {"why": "the end"})]
    assert found.started.timestamp() == WALL_NS / 1e9
    assert found.duration == pytest.approx(2.0)
    assert len(list(found)) == len(list(found.messages("mcu"))) + len(list(found.messages("host"))) == 84


@pytest.mark.parametrize("sender", ["mcu", "host"])
def test_columns_and_iterator_agree(tmp_path: Path, diffdrive: wirebond.Codec, sender: str) -> None:
    found = recordings.open(made(tmp_path / "run.mcap", diffdrive, drive(diffdrive, 3.0)))
    columns = found.columns(sender)
    for name, table in columns.items():
        rows = [m for m in found.messages(sender) if m.name == name]
        assert len(table) == len(rows)
        assert table.t is not None
        assert np.allclose(table.t, [m.t for m in rows], atol=1e-9)
        for field in ("linear", "left_ticks", "battery"):
            if field in table:
                assert list(table[field]) == [m[field] for m in rows]
    assert columns.stats.frames == len(list(found.messages(sender)))


def test_a_silence_inside_a_frame_ends_it_in_columns_too(tmp_path: Path, diffdrive: wirebond.Codec) -> None:
    frame = diffdrive.encode("odometry", left_ticks=1, right_ticks=2)
    pieces = [
        Chunk(0.1, 0.1, "received", frame[:5]),
        Chunk(0.9, 0.9, "received", frame[5:] + frame),
        Chunk(1.0, 1.0, "received", frame[:5]),
        LinkEvent(1.001, "port_down", {"why": "pulled"}),
        Chunk(1.002, 1.002, "received", frame[5:] + frame),
    ]
    found = recordings.open(made(tmp_path / "run.mcap", diffdrive, pieces))
    assert [m.t for m in found] == [0.9, 1.002]
    table = found.columns()["odometry"]
    assert table.t is not None
    assert list(table.t) == [0.9, 1.002]
    assert found.stats().discarded_bytes["incomplete"] == 10


def test_a_reply_identified_only_by_its_request_is_known(tmp_path: Path) -> None:
    text = """
wirebond: 1
protocol: asked
frame: [magic: 0xAA 0x55, id: u8, payload: 2, check: crc-16/modbus]
messages:
  ask_a: {id: 1, sender: host, reply: a}
  ask_b: {id: 2, sender: host, reply: b}
  a: {id: 7, sender: mcu, fields: {x: {type: u16}}}
  b: {id: 7, sender: mcu, fields: {y: {type: i16}}}
"""
    asked = wirebond.Codec(loads(text))
    pieces = []
    for number, (question, answer) in enumerate([("ask_a", "a"), ("ask_b", "b"), ("ask_a", "a")]):
        pieces.append(Chunk(number, number, "sent", asked.encode(question)))
        value = {"x": 5} if answer == "a" else {"y": -5}
        pieces.append(Chunk(number + 0.1, number + 0.1, "received", asked.encode(answer, value)))
    found = recordings.open(made(tmp_path / "run.mcap", asked, pieces))
    assert [m.name for m in found.messages("mcu")] == ["a", "b", "a"]
    assert {name: len(table) for name, table in found.columns().items()} == {"a": 2, "b": 1}


@pytest.mark.parametrize("closed", [False, True])
def test_the_public_reader_opens_it(tmp_path: Path, diffdrive: wirebond.Codec, closed: bool) -> None:
    path = made(tmp_path / "run.mcap", diffdrive, drive(diffdrive, 2.0))
    if closed:
        close_recording(path)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        topics = {channel.topic for channel in summary.channels.values()}
        raw = b"".join(m.data for _, _, m in reader.iter_messages(topics=["rx"]))
        assert raw == recordings.open(path).raw("received")
        assert [a.data.decode() for a in reader.iter_attachments()] == [diffdrive.model.text] * (1 + closed)
        if closed:
            assert topics >= {"rx", "tx", "events", "mcu/odometry", "host/velocity"}
            values = [json.loads(m.data) for _, _, m in reader.iter_messages(topics=["mcu/odometry"])]
            assert values[7] == {"left_ticks": 7, "right_ticks": -7}
            schema = next(s for s in summary.schemas.values() if s.name == "mcu/odometry")
            assert json.loads(schema.data)["properties"]["left_ticks"]["type"] == "integer"
            assert summary.statistics.chunk_count > 0


def test_a_corrected_protocol_decodes_it_again(tmp_path: Path, diffdrive: wirebond.Codec) -> None:
    path = made(tmp_path / "run.mcap", diffdrive, drive(diffdrive, 1.0))
    corrected = tmp_path / "corrected.yaml"
    corrected.write_text(
        diffdrive.model.text.replace("left_ticks:  {type: i16, ", "left_ticks: {type: i16, scale: 2, ")
    )
    assert list(recordings.open(path).columns()["odometry"]["left_ticks"])[:3] == [0, 1, 2]
    assert list(recordings.open(path, corrected).columns()["odometry"]["left_ticks"])[:3] == [0.0, 2.0, 4.0]


def test_info_lists_the_content_of_a_recording(
    tmp_path: Path, diffdrive: wirebond.Codec, capsys: pytest.CaptureFixture[str]
) -> None:
    path = made(tmp_path / "run.mcap", diffdrive, [*drive(diffdrive, 2.0), Chunk(2.1, 2.1, "received", b"\x00\x01")])
    assert main(["info", str(path)]) == 0
    text = capsys.readouterr().out
    assert "2.100 s of diffdrive" in text
    assert "odometry: 40, 19.0/s" in text
    assert "2 discarded as no_start" in text
    assert "why=the end" in text
    assert main(["info", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["accounts"]["host"]["messages"] == {"velocity": 40, "status_query": 2}
    assert told["hash"] == f"{diffdrive.hash:016x}"
    assert told["finished"]
    assert not told["problems"]


def test_export_writes_a_file_for_each_message(
    tmp_path: Path, diffdrive: wirebond.Codec, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = made(tmp_path / "run.mcap", diffdrive, drive(diffdrive, 2.0))
    out = tmp_path / "out"
    assert main(["export", str(path), "--to", "csv", "-o", str(out)]) == 0
    assert sorted(p.name for p in out.iterdir()) == ["odometry.csv", "status.csv", "status_query.csv", "velocity.csv"]
    rows = list(csv.DictReader((out / "odometry.csv").open()))
    assert len(rows) == 40
    assert rows[4] == {"t": "0.2204", "left_ticks": "4", "right_ticks": "-4"}
    assert main(["export", str(path), "--to", "mcap", "--message", "odometry", "-o", str(out)]) == 0
    with (out / "run-decoded.mcap").open("rb") as file:
        assert [c.topic for _, c, _ in make_reader(file).iter_messages()] == ["mcu/odometry"] * 40
    capsys.readouterr()
    assert main(["export", str(path), "--to", "csv", "--message", "odo", "-o", str(out)]) == 2
    assert "odometry" in capsys.readouterr().err
    assert main(["export", str(path), "--to", "xls", "-o", str(out)]) == 2
    assert "expected csv, parquet, mcap" in capsys.readouterr().err
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    assert main(["export", str(path), "--to", "parquet", "-o", str(out)]) == 1
    assert "pip install 'pyarrow>=17'" in capsys.readouterr().err


@pytest.mark.parametrize(("to", "name"), [("csv", "velocity.csv"), ("mcap", "run-decoded.mcap")])
def test_export_replaces_files_only_on_request(
    tmp_path: Path, diffdrive: wirebond.Codec, capsys: pytest.CaptureFixture[str], to: str, name: str
) -> None:
    path = made(tmp_path / "run.mcap", diffdrive, drive(diffdrive, 1.0))
    out = tmp_path / "out"
    out.mkdir()
    (out / name).write_text("mine")
    assert main(["export", str(path), "--to", to, "-o", str(out)]) == 2
    assert f"{name} exists already; nothing was written" in " ".join(capsys.readouterr().err.split())
    assert [(p.name, p.read_text()) for p in out.iterdir()] == [(name, "mine")]
    assert main(["export", str(path), "--to", to, "-o", str(out), "--force"]) == 0
    assert (out / name).read_bytes() != b"mine"


def test_a_file_that_appears_while_another_is_written_is_left_as_it_is(
    tmp_path: Path, diffdrive: wirebond.Codec, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = made(tmp_path / "run.mcap", diffdrive, drive(diffdrive, 1.0))
    out = tmp_path / "out"
    write = export_module._write_csv

    def slow(*arguments: Any) -> Any:
        yield from write(*arguments)
        (out / "velocity.csv").write_text("mine")

    monkeypatch.setattr(export_module, "_write_csv", slow)
    assert main(["export", str(path), "--to", "csv", "--message", "velocity", "-o", str(out)]) == 1
    assert "velocity.csv" in capsys.readouterr().err
    assert [(p.name, p.read_text()) for p in out.iterdir()] == [("velocity.csv", "mine")]


def test_parquet_has_the_columns(tmp_path: Path, diffdrive: wirebond.Codec, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wirebond.recording.export._ROWS", 7)
    path = made(tmp_path / "run.mcap", diffdrive, drive(diffdrive, 1.0))
    assert main(["export", str(path), "--to", "parquet", "-o", str(tmp_path)]) == 0
    table = parquet.read_table(tmp_path / "odometry.parquet")
    assert table.column_names == ["t", "left_ticks", "right_ticks"]
    assert table["left_ticks"].to_pylist() == list(range(20))
    assert table["t"].to_pylist() == recordings.open(path).columns()["odometry"].t.tolist()


def test_parquet_has_the_units_and_the_names_of_numbers(tmp_path: Path) -> None:
    file = tmp_path / "kinds.yaml"
    file.write_text(KINDS.replace("axes: {type: i16, ", "axes: {type: i16, unit: m/s, "))
    proto = wirebond.load(file)
    data = proto.encode("all", name="a", data=b"abc", axes=[1, 2], mode="drive", bits=["a"], list=[1])
    path = made(tmp_path / "run.mcap", proto, [Chunk(0.1, 0.1, "received", data)])
    assert main(["export", str(path), "--to", "parquet", "-o", str(tmp_path)]) == 0
    schema = parquet.read_schema(tmp_path / "all.parquet")
    about = {name: schema.field(name).metadata or {} for name in schema.names}
    assert about["t"][b"unit"] == b"s"
    assert about["axes[0]"] == about["axes[1]"] == {**about["axes[0]"], b"unit": b"m/s"}
    assert json.loads(about["mode"][b"enum"]) == {"0": "idle", "1": "drive"}
    assert json.loads(about["bits"][b"flags"]) == {"0": "a", "1": "b"}
    assert b"unit" not in about["name"]


def test_parquet_takes_every_kind_of_column(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Texts, bytes, lists that are empty at first, arrays, enums and flags."""
    monkeypatch.setattr("wirebond.recording.export._ROWS", 2)
    file = tmp_path / "kinds.yaml"
    file.write_text(KINDS)
    proto = wirebond.load(file)
    lists: list[list[int]] = [[], [], [1], [1, 2], []]
    values = [
        {"name": "é" * i, "data": bytes([i, 0, 255]), "axes": [i, 2], "mode": "drive", "bits": ["a"], "list": each}
        for i, each in enumerate(lists)
    ]
    chunks = [Chunk(0.1 * i, 0.1 * i, "received", proto.encode("all", each)) for i, each in enumerate(values)]
    path = made(tmp_path / "run.mcap", proto, chunks)
    for to in ("parquet", "csv"):
        assert main(["export", str(path), "--to", to, "-o", str(tmp_path)]) == 0
    table = parquet.read_table(tmp_path / "all.parquet").to_pydict()
    assert table["name"] == [each["name"] for each in values]
    assert table["data"] == [each["data"] for each in values]
    assert table["axes[0]"] == [0, 1, 2, 3, 4]
    assert table["mode"] == [1] * 5
    assert table["bits"] == [1] * 5
    assert [json.loads(each) for each in table["list"]] == lists
    with (path.parent / "all.csv").open() as file:
        assert [json.loads(row["list"]) for row in csv.DictReader(file)] == lists


def test_a_cancelled_export_leaves_nothing(tmp_path: Path, diffdrive: wirebond.Codec) -> None:
    found = recordings.open(made(tmp_path / "run.mcap", diffdrive, drive(diffdrive, 1.0)))

    def cancel(_done: int, _size: int) -> None:
        raise KeyboardInterrupt

    for to in ("csv", "mcap"):
        with pytest.raises(KeyboardInterrupt):
            export(found, to, tmp_path / to, progress=cancel)
        assert list((tmp_path / to).iterdir()) == []


def test_a_cancelled_closing_leaves_the_file_as_it_was(tmp_path: Path, diffdrive: wirebond.Codec) -> None:
    path = made(tmp_path / "run.mcap", diffdrive, drive(diffdrive, 1.0))
    before = path.read_bytes()

    def cancel(_done: int, _size: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        close_recording(path, progress=cancel)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_no_existing_file_is_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_text("precious")
    with wirebond.open(PROTOCOLS / "diffdrive.yaml", "sim:") as link:
        with pytest.raises(UsageError, match="exists already"):
            link.record(path)
        with pytest.raises(FileNotFoundError):
            link.record(tmp_path / "no" / "run.mcap")
    assert path.read_text() == "precious"


def test_a_recorder_that_comes_too_late_says_what_it_lost(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with wirebond.open(PROTOCOLS / "diffdrive.yaml", "sim:") as link:
        small = type("Source", (), {"codec": link.codec, "role": "host", "tap": lambda _self: link.tap(1024)})()
        recorder = recordings.Recorder(small, path)
        for _ in range(200):
            link.note("big", text="x" * 500)
        recorder.close()
    found = recordings.open(path)
    lost = [e.facts["pieces"] for e in found.events if e.kind == "lost"]
    assert sum(lost) + sum(e.kind == "big" for e in found.events) == 200
    assert sum(lost) > 0


def test_the_command_records_until_its_time_is_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    taken = Stopwatch()
    assert main(["record", str(PROTOCOLS / "diffdrive.yaml"), "sim:", "--seconds", "0.3"]) == 0
    assert taken.seconds >= 0.3
    told = capsys.readouterr()
    path = Path(told.out.strip())
    assert path.name.startswith("diffdrive-20")
    assert "messages, 0 bytes lost" in told.err
    found = recordings.open(path)
    assert found.is_closed
    assert 0 < found.duration < taken.seconds
    assert found.columns()["odometry"]
    for options, code in ((["--seconds", "0"], 2), (["-o", "no/run.mcap"], 1), (["--role", "both"], 2)):
        assert main(["record", str(PROTOCOLS / "diffdrive.yaml"), "sim:", *options]) == code
    assert main(["record", str(PROTOCOLS / "diffdrive.yaml"), "/dev/none"]) == 3


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_finishes_the_file(tmp_path: Path, number: int) -> None:
    path = tmp_path / "run.mcap"
    command = [sys.executable, "-m", "wirebond.cli.main", "record", str(PROTOCOLS / "diffdrive.yaml"), "sim:"]
    with subprocess.Popen([*command, "-o", str(path)], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as record:
        assert record.stdout is not None
        assert record.stdout.readline().decode().strip() == str(path)
        record.send_signal(number)
        assert record.wait(PATIENCE) == 0
    assert recordings.open(path).is_closed
