"""``wirebond identify`` on bytes: where they come from, and the exit code."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path

from wirebond.analysis.identify.formats import Known, known_formats
from wirebond.analysis.identify.ranking import rank
from wirebond.arguments import hex_bytes
from wirebond.cli.commands.identify_view import show, show_json
from wirebond.cli.output import errors, plain
from wirebond.errors import UsageError, WirebondError

MOST_BYTES = 1 << 20  # that are looked at: more makes no format likelier


def identify_bytes(source: str | None, hex_text: str | None, also: Sequence[Path], as_json: bool) -> int:
    """Exit code 1 where no known format fits."""
    if (source is None) == (hex_text is None):
        raise UsageError('give bytes one way: the path of a capture, - for stdin, or --hex "AA 55 …"')
    data = hex_bytes(hex_text) if hex_text is not None else read_capture(source or "-")
    known = formats_with(also)
    candidates = rank(data, known.formats)
    (show_json if as_json else show)(candidates, len(data), known)
    return 0 if candidates and candidates[0].fits else 1


def formats_with(also: Sequence[Path]) -> Known:
    """The formats to try; files that cannot be used are named on stderr."""
    known = known_formats(also)
    for path, reason in known.unreadable.items():
        errors.print(f"{plain(str(path))} is left out: {plain(reason.splitlines()[0])}")
    return known


def read_capture(source: str) -> bytes:
    """The first bytes of a file, or of stdin.

    :raises WirebondError: stdin cannot be read.
    """
    if source != "-":
        if "\0" in source:
            raise UsageError("no file's name has a zero byte in it; name the capture")
        if source.startswith(("sim:", "replay:")):
            raise UsageError(f"{source} knows its protocol; name the tty or tcp:// of a line, or a file with its bytes")
    data = bytearray()
    if source != "-":
        from wirebond.recording.capture import captured  # noqa: PLC0415 it takes long to import

        for part in captured(Path(source)):
            data += part
            if len(data) >= MOST_BYTES:
                break
        return bytes(data[:MOST_BYTES])
    try:
        while len(data) < MOST_BYTES and (chunk := os.read(sys.stdin.fileno(), MOST_BYTES)):
            data += chunk
    except OSError as error:
        raise WirebondError(
            f"standard input cannot be read ({error.strerror}); pipe bytes into it, or name a file"
        ) from error
    return bytes(data[:MOST_BYTES])
