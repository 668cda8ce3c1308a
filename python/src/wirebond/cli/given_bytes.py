"""Bytes as a command is given them: hex digits, a capture, a recording, or stdin."""

from __future__ import annotations

import os
import re
import sys
from contextlib import suppress
from pathlib import Path

from wirebond.arguments import hex_bytes
from wirebond.cli.output import errors
from wirebond.errors import UsageError, WirebondError

MOST_BYTES = 1 << 20  # that are looked at: more makes nothing clearer
_HEX_TEXT = re.compile(rb"(?:0[xX]|[0-9a-fA-F\s:,;_-])*")


def given_bytes(source: str | None, hex_text: str | None, sender: str | None = None) -> bytes:
    """Return the first bytes of what is named, at most MOST_BYTES.

    :param source: the path of a capture or of a recording, ``-`` for stdin, or the bytes as hex digits.
    :param hex_text: the bytes as hex digits.
    :param sender: whose bytes of a recording; without it those of the MCU.
    :raises UsageError: neither of the two, or the text is not hex digits.
    :raises WirebondError: stdin cannot be read.
    :raises OSError: a file cannot be read.
    """
    if (source is None) == (hex_text is None):
        raise UsageError('give bytes one way: "AA 55 …", the path of a capture or recording, or - for stdin')
    if hex_text is not None:
        return hex_bytes(hex_text)
    assert source is not None, "one of the two is given"
    if source == "-":
        return _stdin()
    if "\0" in source:
        raise UsageError("a file's name cannot contain a zero byte; name the capture")
    if source.startswith(("sim:", "replay:")):
        raise UsageError(f"{source} knows its protocol; name the tty or tcp:// of a line, or a file with its bytes")
    path = Path(source)
    with suppress(UsageError):
        if not os.path.lexists(path) and len(hex_bytes(source)) > 1:
            return hex_bytes(source)
    return _of_file(path, sender)


def _of_file(path: Path, sender: str | None) -> bytes:
    from wirebond.recording.capture import captured  # noqa: PLC0415 it takes long to import
    from wirebond.recording.mcap_file import MAGIC  # noqa: PLC0415

    with path.open("rb") as file:
        is_recording = file.read(len(MAGIC)) == MAGIC
    if is_recording:
        from wirebond.recording import open as open_recording  # noqa: PLC0415

        return open_recording(path).reads(sender or "mcu").data[:MOST_BYTES]
    data = bytearray()
    for part in captured(path):
        data += part
        if len(data) >= MOST_BYTES:
            break
    return bytes(data[:MOST_BYTES])


def _stdin() -> bytes:
    """Read raw bytes from stdin. Text of hex digits only, as another program prints them, is taken for those bytes, and
    a sentence says so: the sender may as well have sent the digits."""
    data = bytearray()
    try:
        while len(data) < MOST_BYTES and (chunk := os.read(sys.stdin.fileno(), MOST_BYTES)):
            data += chunk
    except OSError as error:
        raise WirebondError(
            f"standard input cannot be read ({error.strerror}); pipe bytes into it, or name a file"
        ) from error
    if _HEX_TEXT.fullmatch(data):
        with suppress(UsageError):
            spelled = hex_bytes(data.decode("ascii"))
            if spelled:
                errors.print(
                    f"Standard input is text of hex digits, read as the {len(spelled)} byte{'s' * (len(spelled) != 1)} "
                    "that it spells. If the device sends the digits themselves, save them as a .bin file and name that."
                )
            return spelled
    return bytes(data[:MOST_BYTES])
