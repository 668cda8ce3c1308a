"""The tap: all that a link reads, writes and does, for who records it; bounded, and never in the link's way."""

from __future__ import annotations

import os

import pytest

import wirebond
from tests.link.protocol import manipulator, without_deadlines
from tests.waiting import PATIENCE, wait_until
from wirebond import _engine
from wirebond.errors import UsageError
from wirebond.link.settings import engine_settings
from wirebond.link.tap import Chunk, LinkEvent, Tap
from wirebond.protocol.model import End
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live


def core_of(codec: wirebond.Codec) -> _engine.LinkCore:
    return _engine.LinkCore(codec.tables.protocol, codec.tables.format_for(End.MCU), engine_settings(codec, 115200), 0)


def test_each_read_and_each_write_keeps_its_own_time() -> None:
    codec = manipulator()
    core = core_of(codec)
    core.port_up(0)
    tap = core.open_tap(4096, 5)
    pose = codec.encode("pose", x=1)
    core.received(pose[:3], 1000, 1010)
    core.received(pose[3:], 2000, 2020)
    query = codec.encode("query")
    core.send(codec.tables.indices["query"], query, -1, 3000)
    assert core.to_write(3000) == query
    core.written(2, 3000)
    core.written(len(core.to_write(3500)), 3500)
    pieces, *lost = core.take_tap(tap)
    assert pieces == [
        ("port_up", 5, 5, b""),
        ("received", 1000, 1010, pose[:3]),
        ("received", 2000, 2020, pose[3:]),
        ("sent", 3000, 3000, query[:2]),
        ("sent", 3500, 3500, query[2:]),
    ]
    assert lost == [0, 0, 0]
    assert core.take_tap(tap) == ([], 0, 0, 0)


def test_lines_that_do_not_fit_are_counted_and_the_link_goes_on() -> None:
    codec = manipulator()
    core = core_of(codec)
    core.port_up(0)
    tap, other = core.open_tap(1024, 0), core.open_tap(4096, 0)
    for now in range(1, 21):
        core.received(bytes([now]) * 100, now, now)
    pieces, *lost = core.take_tap(tap)
    assert [p[3][0] for p in pieces if p[3]] == list(range(1, 11))  # the oldest ones, whole
    assert lost == [10, 1000, 0]
    assert len(core.take_tap(other)[0]) == 21
    core.received(b"\x01", 30, 30)
    assert core.take_tap(tap) == ([("received", 30, 30, b"\x01")], 0, 0, 0)
    core.close_tap(tap)
    core.received(b"\x02", 31, 31)
    assert core.take_tap(tap) == ([], 0, 0, 0)
    assert core.stats()["bytes"] == 2002


def test_times_of_a_tap_never_fall() -> None:
    """A thread that found nothing may have waited for the lock since, and tells a deadline by when it looked."""
    core = core_of(manipulator())
    core.port_up(0)
    tap = core.open_tap(4096, 0)
    core.note("{}", 900_000)
    core.idle(800_000)
    core.poll(800_000)
    kinds, times = zip(*[(kind, t) for kind, _, t, _ in core.take_tap(tap)[0]], strict=True)
    assert "deadline_struck" in kinds[kinds.index("noted") :]
    assert sorted(times) == list(times)


def test_many_small_reads_are_bounded_too() -> None:
    core = core_of(manipulator())
    tap = core.open_tap(1 << 20, 0)
    for now in range(70_000):
        core.received(b"\xaa", now, now)
    pieces, *lost = core.take_tap(tap)
    assert len(pieces) == 65536
    assert lost == [70_000 - 65536, 70_000 - 65536, 0]


def test_a_link_reports_its_events() -> None:
    codec = manipulator()
    core = core_of(codec)
    core.port_up(0)
    drive = codec.tables.indices["drive"]
    frame = codec.encode("drive", speed=1, turn=0)
    tap = core.open_tap(4096, 0)
    core.repeat(drive, frame, 0.1, -1, 1_000)
    core.received(codec.encode("pose", x=1), 2_000, 2_000)
    core.poll(90_000)
    core.poll(102_000)  # the lease is over
    core.poll(302_000)  # no pose for 300 ms
    core.repeat(drive, frame, 0.1, -1, 303_000)
    core.stop(304_000)
    core.idle(309_000)
    core.received(codec.encode("pose", x=2), 310_000, 310_000)
    core.note('{"kind": "control", "to": "anna"}', 311_000)
    core.release_stop()
    core.poll(312_000)
    core.port_down(313_000, "somebody pulled the cable")
    told = [(kind, t, data) for kind, _, t, data in core.take_tap(tap)[0] if kind not in ("received", "sent")]
    assert told == [
        ("port_up", 0, b""),
        ("lease_begun", 1_000, b"0 0"),
        ("lease_ended", 102_000, b"0 0 expired"),
        ("deadline_struck", 302_000, b"\x00"),
        ("lease_begun", 303_000, b"0 0"),
        ("stopped", 304_000, b""),
        ("lease_ended", 304_000, b"0 0 stopped"),
        ("deadline_ended", 310_000, b"\x00"),
        ("noted", 311_000, b'{"kind": "control", "to": "anna"}'),
        ("released", 312_000, b""),
        ("port_down", 313_000, b"somebody pulled the cable"),
    ]


def test_a_tap_that_is_opened_late_learns_the_state_of_the_link() -> None:
    codec = manipulator()
    core = core_of(codec)
    core.port_up(0)
    early = core.open_tap(4096, 0)
    core.stop(10)
    core.poll(2_000_000)
    late = core.open_tap(4096, 2_000_001)
    assert [(kind, data) for kind, _, _, data in core.take_tap(late)[0]] == [
        ("port_up", b""),
        ("stopped", b""),
        ("deadline_struck", b"\x00"),
        ("deadline_struck", b"\x01"),
    ]
    assert [kind for kind, *_ in core.take_tap(early)[0]] == [
        "port_up",
        "stopped",
        "deadline_struck",
        "deadline_struck",
    ]


@pytest.mark.usefixtures("ports")
def test_a_link_is_tapped_while_it_runs() -> None:
    codec = without_deadlines()
    far = PtyPort()
    with wirebond.open(codec, far.path) as link:
        tap = link.tap()
        found: list[Chunk | LinkEvent] = []

        def take() -> bool:
            found.extend(tap.take().pieces)
            # Both: an emergency stop passes what has not left yet.
            return {p.direction for p in found if isinstance(p, Chunk)} == {"received", "sent"}

        link.send("lamp", level=7)
        far.write(codec.encode("pose", x=3))
        wait_until(take, "a chunk of each direction")
        (message,) = link.receive(PATIENCE)
        link.emergency_stop()
        link.note("control", to="anna", number=3)
        link.release_stop()
    found.extend(tap.take().pieces)
    tap.close()
    far.close()
    reads = [p for p in found if isinstance(p, Chunk) and p.direction == "received"]
    assert b"".join(p.bytes for p in reads) == codec.encode("pose", x=3)
    assert message.t in [p.before for p in reads]
    sent = b"".join(p.bytes for p in found if isinstance(p, Chunk) and p.direction == "sent")
    assert sent.startswith(codec.encode("lamp", level=7))
    events = [p for p in found if isinstance(p, LinkEvent)]
    kinds = [p.kind for p in events]
    assert kinds[0] == "port_up"
    assert [k for k in kinds if k in ("stopped", "control", "released")] == ["stopped", "control", "released"]
    assert events[kinds.index("control")].facts == {"to": "anna", "number": 3}
    assert (kinds[-1], events[-1].facts) == ("port_down", {"why": "the link was closed"})
    assert sorted(p.t for p in found) == [p.t for p in found]


@pytest.mark.usefixtures("ports")
def test_a_port_that_goes_away_says_why() -> None:
    far = PtyPort()
    with wirebond.open(manipulator(), far.path) as link:
        tap = link.tap()
        far.close()
        found: list[LinkEvent] = []

        def take() -> bool:
            found.extend(p for p in tap.take().pieces if isinstance(p, LinkEvent) and p.kind == "port_down")
            return bool(found)

        wait_until(take, "the end of the port")
        assert found[0].facts["why"] == link.why or "went away" in found[0].facts["why"]


def test_wrong_arguments_get_a_sentence() -> None:
    far = PtyPort()
    with wirebond.open(manipulator(), far.path) as link:
        with pytest.raises(UsageError, match="the tap's capacity is 3; expected a whole number from 1024"):
            link.tap(3)
        with pytest.raises(UsageError, match="cannot be written as JSON"):
            link.note("control", to=os)
        with pytest.raises(UsageError, match="expected at most 4096"):
            link.note("control", to="x" * 5000)
        with pytest.raises(UsageError, match="an event needs a kind"):
            link.note("")
        assert isinstance(link.tap(), Tap)
    far.close()
