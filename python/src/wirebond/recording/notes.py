"""What persons write about a recording: texts in the metadata of its file. One is added at the end of the file, without
touching its messages."""

from __future__ import annotations

import contextlib
import os
import struct
import time
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from wirebond.errors import UsageError, WirebondError
from wirebond.recording import layout
from wirebond.recording.locking import lock
from wirebond.recording.scan import MAGIC

MOST_CHARACTERS = 4096
_HEAD = struct.Struct("<BQ")  # opcode and length of a record
_FOOTER, _STATISTICS, _METADATA, _METADATA_INDEX, _SUMMARY_OFFSET, _DATA_END = 2, 11, 12, 13, 14, 15
_FOOTER_SIZE = _HEAD.size + 20
_DATA_END_SIZE = _HEAD.size + 4
_METADATA_COUNT = struct.Struct("<I")
_METADATA_COUNT_AT = 18  # in the statistics, behind counts of messages, schemas, channels and attachments
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
    """As the file's metadata have them."""
    found = []
    for values in metadata:
        t = values.get("t_ns", "0")
        written = int(t) if t.isdecimal() and len(t) < 20 else 0
        found.append(Note(datetime.fromtimestamp(min(written, 32503680000 * 10**9) / 1e9, UTC), values.get("text", "")))
    return tuple(found)


def annotate(path: Path, text: str) -> None:
    """Add a text to a closed recording. A program that is killed meanwhile leaves a file that `wirebond info` closes
    again; no message is touched.

    :raises UsageError: the text is empty or too long.
    :raises WirebondError: the file is not closed, is being recorded, or is no recording.
    :raises OSError: it cannot be written; it is as it was.
    """
    if not text.strip() or len(text) > MOST_CHARACTERS:
        raise UsageError(f"the note has {len(text)} characters; expected 1 to {MOST_CHARACTERS}, and not spaces alone")
    values = {"t_ns": str(time.time_ns()), "text": text}
    descriptor = os.open(path, os.O_RDWR | getattr(os, "O_CLOEXEC", 0))
    try:
        if not lock(descriptor) or not os.path.samestat(os.fstat(descriptor), path.stat()):
            raise WirebondError(f"{path} is being recorded or closed at the moment; wait for its end")
        _append(descriptor, path, _record(_METADATA, _text(layout.NOTE) + _texts(values)))
    finally:
        os.close(descriptor)


def _append(descriptor: int, path: Path, metadata: bytes) -> None:
    size = os.lseek(descriptor, 0, os.SEEK_END)
    try:
        begin, end = _data_end(descriptor, size)
    except (struct.error, ValueError):
        raise WirebondError(f"{path} is not closed; `wirebond info {path}` closes it") from None
    old = _read(descriptor, begin, size - begin)
    summary = old[end - begin : -len(MAGIC) - _FOOTER_SIZE]
    tail = metadata + _record(_DATA_END, bytes(4)) + _closed(summary, begin, len(metadata))
    _write(descriptor, begin, old, tail)


def _data_end(descriptor: int, size: int) -> tuple[int, int]:
    """Where the record lies that ends the data.

    :raises ValueError: the file has no end.
    """
    at = size - len(MAGIC) - _FOOTER_SIZE
    if at < len(MAGIC) + _DATA_END_SIZE:
        raise ValueError("too short")
    footer = _read(descriptor, at, size - at)
    opcode, _, summary, _, _ = struct.unpack_from("<BQQQI", footer)
    begin = (summary or at) - _DATA_END_SIZE
    if opcode != _FOOTER or footer[_FOOTER_SIZE:] != MAGIC or not 0 < begin < at or at - begin > _MOST_SUMMARY:
        raise ValueError("no footer")
    if _HEAD.unpack(_read(descriptor, begin, _HEAD.size)) != (_DATA_END, 4):
        raise ValueError("no end of data")
    return begin, begin + _DATA_END_SIZE


def _closed(summary: bytes, metadata_at: int, metadata_size: int) -> bytes:
    """The summary with one more entry of metadata, and the file's end."""
    groups: dict[int, list[bytes]] = {}
    at = 0
    while at < len(summary):
        opcode, length = _HEAD.unpack_from(summary, at)
        body = summary[at + _HEAD.size : at + _HEAD.size + length]
        at += _HEAD.size + length
        if opcode == _STATISTICS:
            (count,) = _METADATA_COUNT.unpack_from(body, _METADATA_COUNT_AT)
            after = body[_METADATA_COUNT_AT + _METADATA_COUNT.size :]
            body = body[:_METADATA_COUNT_AT] + _METADATA_COUNT.pack(count + 1) + after
        if opcode != _SUMMARY_OFFSET:
            groups.setdefault(opcode, []).append(_record(opcode, body))
    entry = struct.pack("<QQ", metadata_at, metadata_size) + _text(layout.NOTE)
    groups.setdefault(_METADATA_INDEX, []).append(_record(_METADATA_INDEX, entry))

    begin = metadata_at + metadata_size + _DATA_END_SIZE
    records, offsets = b"", b""
    for opcode, group in groups.items():
        place = struct.pack("<BQQ", opcode, begin + len(records), sum(map(len, group)))
        offsets += _record(_SUMMARY_OFFSET, place)
        records += b"".join(group)
    footer = _HEAD.pack(_FOOTER, 20) + struct.pack("<QQ", begin, begin + len(records))
    crc = zlib.crc32(records + offsets + footer)
    return records + offsets + footer + struct.pack("<I", crc) + MAGIC


def _write(descriptor: int, at: int, old: bytes, new: bytes) -> None:
    """``new`` in the place of ``old``, which ends the file; where there is no room, the old end is there again."""
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


def _record(opcode: int, body: bytes) -> bytes:
    return _HEAD.pack(opcode, len(body)) + body


def _text(text: str) -> bytes:
    data = text.encode()
    return struct.pack("<I", len(data)) + data


def _texts(values: Mapping[str, str]) -> bytes:
    data = b"".join(_text(key) + _text(value) for key, value in values.items())
    return struct.pack("<I", len(data)) + data
