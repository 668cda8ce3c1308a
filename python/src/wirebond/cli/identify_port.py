"""``wirebond identify PORT``: listens with one setting after the other, and says what fits."""

from __future__ import annotations

import stat
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from wirebond.cli.output import errors, plain
from wirebond.codec import Codec
from wirebond.errors import UsageError
from wirebond.identify.command import formats_with
from wirebond.identify.lines import Heard, Line, best_of, lines_for, search
from wirebond.identify.view import show, show_json
from wirebond.link import open_link
from wirebond.ports.port_name import port_name
from wirebond.protocol.loader import loads

DEFAULT_SECONDS = 2.0  # at each setting
_LOOK = 0.05  # seconds between two looks at what has come

# A link needs a protocol. This one only keeps the bytes: nothing is sent, and what is found does not matter.
_LISTENER = """
wirebond: 1
protocol: listener
frame: [magic: 0x55 0xAA 0x55 0xAA, payload: 1, check: crc-16/modbus]
messages: {heard: {sender: mcu, fields: {what: {type: u8}}}}
"""


def is_port(source: str) -> bool:
    """Does this name a port, and not a capture?"""
    if source.startswith(("usb:", "/dev/")) or "://" in source:
        return source not in ("/dev/stdin", "/dev/null")
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
        codec = Codec(replace(loads(_LISTENER), link=line.settings()))
        with open_link(codec, port, hold_back=False, listen="all", hello=False, clock_sync=False) as link:
            end = time.monotonic() + each
            while (left := end - time.monotonic()) > 0:
                link.receive(min(_LOOK, left))
                if link.stats.receive.bytes:
                    yield link.dump().received

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
        show_json(best_line.candidates, best_line.size, known, settings)
    elif best_line.size == 0:
        errors.print(
            f"No byte came from {plain(port)} at any of {len(heard)} settings. Does the device send by itself? Some "
            "only answer. Look at power, ground, and which wire is its transmitter; "
            "`wirebond doctor` looks at this machine."
        )
    else:
        show(best_line.candidates, best_line.size, known, str(best_line.line))
    return 0 if best_line.candidates and best_line.candidates[0].fits else 1
