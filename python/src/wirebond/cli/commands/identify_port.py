"""``wirebond identify PORT``: listens with one setting after the other, and says what fits."""

from __future__ import annotations

import stat
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from wirebond.analysis.identify.lines import Heard, Line, best_of, lines_for, search
from wirebond.cli.commands.identify import formats_with
from wirebond.cli.commands.identify_view import show, show_json
from wirebond.cli.output import errors, plain
from wirebond.errors import UsageError
from wirebond.link.devices.port_name import is_com_port, port_name
from wirebond.link.raw import listen_at

DEFAULT_SECONDS = 2.0  # at each setting


def is_port(source: str) -> bool:
    """Return whether this names a port, and not a capture."""
    if source.startswith(("usb:", "/dev/")) or "://" in source:
        return source not in ("/dev/stdin", "/dev/null")
    if is_com_port(source):
        return True
    with suppress(OSError, ValueError):
        return stat.S_ISCHR(Path(source).stat().st_mode)
    return False


def identify_port(port: str, baud: int | None, seconds: float | None, also: Sequence[Path], as_json: bool) -> int:
    """Exit code 1 where no known format fits."""
    each = DEFAULT_SECONDS if seconds is None else seconds
    if each <= 0:
        raise UsageError("--seconds is 0; give the time to listen at each setting, such as 2")
    known = formats_with(also)
    name = port_name(port)
    lines = lines_for(known.formats)
    if baud is not None:
        lines = [line for line in lines if line.baud == baud] or [Line(baud)]
    if name.is_tcp and not name.is_rfc2217:
        lines = lines[:1]  # the server sets the line
    heard: list[Heard] = []

    def listen(line: Line) -> Iterator[bytes]:
        return listen_at(port, line.settings(), each)

    told = 0
    try:
        for one in search(lines, listen, known.formats):
            heard.append(one)
            told += 1
            best = one.candidates[0] if one.candidates and one.candidates[0].fits else None
            errors.print(
                f"{told} of {len(lines)}: {one.line}: {one.size} bytes"
                + (f", {best.format.name} fits" if best is not None else ""),
                style="dim",
            )
    except KeyboardInterrupt:
        errors.print(f"ended after {told} of {len(lines)} settings")
        if not heard:
            raise
    best_line = best_of(heard)
    if as_json:
        settings = {
            "port": plain(port),
            "baud": best_line.line.baud,
            "parity": best_line.line.parity,
            "stop_bits": best_line.line.stop_bits,
            "settings_tried": [{"line": str(one.line), "bytes": one.size} for one in heard],
        }
        show_json(best_line.candidates, best_line.data, known, settings)
    elif best_line.size == 0:
        errors.print(
            f"No byte came from {plain(port)} at any of {len(heard)} settings. Does the device send by itself? Some "
            "only answer. Look at power, ground, and which wire is its transmitter; "
            "`wirebond doctor` looks at this machine."
        )
    else:
        show(best_line.candidates, best_line.data, known, str(best_line.line))
    return 0 if best_line.candidates and best_line.candidates[0].fits else 1
