"""A program that asks and waits for the answer does the link's work at the port itself. While it is away, the link's
thread does."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

import wirebond
from tests.link.protocol import manipulator, without_deadlines
from tests.waiting import PATIENCE, moments, wait_until
from wirebond import LinkDownError
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live
ROUNDS = 300
POSES = [manipulator().encode("pose", x=number % 100) for number in range(ROUNDS)]


@pytest.fixture
def pty() -> Iterator[PtyPort]:
    port = PtyPort()
    yield port
    port.close()


def asked(link: wirebond.Link, pty: PtyPort) -> None:
    """Many rounds that follow each other at once: each message comes, and in its order."""
    for number, frame in enumerate(POSES):
        pty.write(frame)
        [message] = link.receive(PATIENCE)
        assert message.fields["x"] == number % 100


def receive_for_ever(link: wirebond.Link) -> None:
    while True:
        link.receive(PATIENCE)


def test_bytes_that_come_while_the_program_is_away_are_read_all_the_same(pty: PtyPort) -> None:
    with wirebond.open(without_deadlines(), pty.path) as link:
        for _ in range(5):
            asked(link, pty)
            before = link.stats.receive.frames
            pty.write(POSES[7])
            wait_until(lambda: link.stats.receive.frames > before, "the thread has read it")  # noqa: B023
            [message] = link.receive(PATIENCE)
            assert message.fields["x"] == 7


def test_a_wait_at_the_port_ends_when_the_link_is_closed(pty: PtyPort) -> None:
    for _ in range(20):
        link = wirebond.open(without_deadlines(), pty.path)
        asked(link, pty)
        closer = threading.Timer(0.002, link.close)
        closer.start()
        with pytest.raises(LinkDownError, match="is closed"):
            receive_for_ever(link)
        closer.join()


def test_a_wait_at_the_port_ends_when_the_device_goes() -> None:
    device = PtyPort()
    with wirebond.open(without_deadlines(), device.path) as link:
        asked(link, device)
        goes = threading.Timer(0.002, device.close)
        goes.start()
        for _ in moments("the loss"):
            link.receive(0.01)
            if link.state == "down":
                break
        goes.join()
        assert link.why != ""


def test_programs_that_wait_together_get_every_message_once(pty: PtyPort) -> None:
    found: list[int] = []
    with wirebond.open(without_deadlines(), pty.path) as link:

        def take() -> None:
            while len(found) < ROUNDS:
                found.extend(message.fields["x"] for message in link.receive(0.01))

        takers = [threading.Thread(target=take) for _ in range(3)]
        for taker in takers:
            taker.start()
        for frame in POSES:
            pty.write(frame)
        for taker in takers:
            taker.join(PATIENCE)
        assert sorted(found) == sorted(number % 100 for number in range(ROUNDS))
