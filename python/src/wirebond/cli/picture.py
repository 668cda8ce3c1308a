"""A picture in a terminal that is drawn again and again in its place."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from rich.console import Console, RenderableType
from rich.live import Live


@contextmanager
def picture(console: Console, first: RenderableType | None = None) -> Iterator[Callable[[RenderableType], None]]:
    """Yield the function that draws it again. Ctrl-C waits until a picture is whole, and then raises KeyboardInterrupt.
    Main thread only.

    :param first: what is drawn at once.
    """
    live = Live(first, console=console, auto_refresh=False)

    def draw(now: RenderableType) -> None:
        with _whole():
            live.update(now, refresh=True)

    try:
        with _whole():
            live.start(refresh=first is not None)
        yield draw
    finally:
        with _whole():
            live.stop()


@contextmanager
def _whole() -> Iterator[None]:
    """Delay the first Ctrl-C until the end of this block. A second one acts at once: the terminal may no longer accept
    bytes."""
    asked = False

    def wait(_number: int, _frame: FrameType | None) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True

    before = signal.signal(signal.SIGINT, wait)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if asked:
        raise KeyboardInterrupt
