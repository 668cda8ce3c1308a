"""``wirebond record``: what a link reads, writes and does, into a file until Ctrl-C."""

from __future__ import annotations

import time
from contextlib import suppress
from pathlib import Path

from rich.live import Live
from rich.text import Text

from wirebond.cli.commands.recordings import progress_bar
from wirebond.cli.output import errors, fail, plain, write
from wirebond.cli.rounds import time_left
from wirebond.cli.signals import ended_by_signals
from wirebond.codec import load
from wirebond.errors import UsageError
from wirebond.link import Link, open_link
from wirebond.protocol.model import End
from wirebond.recording.recorder import Recorder

_LOOK = 0.1  # seconds between two checks
_LINE = 10.0  # seconds between two lines where stderr is not a terminal


def record_port(
    path: Path, port: str, out: Path | None, baud: int | None, seconds: float | None, waits: bool, role: str
) -> int:
    """Record; return the exit code: 1 if the file ended early."""
    if seconds is not None and seconds <= 0:
        raise UsageError(f"--seconds {seconds:g}: expected more than 0, such as 10")
    codec = load(path)
    name = out or Path(f"{codec.name}-{time.strftime('%Y%m%d-%H%M%S')}.mcap")
    options = {"hello": role == End.HOST, "clock_sync": False, "role": role, "wait_for_port": waits}
    with open_link(codec, port, baud, hold_back=False, listen="all", **options) as link:  # type: ignore[arg-type]
        recorder = Recorder(link, name)
        try:
            with ended_by_signals(), suppress(KeyboardInterrupt):
                write(f"{name}\n")
                _watch(link, recorder, seconds)
        finally:
            recorder.close(compact=False)
    errors.print(_line(recorder))
    if recorder.error:
        fail(recorder.error)
        return 1
    try:
        with progress_bar(f"closing {plain(name.name)}") as progress:
            recorder.compact(progress)
    except KeyboardInterrupt:
        errors.print(f"{plain(str(name))} is whole; `wirebond info` compresses it later")
    return 0


def _watch(link: Link, recorder: Recorder, seconds: float | None) -> None:
    """Show the progress until the time is over, or the file ended."""
    if errors.is_terminal:
        with Live(Text(), console=errors, refresh_per_second=5, transient=True) as live:
            for left in time_left(seconds):
                if recorder.error:
                    return
                link.receive(min(_LOOK, left))
                live.update(Text(_line(recorder, link)))
        return
    told = time.monotonic()
    for left in time_left(seconds):
        if recorder.error:
            return
        link.receive(min(_LOOK, left))
        if (now := time.monotonic()) - told >= _LINE:
            errors.print(_line(recorder, link))
            told = now


def _line(recorder: Recorder, link: Link | None = None) -> str:
    messages = recorder.messages
    text = f"{recorder.seconds:.1f} s, {recorder.bytes} bytes, {messages} messages, {recorder.lost_bytes} bytes lost"
    if link is not None and link.state == "down":
        text += f"; {link.why}"
    return text
