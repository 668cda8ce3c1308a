"""``wirebond listen``: both directions of a line as they come, each message with its sender."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from rich.text import Text

from wirebond.cli.commands.live import one_line
from wirebond.cli.output import ReaderGone, console, errors, plain, warn, write
from wirebond.cli.rounds import time_left
from wirebond.cli.shown import message_dict, stats_line
from wirebond.cli.signals import ended_by_signals
from wirebond.cli.values import to_json
from wirebond.link.listen import Listener, listen

_LOOK = 0.1  # seconds between two checks of the ports


def listen_to_both(
    path: Path,
    host_port: str | None,
    mcu_port: str | None,
    port: str | None,
    baud: int | None,
    seconds: float | None,
    as_json: bool,
    waits: bool,
) -> None:
    """Listen until the time is over, or until Ctrl-C."""
    with (
        ended_by_signals(),
        listen(path, host_port=host_port, mcu_port=mcu_port, port=port, baud=baud, wait_for_port=waits) as listener,
    ):
        for sentence in listener.untold:
            warn(sentence)
        with suppress(KeyboardInterrupt, ReaderGone):
            _print(listener, seconds, as_json)
        if (shared := listener.shared) is not None:
            frames = ", ".join(f"{count} of {sender}" for sender, count in shared.frames.items())
            errors.print(f"line: {shared.bytes} bytes; frames: {frames}; {shared.other_bytes} bytes in none")
            return
        for sender, link in listener.links.items():
            errors.print(f"{sender}: {stats_line(link.stats.receive)}")


def _print(listener: Listener, seconds: float | None, as_json: bool) -> None:
    away: set[str] = set()
    width = 4 if listener.shared is None else 6  # of "either"
    for left in time_left(seconds):
        for sender, link in listener.links.items():
            is_away = link.state == "down"
            if is_away != (sender in away):
                errors.print(f"{plain(link.why)}. Waiting for it." if is_away else f"{plain(link.port)} is there")
                away ^= {sender}
        for sender, message in listener.receive(min(_LOOK, left)):
            if as_json:
                write(to_json({"from": sender, **message_dict(message, listener.codec)}) + "\n")
            else:
                console.print(
                    Text(f"{sender:<{width}} ").append_text(one_line(message, listener.codec)), soft_wrap=True
                )
