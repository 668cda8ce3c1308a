"""``wirebond wire``: makes two names for two ptys, joins them by a wire, and prints its account at the end."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path
from typing import Any

from wirebond.cli.output import console, errors, write
from wirebond.cli.signals import ended_by_signals
from wirebond.cli.values import to_json
from wirebond.errors import UsageError
from wirebond.sim.faults import verify_baud
from wirebond.sim.pty_port import symlinked
from wirebond.sim.wire.process import DIRECTIONS, LineShape, WireProcess, WireSettings

_LINE = re.compile(r"([5-8])([NEO])([12])")
_FAULTS = {
    "bit_errors": "wrong bits",
    "burst_bytes": "in bursts",
    "dropped_bytes": "lost",
    "inserted_bytes": "inserted",
    "splits": "pauses",
    "collided_bytes": "sent while the other end sent",
    "unplugged": "lost in the cable",
    "not_read": "lost because they were not read",
    "travelling": "still on the line",
}


def line_shape(line: str) -> LineShape:
    """Return the shape of a byte for ``8N1`` and the like.

    :raises UsageError: it is something else.
    """
    found = _LINE.fullmatch(line)
    if found is None:
        raise UsageError(f"--line {line}: expected data bits, parity and stop bits, such as 8N1 or 8N2")
    return LineShape(int(found[1]), found[2], int(found[3]))


def unplugging(text: str) -> tuple[float, float]:
    """Read times of unplugging: ``2:0.5`` means after 2 s, for 0.5 s.

    :raises UsageError: it is something else.
    """
    at, colon, length = text.partition(":")
    try:
        times = (float(at), float(length))
    except ValueError:
        times = (-1.0, -1.0)
    if not colon or not all(0 <= seconds <= 1e6 for seconds in times):
        raise UsageError(f"--unplug {text}: expected AT:FOR in seconds, such as 2:0.5")
    return times


def join_ptys(a: Path, b: Path, settings: WireSettings, seconds: float | None, as_json: bool) -> None:
    settings.verify()
    verify_baud(settings.baud)
    if settings.baud_b is not None:
        verify_baud(settings.baud_b)
        if not settings.baud / 1000 <= settings.baud_b <= settings.baud * 1000:
            raise UsageError(f"--baud-b is {settings.baud_b}; expected at most 1000 times away from {settings.baud}")
    if settings.jitter > settings.batch:
        raise UsageError("--jitter is the delay that an adapter adds to its --batch; give at most the time of --batch")
    if a.absolute() == b.absolute():
        raise UsageError(f"both ends have the name {a}; name two files, such as /tmp/a /tmp/b")
    with WireProcess(settings) as wire, symlinked(wire.a, a) as name_a, symlinked(wire.b, b) as name_b:
        if not as_json:
            console.print(f"{name_a}\n{name_b}", soft_wrap=True)
        errors.print(f"{settings.baud} baud between {name_a} and {name_b}; Ctrl-C ends", style="dim", markup=False)
        with ended_by_signals(), suppress(KeyboardInterrupt):
            wire.wait(seconds)
        account = wire.end()
    if as_json:
        write(to_json(account) + "\n")
        return
    for direction, names in zip(DIRECTIONS, ((name_a, name_b), (name_b, name_a)), strict=True):
        errors.print(_sentence(account[direction], *names), markup=False)


def _sentence(found: dict[str, Any], source: str, target: str) -> str:
    told = [f"{found['bytes']} bytes, {found['handed_over']} came out", f"line use {100 * found['line_use']:.1f} %"]
    if found["is_misheard"]:
        told.append("heard with other settings than it was sent with")
    told += [f"{found[key]} {text}" for key, text in _FAULTS.items() if found[key]]
    return f"{source} to {target}: {', '.join(told)}"
