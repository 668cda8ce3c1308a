"""A line that echoes: own bytes are dropped and counted, others are kept, what comes back otherwise is a collision."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import wirebond
from tests.link.protocol import TEXT, manipulator
from tests.waiting import PATIENCE, wait_until
from wirebond import _engine
from wirebond.analysis.diagnosis import Kind, diagnose, diagnose_dump
from wirebond.cli.commands.dump import dump_text
from wirebond.cli.main import main
from wirebond.link import Dump
from wirebond.link.dump import Piece
from wirebond.link.settings import engine_settings
from wirebond.protocol.model import End

pytestmark = pytest.mark.live

CODEC = manipulator(", echo: true")
ADAPTER = 0.016  # seconds


class Core:
    """The link below all ports, with every byte and time by hand."""

    def __init__(self) -> None:
        settings = engine_settings(CODEC, 115200, adapter_latency=ADAPTER)
        self.core = _engine.LinkCore(CODEC.tables.protocol, CODEC.tables.format_for(End.MCU), settings, 0)
        self.now = 1000
        self.core.port_up(self.now)

    def send(self, number: int) -> bytes:
        """A frame leaves; its bytes."""
        frame = CODEC.encode("note", {"number": number})
        self.core.send(CODEC.tables.indices["note"], frame, -1, self.now)
        self.now += 10_000
        assert self.core.to_write(self.now) == frame
        self.core.written(len(frame), self.now)
        return frame

    def hear(self, data: bytes) -> list[str]:
        self.now += 1000
        self.core.received(data, self.now - 100, self.now)
        return [message.name for message in self.core.receive()]

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.001)):
            self.now += 1000
            self.core.idle(self.now)
            self.core.poll(self.now)

    @property
    def stats(self) -> dict[str, Any]:
        return self.core.stats()

    @property
    def dump(self) -> Dump:
        pieces, _ = self.core.recent()
        return Dump(CODEC, self.now / 1e6, [Piece(t / 1e6, kind, data) for kind, t, data in pieces], 0)


POSE = CODEC.encode("pose", {"x": 1}, sender="mcu")


def test_own_bytes_are_dropped_whatever_the_reads_and_a_late_reply_before_them_is_kept() -> None:
    core = Core()
    frame = core.send(7)
    stream = POSE + frame + POSE  # the first one lay in the adapter when the frame left
    found = [name for at in range(0, len(stream), 5) for name in core.hear(stream[at : at + 5])]
    assert found == ["pose", "pose"]
    stats = core.stats
    assert (stats["echoed_bytes"], stats["collisions"]) == (len(frame), 0)
    assert stats["bytes"] == stats["frame_bytes"] == 2 * len(POSE)
    core.wait(0.2)
    assert core.stats["collisions"] == 0
    assert core.dump.received == POSE + POSE  # what others sent


def test_a_frame_is_expected_before_its_last_byte_counts_as_written() -> None:
    """Threads in Python read while they write."""
    core = Core()
    core.core.send(CODEC.tables.indices["arm"], CODEC.encode("arm", {"torque": 3}), -1, core.now)
    frame = core.core.hand_over(core.now)
    assert core.hear(frame) == []
    core.core.written(1, core.now)
    core.wait(0.2)
    stats = core.stats
    assert (stats["echoed_bytes"], stats["collisions"], stats["bytes"]) == (len(frame), 0, 0)


def test_a_frame_that_comes_back_changed_is_reported_as_a_collision() -> None:
    core = Core()
    for number in range(10):
        assert core.hear(core.send(number)) == []
    for number in range(3):
        frame = bytearray(core.send(100 + number))
        frame[9] ^= 0x40
        core.hear(bytes(frame))
    assert core.core.next_due(core.now) < core.now + 200_000
    core.wait(0.2)
    stats = core.stats
    assert stats["collisions"] == 3
    assert stats["bytes"] == 3 * len(frame)
    assert stats["bytes"] == stats["pending_bytes"] + sum(stats["discarded_bytes"].values())
    assert core.hear(POSE) == ["pose"]
    assert dump_text(core.dump).count("- collision") == 3
    (told,) = [one for one in diagnose_dump(core.dump, 115200) if one.kind in (Kind.COLLISIONS, Kind.NO_ECHO)]
    assert told.kind == Kind.COLLISIONS
    assert told.evidence == "3 of 13 sent frames did not come back as they were sent"


def test_a_line_that_does_not_echo_loses_no_frame_and_is_reported() -> None:
    core = Core()
    for number in range(20):
        core.send(number)
        assert core.hear(POSE) == ["pose"]
        core.wait(0.2)
    stats = core.stats
    assert (stats["echoed_bytes"], stats["collisions"], stats["frames"]) == (0, 20, 20)
    assert Kind.NO_ECHO in [one.kind for one in diagnose_dump(core.dump, 115200)]


def test_the_end_of_a_frame_that_looks_like_the_beginning_of_an_own_one_is_not_lost() -> None:
    core = Core()
    core.send(7)
    pose = next(f for x in range(40_000) if (f := CODEC.encode("pose", {"x": x - 20_000}, sender="mcu"))[-1] == 0xAA)
    assert core.hear(pose) == []  # its last byte may be an own one
    core.wait(0.2)
    assert [message.name for message in core.core.receive()] == ["pose"]


def test_expected_bytes_are_forgotten_when_the_port_goes() -> None:
    core = Core()
    frame = core.send(7)
    core.hear(frame[:4])
    core.core.port_down(core.now)
    core.core.port_up(core.now)
    core.wait(0.2)
    assert core.stats["collisions"] == 0
    assert core.hear(POSE) == ["pose"]


def test_monitor_counts_own_bytes_and_collisions(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "manipulator.yaml"
    path.write_text(TEXT.format(link=", echo: true"), encoding="utf-8")
    assert main(["monitor", str(path), "sim:", "--seconds", "0.1"]) == 0
    assert "0 own bytes came back, 0 collisions" in capsys.readouterr().err


@pytest.mark.usefixtures("ports")
def test_the_simulated_mcu_is_on_a_line_that_echoes_where_the_file_says_so() -> None:
    with wirebond.open(manipulator(", echo: true, adapter_latency: 1 s"), "sim:") as link:
        for _ in range(20):
            assert link.request("query", timeout=PATIENCE).name == "pose"
        wait_until(lambda: link.stats.echoed_bytes == link.stats.send.sent_bytes, "own bytes come back")
        stats = link.stats
        assert stats.collisions == 0
        assert sum(stats.receive.discarded_bytes.values()) == 0
        assert diagnose(link) == []
