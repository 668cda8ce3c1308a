"""Many frames in one call: through a link of one's own, one in Python, and one that a server owns."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

import wirebond
from tests.shared import PROTOCOLS, codec
from tests.waiting import wait_until
from wirebond.link import settings
from wirebond.server import Server
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live

ROVER = codec("diffdrive")
SPEED = ROVER.tables.indices["velocity"]


@pytest.fixture(params=["engine", "python", "attached"])
def link(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[wirebond.Link]:
    if request.param == "python":
        monkeypatch.setattr(settings, "HAS_ENGINE_PORTS", False)
    with ExitStack() as stack:
        port = PtyPort()
        stack.callback(port.close)
        found = stack.enter_context(wirebond.open(ROVER, port.path, paced=False))
        if request.param == "attached":
            path = tmp_path / "rover.sock"
            stack.enter_context(Server(found, path))
            found = stack.enter_context(wirebond.open(f"wirebond://{path}"))
        found.test_port = port  # type: ignore[attr-defined]
        yield found


def frames(count: int) -> list[tuple[int, bytes]]:
    return [(SPEED, ROVER.encode("velocity", linear=n / 1000, angular=0)) for n in range(count)]


def test_frames_leave_in_their_order(link: wirebond.Link) -> None:
    port: PtyPort = link.test_port  # type: ignore[attr-defined]
    assert link.internals.sender.send_all(frames(100)) == [None] * 100
    heard: list[wirebond.Message] = []
    decoder = ROVER.decoder("host")
    wait_until(lambda: heard.extend(decoder.feed(port.read(0.05))) or len(heard) >= 100, "all frames")
    assert [round(message["linear"] * 1000) for message in heard] == list(range(100))
    assert link.stats.send.offered == link.stats.send.accepted == 100


def test_each_refused_frame_has_its_error(link: wirebond.Link) -> None:
    link.emergency_stop()
    query = (ROVER.tables.indices["status_query"], ROVER.encode("status_query"))
    answers = link.internals.sender.send_all([*frames(2), query])
    assert [type(answer) for answer in answers] == [wirebond.StoppedError, wirebond.StoppedError, type(None)]
    link.close()
    (answer,) = link.internals.sender.send_all([query])
    assert isinstance(answer, wirebond.LinkDownError)
    assert link.internals.sender.send_all([]) == []


def test_messages_that_need_more_than_their_frame_are_reported() -> None:
    servo = wirebond.load(PROTOCOLS / "servo_bus.yaml")
    for each, name, plain in ((ROVER, "velocity", True), (ROVER, "status_query", False)):
        with wirebond.open(each, "sim:") as link:
            assert link.internals.sender.sends_plain(name) is plain
    with wirebond.open(servo, "sim:") as link:
        assert not any(link.internals.sender.sends_plain(m.name) for m in servo.model.messages if m.sent_by("host"))
