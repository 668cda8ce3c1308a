"""A link does not take a stranger's terminal for its port, where that has the number of a pty that ended."""

from __future__ import annotations

import os
import termios
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

import wirebond
from tests.shared import codec
from tests.waiting import moments, wait_until
from wirebond.link.devices.pty_number import PtyNumber
from wirebond.sim.pty_port import PtyPort

pytestmark = [pytest.mark.live, pytest.mark.usefixtures("ports")]
_LOCAL_MODES = 3


@contextmanager
def terminal_with_the_path(path: str) -> Iterator[int]:
    """As a program that opens a terminal, until it gets this one. (Other tests may have the number for a while.)"""
    for _ in moments("nobody gives the number back"):
        controller, terminal = os.openpty()
        try:
            if os.ttyname(terminal) == path:
                yield terminal
                return
        finally:
            os.close(controller)
            os.close(terminal)


def why_when_refused(link: wirebond.Link) -> str:
    wait_until(lambda: "another program's terminal" in link.why, lambda: (link.state, link.why))
    return link.why


@pytest.mark.parametrize("by_link", [False, True])
def test_a_strangers_terminal_under_the_same_number_is_left_alone(by_link: bool, tmp_path: Path) -> None:
    port = PtyPort()
    name = Path(port.path)
    if by_link:  # as one that a killed simulation leaves behind
        name = tmp_path / "robot"
        name.symlink_to(port.path)
    with wirebond.open(codec("diffdrive"), name) as link:
        port.close()
        with terminal_with_the_path(port.path) as terminal:
            assert why_when_refused(link).startswith(str(name))
            assert link.state == "down"
            assert termios.tcgetattr(terminal)[_LOCAL_MODES] & termios.ECHO  # not made raw


@pytest.mark.parametrize("ports", ["python"], indirect=True)
def test_a_number_that_is_given_away_after_the_look_is_a_strangers_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tests the ports in Python, where the moment between the examination and the opening can be chosen."""
    look = PtyNumber.is_a_strangers
    for _ in moments("the number is given away before the look each time, by other programs"):
        terminals: list[int] = []
        with ExitStack() as given:

            def give_away_after_it(
                number: PtyNumber, path: str, given: ExitStack = given, terminals: list[int] = terminals
            ) -> bool:
                is_a_strangers = look(number, path)
                if not is_a_strangers and not Path(path).exists() and not terminals:
                    terminals.append(given.enter_context(terminal_with_the_path(path)))
                return is_a_strangers

            monkeypatch.setattr(PtyNumber, "is_a_strangers", give_away_after_it)
            port = PtyPort()
            with wirebond.open(codec("diffdrive"), port.path) as link:
                port.close()
                why_when_refused(link)
            if terminals:
                assert termios.tcgetattr(terminals[0])[_LOCAL_MODES] & termios.ECHO
                return


def test_a_new_link_to_a_pty_with_the_same_number_is_followed(tmp_path: Path) -> None:
    port = PtyPort()
    name = tmp_path / "robot"
    name.symlink_to(port.path)
    with wirebond.open(codec("diffdrive"), name) as link:
        port.close()
        with terminal_with_the_path(port.path):
            name.unlink()
            name.symlink_to(port.path)
            wait_until(lambda: link.stats.reconnects, lambda: (link.state, link.why))
