"""Notes that people write about a recording: texts in the metadata of its file. A note is added at the end of the file,
without touching its messages."""

from __future__ import annotations

import contextlib
import os
import struct
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from wirebond.errors import UsageError, WirebondError
from wirebond.recording import layout
from wirebond.recording.locking import lock
from wirebond.recording.mcap_file import (
    DATA_END,
    FOOTER,
    FOOTER_SIZE,
    HEAD,
    MAGIC,
    METADATA,
    METADATA_COUNT_AT,
    METADATA_INDEX,
    STATISTICS,
    SUMMARY_OFFSET,
    ending,
    record,
    string,
    strings,
)
from wirebond.system import BINARY

MOST_CHARACTERS = 4096
_DATA_END_SIZE = HEAD.size + 4
_METADATA_COUNT = struct.Struct("<I")
_MOST_SUMMARY = 1 << 26  # bytes; one of a file of others with an index of every message would be larger


@dataclass(frozen=True)
class Note:
    """A person's text about a recording.

    :ivar written: when; UTC.
    :ivar text: as it was given.
    """

    written: datetime
    text: str


def notes_from(metadata: Iterable[Mapping[str, str]]) -> tuple[Note, ...]:
    """Read notes from the file's metadata."""
    found = []
    for values in metadata:
        t = values.get("t_ns", "0")
        written = int(t) if t.isdecimal() and len(t) < 20 else 0
        found.append(Note(datetime.fromtimestamp(min(written, 32503680000 * 10**9) / 1e9, UTC), values.get("text", "")))
    return tuple(found)


def annotate(path: Path, text: str) -> None:
    """Add a text to a closed recording. A program that is killed in between leaves a file that `wirebond info` closes
    again; no message is touched.

    :raises UsageError: the text is empty or too long.
    :raises WirebondError: the file is not closed, is being recorded, or is not a recording.
    :raises OSError: it cannot be written; it is as it was.
    """
    if not text.strip() or len(text) > MOST_CHARACTERS:
        raise UsageError(f"the note has {len(text)} characters; expected 1 to {MOST_CHARACTERS}, and not spaces alone")
    values = {"t_ns": str(time.time_ns()), "text": text}
    descriptor = os.open(path, os.O_RDWR | BINARY)
    try:
        if not lock(descriptor) or not os.path.samestat(os.fstat(descriptor), path.stat()):
            raise WirebondError(f"{path} is being recorded or closed; wait until that has ended")
        _append(descriptor, path, record(METADATA, string(layout.NOTE) + strings(values)))
    finally:
        os.close(descriptor)


def _append(descriptor: int, path: Path, metadata: bytes) -> None:
    size = os.lseek(descriptor, 0, os.SEEK_END)
    try:
        begin, end = _data_end(descriptor, size)
        old = _read(descriptor, begin, size - begin)
        summary = old[end - begin : -len(MAGIC) - FOOTER_SIZE]
        tail = metadata + record(DATA_END, bytes(4)) + _closed(summary, begin, len(metadata))
    except (struct.error, ValueError):
        raise WirebondError(f"{path} is not closed; `wirebond info {path}` closes it") from None
    _write(descriptor, begin, old, tail)


def _data_end(descriptor: int, size: int) -> tuple[int, int]:
    """Return the position of the record that ends the data.

    :raises ValueError: the file has no end.
    """
    at = size - len(MAGIC) - FOOTER_SIZE
    if at < len(MAGIC) + _DATA_END_SIZE:
        raise ValueError("too short")
    footer = _read(descriptor, at, size - at)
    opcode, _, summary, _, _ = struct.unpack_from("<BQQQI", footer)
    begin = (summary or at) - _DATA_END_SIZE
    if opcode != FOOTER or footer[FOOTER_SIZE:] != MAGIC or not 0 < begin < at or at - begin > _MOST_SUMMARY:
        raise ValueError("no footer")
    if HEAD.unpack(_read(descriptor, begin, HEAD.size)) != (DATA_END, 4):
        raise ValueError("no end of data")
    return begin, begin + _DATA_END_SIZE


def _closed(old: bytes, metadata_at: int, metadata_size: int) -> bytes:
    """Return the summary with one more entry of metadata, and the file's end."""
    groups: dict[int, list[bytes]] = {}
    at = 0
    while at < len(old):
        opcode, length = HEAD.unpack_from(old, at)
        body = old[at + HEAD.size : at + HEAD.size + length]
        at += HEAD.size + length
        if opcode == STATISTICS:
            (count,) = _METADATA_COUNT.unpack_from(body, METADATA_COUNT_AT)
            after = body[METADATA_COUNT_AT + _METADATA_COUNT.size :]
            body = body[:METADATA_COUNT_AT] + _METADATA_COUNT.pack(count + 1) + after
        if opcode != SUMMARY_OFFSET:
            groups.setdefault(opcode, []).append(record(opcode, body))
    entry = struct.pack("<QQ", metadata_at, metadata_size) + string(layout.NOTE)
    groups.setdefault(METADATA_INDEX, []).append(record(METADATA_INDEX, entry))

    return ending(groups, metadata_at + metadata_size + _DATA_END_SIZE)


def _write(descriptor: int, at: int, old: bytes, new: bytes) -> None:
    """Write ``new`` in the place of ``old``, which ends the file. If the disk is full, the old end is restored."""
    try:
        if hasattr(os, "posix_fallocate"):
            os.posix_fallocate(descriptor, at, len(new))
        _write_at(descriptor, at, new)
        os.fsync(descriptor)
    except OSError:
        with contextlib.suppress(OSError):
            _write_at(descriptor, at, old)
            os.ftruncate(descriptor, at + len(old))
        raise


def _write_at(descriptor: int, at: int, data: bytes) -> None:
    os.lseek(descriptor, at, os.SEEK_SET)
    left = memoryview(data)
    while left:
        left = left[os.write(descriptor, left) :]


def _read(descriptor: int, at: int, size: int) -> bytes:
    os.lseek(descriptor, at, os.SEEK_SET)
    found = b""
    while len(found) < size and (part := os.read(descriptor, size - len(found))):
        found += part
    return found
