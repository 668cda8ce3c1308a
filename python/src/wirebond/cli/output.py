"""The output of all commands: sentences, errors and data. All of it is made safe here."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable
from typing import NoReturn

from rich.console import Console, ConsoleOptions, RenderableType
from rich.markup import escape
from rich.segment import Segment

from wirebond.visible import visible


class ReaderGone(Exception):  # noqa: N818 it is not an error: `head` has seen enough
    """The reader of stdout has gone. What has an account gives it, and the command ends with exit code 0."""


class SafeConsole(Console):
    """A console that escapes what could command a terminal, wherever it comes from; its own colours stay."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            if segment.control or segment.text.isprintable():
                yield segment
            else:
                yield Segment(visible(segment.text, keep="\n"), segment.style)

    def on_broken_pipe(self) -> None:
        if self.stderr:
            drop(2)
        else:
            reader_gone()


console = SafeConsole(highlight=False, emoji=False)  # `:x:` of others stays as it is
errors = SafeConsole(stderr=True, highlight=False, emoji=False, soft_wrap=True)


def drop(descriptor: int) -> None:
    """Discard everything that is written to this standard stream from now on."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, descriptor)
    os.close(nowhere)


def reader_gone() -> NoReturn:
    drop(1)
    raise ReaderGone


def plain(text: str) -> str:
    """Escape a text of others for rich's markup, on one line."""
    return escape(visible(text))


def write(text: str) -> None:
    """Write a text of any number of lines to stdout at once: a reader may wait for it.

    :raises ReaderGone: its reader has gone.
    """
    try:
        sys.stdout.write(visible(text, keep="\n"))
        sys.stdout.flush()
    except BrokenPipeError:
        reader_gone()


def fail(text: str) -> None:
    """Print one error, in sentences, on stderr."""
    shown = escape(visible(text, keep="\n"))
    errors.print(f"[bold red]wirebond:[/] {shown}")


def warn(text: str) -> None:
    """Print a warning on stderr: the command continues."""
    errors.print(f"[bold yellow]warning:[/] {plain(text)}")
