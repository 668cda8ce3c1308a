"""A client of a server records as the owner of the link does; and its file is whole when the server goes away."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import wirebond
from tests.patient_servers import ages, real_ages  # noqa: F401 - fixtures of this module
from tests.shared import PROTOCOLS
from tests.waiting import wait_until
from wirebond import recording as recordings
from wirebond.server import Server

pytestmark = pytest.mark.live

DIFFDRIVE = PROTOCOLS / "diffdrive.yaml"


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    with wirebond.open(DIFFDRIVE, "sim:") as link, Server(link, tmp_path / "socket") as server:
        yield server


def test_a_client_records_what_the_owner_does(server: Server, tmp_path: Path) -> None:
    with (
        wirebond.open(DIFFDRIVE, f"wirebond://{server.path}") as attached,
        attached.record(tmp_path / "attached.mcap"),
        server.link.record(tmp_path / "owned.mcap"),
    ):
        for step in range(5):
            server.link.send("velocity", linear=0.1 * step)
            assert attached.request("status_query")
        attached.note("lap", number=3)
    attached_chunks, owned_chunks = (
        [(c.direction, c.bytes) for c in recordings.open(tmp_path / name).chunks()]
        for name in ("attached.mcap", "owned.mcap")
    )
    sent = [data for direction, data in owned_chunks if direction == "sent"]
    assert [data for direction, data in attached_chunks if direction == "sent"] == sent
    host = server.link.codec.decoder("host")
    assert [message.name for message in host.feed(b"".join(sent))] == ["velocity", "status_query"] * 5
    for name in ("attached.mcap", "owned.mcap"):
        assert [dict(e.facts) for e in recordings.open(tmp_path / name).events if e.kind == "lap"] == [{"number": 3}]


def test_a_recording_goes_on_when_the_server_is_back(server: Server, tmp_path: Path) -> None:
    with wirebond.open(DIFFDRIVE, f"wirebond://{server.path}") as attached:
        recorder = attached.record(tmp_path / "run.mcap")
        wait_until(lambda: recorder.bytes >= 22, "two messages")
        server.close()
        wait_until(lambda: recorder._is_gone, "the end of the server")
        before = recorder.bytes
        with Server(server.link, server.path):
            wait_until(lambda: recorder.bytes >= before + 22, "two messages more")
            recorder.close()
    found = recordings.open(tmp_path / "run.mcap")
    assert found.is_closed
    assert not found.problems
    events = [event.kind for event in found.events]
    assert events.index("source_gone") < events.index("source_back")
    assert len(found.raw("received")) == recorder.bytes


def test_a_recording_whose_server_stays_away_is_whole(server: Server, tmp_path: Path) -> None:
    with wirebond.open(DIFFDRIVE, f"wirebond://{server.path}") as attached:
        recorder = attached.record(tmp_path / "run.mcap")
        wait_until(lambda: recorder.bytes >= 22, "two messages")
        server.close()
        recorder.close()
    found = recordings.open(tmp_path / "run.mcap")
    assert found.is_closed
    assert found.stats().messages["odometry"] >= 2
