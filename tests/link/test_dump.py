"""The last bytes of a link: bounded, complete, and read as the link read them."""

from __future__ import annotations

import json
import random
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import wirebond
from tests.shared import PROTOCOLS, ROOT, codec
from tests.streams import chunks, hard_stream
from tests.waiting import PATIENCE, wait_until
from wirebond import Codec, Dump, _engine
from wirebond.cli.main import main
from wirebond.link.dump import Piece
from wirebond.link.settings import engine_settings
from wirebond.protocol.model import End
from wirebond.sim.pty_port import PtyPort

NAMES = ("diffdrive", "enterprize", "native", "servo_bus")


def core_of(described: Codec, **settings: Any) -> _engine.LinkCore:
    found = replace(engine_settings(described, 115200), **settings)
    core = _engine.LinkCore(described.tables.protocol, described.tables.format_for(End.MCU), found, 0)
    core.port_up(0)
    return core


def dump_of(core: _engine.LinkCore, described: Codec) -> Dump:
    pieces, dropped = core.recent()
    return Dump(described, 0.0, [Piece(t / 1e6, kind, data) for kind, t, data in pieces], dropped)


@pytest.mark.parametrize("name", NAMES)
def test_a_dump_says_what_the_account_says(name: str) -> None:
    described = codec(name)
    source = random.Random(f"dump {name}")
    core = core_of(described)
    now = 0
    stream = hard_stream(Codec(described.model), source, 150)
    for chunk in chunks(stream, source):
        now += source.randrange(10, 500)  # less than `idle`
        core.received(chunk, now, now + 5)
    stats = core.stats()
    dump = dump_of(core, described)
    received = [entry for entry in dump.entries if entry.direction == "received"]
    assert b"".join(entry.bytes for entry in received) == dump.received == stream
    assert [e.message.raw for e in received if e.message is not None] == [m.raw for m in core.receive()]
    causes: Counter[str] = Counter()
    for entry in received:
        causes.update(entry.causes)
    assert causes == Counter({cause: count for cause, count in stats["discarded_bytes"].items() if count})
    assert sum(len(e.bytes) for e in received if e.kind == "pending") == stats["pending_bytes"]


@pytest.mark.parametrize("capacity", [1, 7, 300])
def test_memory_is_bounded_and_the_newest_bytes_are_kept(capacity: int) -> None:
    described = codec("diffdrive")
    core = core_of(described, recent_bytes=capacity)
    source = random.Random(f"bound {capacity}")
    all_bytes = b""
    for now in range(1, 400):
        piece = source.randbytes(source.choice([1, 2, 11, 40, 301]))
        core.received(piece, now, now)
        all_bytes += piece
        dump = dump_of(core, described)
        assert len(dump.received) <= capacity
        assert all_bytes.endswith(dump.received)
        assert dump.dropped_bytes + len(dump.received) == len(all_bytes)
        assert dump.pieces[-1].bytes == piece[-capacity:]


def test_many_small_pieces_are_bounded_too() -> None:
    described = codec("diffdrive")
    core = core_of(described, recent_bytes=1 << 20)
    for now in range(1, 70_000):
        core.received(b"\xaa", now, now)
    assert len(dump_of(core, described).pieces) == 65536


def test_sent_frames_are_between_received_ones() -> None:
    described = codec("diffdrive")
    core = core_of(described)
    status = described.encode("status", {"battery": 12.0, "errors": [], "state": []})
    query = described.encode("status_query")
    core.received(status, 1000, 1000)
    assert core.send(described.tables.indices["status_query"], query, -1, 2000) == 0
    assert core.to_write(2000) == query
    core.written(5, 2000)
    core.written(len(core.to_write(2500)), 2500)
    core.received(status, 3000, 3000)
    core.port_down(4000)
    told = [(round(e.t * 1000), e.direction, e.kind, e.bytes) for e in dump_of(core, described).entries]
    assert told == [
        (0, "port", "up", b""),
        (1, "received", "frame", status),
        (2, "sent", "frame", query) if told[2][0] == 2 else (3, "sent", "frame", query),
        (3, "received", "frame", status),
        (4, "port", "down", b""),
    ]


def test_a_frame_that_never_ended_is_incomplete() -> None:
    described = codec("diffdrive")
    core = core_of(described)
    status = described.encode("status", {"battery": 12.0, "errors": [], "state": []})
    core.received(status[:6], 1000, 1000)
    core.idle(900_000)
    core.received(status, 1_000_000, 1_000_000)
    entries = [(e.kind, e.causes) for e in dump_of(core, described).entries if e.direction == "received"]
    assert entries == [("discarded", {"incomplete": 6}), ("frame", {})]
    assert core.stats()["discarded_bytes"]["incomplete"] == 6


def test_no_frame_continues_after_a_loss_of_the_port() -> None:
    described = codec("diffdrive")
    core = core_of(described)
    status = described.encode("status", {"battery": 12.0, "errors": [], "state": []})
    core.received(status[:6], 1000, 1000)
    core.port_down(2000)
    core.port_up(3000)
    core.received(status[6:], 4000, 4000)
    assert not [e for e in dump_of(core, described).entries if e.kind == "frame"]


def test_the_last_request_identifies_a_reply() -> None:
    described = wirebond.load(ROOT / "tests" / "formats" / "by_request.yaml")
    for request, reply, values in (
        ("read_speed", "speed", {"speed": 0.25}),
        ("read_state", "state", {"battery": 11.5, "faults": 1, "uptime": 7}),
    ):
        pieces = [
            Piece(1.0, "sent", described.encode("read_speed")),
            Piece(1.2, "sent", described.encode(request)),
            Piece(1.5, "received", described.encode(reply, values)),
        ]
        entry = Dump(described, 2.0, pieces, 0).entries[-1]
        assert (entry.direction, entry.kind) == ("received", "frame")
        assert entry.message is not None
        assert entry.message.name == reply


# ---- over a pty


@pytest.fixture
def pty() -> Any:
    port = PtyPort()
    yield port
    port.close()


@pytest.mark.live
def test_a_link_gives_its_last_bytes(pty: PtyPort) -> None:
    described = codec("diffdrive")
    status = described.encode("status", {"battery": 12.0, "errors": [], "state": []})
    with wirebond.open(described, pty.path) as link:
        link.send("status_query")
        asked = b""
        while len(asked) < len(described.encode("status_query")):  # its frame leaves before the answer comes
            asked += pty.read(10.0)
        pty.write(b"\x01\x02" + status)
        (message,) = link.receive(PATIENCE)
        dump = link.dump()
    frames = {e.direction: e for e in dump.entries if e.kind == "frame"}
    assert frames["received"].message is not None
    assert frames["received"].message.fields == message.fields
    assert frames["sent"].bytes == described.encode("status_query")
    assert abs(frames["received"].t - message.t) < 0.1
    assert dump.t >= frames["received"].t
    assert {e.kind for e in dump.entries if e.direction == "port"} == {"up"}


@pytest.mark.live
def test_the_command_and_monitor_write_it(
    pty: PtyPort, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    described = codec("diffdrive")
    status = described.encode("status", {"battery": 12.0, "errors": [], "state": []})
    opened = wirebond.link.open_link

    def open_and_hear(*arguments: Any, **options: Any) -> wirebond.Link:
        link = opened(*arguments, **options)
        pty.write(b"\x01\x02" + status)
        wait_until(lambda: link.stats.receive.bytes == 2 + len(status), "all bytes")
        return link

    monkeypatch.setattr("wirebond.cli.commands.dump.open_link", open_and_hear)
    monkeypatch.setattr("wirebond.cli.commands.live.open_link", open_and_hear)
    file = str(PROTOCOLS / "diffdrive.yaml")
    assert main(["dump", file, pty.path, "--seconds", "0.3"]) == 0
    shown = capsys.readouterr().out
    assert "< discarded 01 02  2 no_start" in shown
    assert "< frame     AA 55 82" in shown
    assert "status  battery 12" in shown
    for name in ("dump.txt", "dump.jsonl"):
        assert main(["monitor", file, pty.path, "--seconds", "0.3", "--dump-on-exit", str(tmp_path / name)]) == 0
    assert "< frame     AA 55 82" in (tmp_path / "dump.txt").read_text()
    rows = [json.loads(line) for line in (tmp_path / "dump.jsonl").read_text().splitlines()]
    assert [(row["kind"], row.get("causes"), row.get("message")) for row in rows] == [
        ("up", None, None),
        ("discarded", {"no_start": 2}, None),
        ("frame", None, "status"),
    ]
    assert main(["dump", file, "/dev/no_such_port", "--seconds", "0.1"]) == 3
