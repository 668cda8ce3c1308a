"""A server records on its own disk: any client starts, stops, marks, lists and annotates."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import mcap.reader
import pytest

import wirebond
from tests.shared import PROTOCOLS
from tests.waiting import PATIENCE, wait_until
from wirebond import recording as recordings
from wirebond.link.attached import words
from wirebond.server import Server

pytestmark = pytest.mark.live

DIFFDRIVE = PROTOCOLS / "diffdrive.yaml"


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    with (
        wirebond.open(DIFFDRIVE, "sim:") as link,
        Server(link, tmp_path / "socket", recordings=tmp_path / "kept") as server,
    ):
        yield server


class Watcher:
    """A client by its bare socket."""

    def __init__(self, server: Server) -> None:
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.settimeout(PATIENCE)
        self._socket.connect(str(server.path))
        self._splitter = words.Splitter(words.MOST_TO_CLIENT)
        self.said: list[dict] = []
        self.ask(do="attach", id=1, messages="none", name="watcher")

    def ask(self, **request: object) -> None:
        self._socket.sendall(words.framed(words.JSON, json.dumps(request).encode()))

    def until(self, **facts: object) -> dict:
        while True:
            for at, one in enumerate(self.said):
                if facts.items() <= one.items():
                    return self.said.pop(at)
            self.said += [json.loads(body) for _, body in self._splitter.feed(self._socket.recv(1 << 16))]

    def states(self, count: int) -> list[str]:
        return [self.until(event="recording")["recording"]["state"] for _ in range(count)]

    def close(self) -> None:
        self._socket.close()


def test_any_client_starts_stops_marks_lists_and_annotates(server: Server) -> None:
    watcher = Watcher(server)
    with wirebond.open(f"wirebond://{server.path}") as link, wirebond.open(f"wirebond://{server.path}") as other:
        began = link.recordings.start()
        assert (began.state, began.protocol, Path(began.path).parent) == (
            "recording",
            "diffdrive",
            server.recordings.folder,
        )
        link.take_control()
        link.recordings.mark("it swerves here")
        assert link.request("status_query")
        current = other.recordings.current
        assert current is not None
        assert current.name == began.name
        ended = other.recordings.stop()
        assert ended.state == "closing"
        assert link.recordings.current is None
        assert watcher.states(3) == ["recording", "closing", "closed"]
        noted = other.recordings.annotate(began.name, "left wheel was loose")
        assert watcher.until(event="recording")["recording"]["notes"][0]["text"] == "left wheel was loose"
        other.recordings.annotate(began.name, "and the Akku war leer ☹")
        (listed,) = link.recordings.list()
        assert listed == server.recordings.list()[0]
        assert listed.state == "closed"
        assert (listed.started, listed.hash, listed.notes[0]) == (began.started, began.hash, noted.notes[0])
        assert listed.size == server.recordings.path(began.name).stat().st_size
    watcher.close()
    found = recordings.open(began.path)
    assert not found.problems
    assert listed.seconds == pytest.approx(found.duration, abs=1e-3)
    marks = [dict(event.facts) for event in found.events if event.kind == "mark"]
    assert [(mark["text"], "by" in mark) for mark in marks] == [("it swerves here", True)]
    assert [e.facts["why"] for e in found.events if e.kind == "control"] == ["taken"]
    assert [note.text for note in found.notes] == ["left wheel was loose", "and the Akku war leer ☹"]
    assert found.stats().messages["status"] == 1


def test_notes_stay_in_the_file_and_public_tools_read_them(server: Server, tmp_path: Path) -> None:
    began = server.recordings.start()
    wait_until(lambda: (server.recordings.current or began).messages > 2)
    server.close()  # which ends the recording in order
    server.recordings.wait()
    (listed,) = server.recordings.list()
    assert listed.state == "closed"
    assert [path.name for path in (tmp_path / "kept").iterdir()] == [began.name]
    assert recordings.open(began.path).stats().messages["odometry"] > 2
    for number in range(3):
        server.recordings.annotate(began.name, f"note {number}")
    path = server.recordings.path(began.name)
    with path.open("rb") as file:
        reader = mcap.reader.make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.metadata_count == len(summary.metadata_indexes) == 5
        found = [m.metadata.get("text") for m in reader.iter_metadata()]
        assert found == [None, None, "note 0", "note 1", "note 2"]  # the facts and the file are stored twice
        assert len(list(reader.iter_attachments())) == 2
        count = summary.statistics.message_count
    assert count == sum(1 for _ in mcap.reader.make_reader(path.open("rb")).iter_messages())
    before = path.read_bytes()
    recordings.closing.close_recording(path)
    assert path.read_bytes() != before
    assert [note.text for note in recordings.open(path).notes] == ["note 0", "note 1", "note 2"]


def test_refusals_have_their_sentences(server: Server, tmp_path: Path) -> None:
    with wirebond.open(f"wirebond://{server.path}") as link:
        with pytest.raises(wirebond.UsageError, match="nothing is being recorded"):
            link.recordings.stop()
        began = link.recordings.start()
        with pytest.raises(wirebond.UsageError, match=f"{began.name} is being recorded already"):
            link.recordings.start()
        with pytest.raises(wirebond.UsageError, match="is being recorded or closed; wait until"):
            link.recordings.annotate(began.name, "too early")
        for name in ("no.mcap", "../socket", f"../kept/{began.name}", "a\0.mcap", ""):
            with pytest.raises(wirebond.UsageError, match="there is no recording"):
                link.recordings.annotate(name, "x")
        for text in ("", "  ", "x" * 5000):
            with pytest.raises(wirebond.UsageError, match="characters; expected 1 to"):
                link.recordings.mark(text)
            with pytest.raises(wirebond.UsageError, match="characters; expected 1 to"):
                link.recordings.annotate(began.name, text)
        folder = server.recordings.folder
        assert folder is not None
        (folder / "other.mcap").write_bytes(b"no recording")
        (folder / "cut.mcap").write_bytes(Path(began.path).read_bytes())
        states = {one.name: (one.state, one.error) for one in link.recordings.list()}
        assert states["other.mcap"][0] == "unreadable"
        assert "is not an MCAP file" in states["other.mcap"][1]
        assert states["cut.mcap"] == ("unclosed", "")
        with pytest.raises(wirebond.UsageError, match="is not closed; `wirebond info"):
            link.recordings.annotate("cut.mcap", "x")
        with pytest.raises(wirebond.UsageError, match="this link has a port of its own"):
            _ = server.link.recordings


def test_a_server_without_a_folder_says_how_to_get_one(tmp_path: Path) -> None:
    with (
        wirebond.open(DIFFDRIVE, "sim:") as own,
        Server(own, tmp_path / "socket"),
        wirebond.open(f"wirebond://{tmp_path / 'socket'}") as link,
    ):
        with pytest.raises(wirebond.UsageError, match=r"no folder for recordings; start it with `wirebond serve --rec"):
            link.recordings.start()
        link.recordings.mark("goes into recordings of clients")
        with pytest.raises(wirebond.UsageError, match=r"cannot make the folder .* for recordings: Not a directory"):
            Server(own, tmp_path / "second", recordings=DIFFDRIVE / "folder")


def test_requests_that_wait_for_the_disk_are_bounded(server: Server) -> None:
    watcher = Watcher(server)
    goes_on = threading.Event()
    server._owner.disk.submit(goes_on.wait)  # the disk is slow
    try:
        for number in range(2, 502):
            watcher.ask(do="recordings", id=number)
        assert {watcher.until(re=number)["error"] for number in range(18, 502)} == {"full"}
    finally:
        goes_on.set()
    assert all("ok" in watcher.until(re=number) for number in range(2, 18))
    watcher.close()
