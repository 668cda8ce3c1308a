"""Ctrl-C while a picture is written to the terminal."""

from __future__ import annotations

import io
import signal

import pytest
from rich.console import Console

from wirebond.cli.picture import picture


class Screen(io.StringIO):
    """A terminal at which Ctrl-C is pressed before it takes a text that has this in it. ``is_stuck``: it takes it only
    when the program has given up once."""

    pressed_at = ""
    is_stuck = False
    presses = 0

    def write(self, text: str) -> int:
        while self.pressed_at and self.pressed_at in text:
            self.presses += 1
            self.pressed_at = self.pressed_at if self.is_stuck and self.presses < 10 else ""
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt:
                self.pressed_at = ""
                raise
        return super().write(text)


@pytest.fixture
def screen() -> Screen:
    return Screen()


def show(screen: Screen) -> None:
    with picture(Console(file=screen, force_terminal=True, width=40, height=10), "first") as draw:
        draw("second")
        draw("third")


@pytest.mark.parametrize("at", ["first", "second"])
def test_ctrl_c_waits_until_the_picture_is_whole(screen: Screen, at: str) -> None:
    before = signal.getsignal(signal.SIGINT)
    screen.pressed_at = at
    with pytest.raises(KeyboardInterrupt):
        show(screen)
    assert at in screen.getvalue()
    assert "third" not in screen.getvalue()
    assert screen.presses == 1
    assert screen.getvalue().endswith("\x1b[?25h")  # the cursor is there again
    assert signal.getsignal(signal.SIGINT) is before


def test_a_second_ctrl_c_does_not_wait(screen: Screen) -> None:
    screen.pressed_at, screen.is_stuck = "second", True
    with pytest.raises(KeyboardInterrupt):
        show(screen)
    assert screen.presses == 2
