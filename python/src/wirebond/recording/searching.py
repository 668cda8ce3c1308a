"""Finding records in an MCAP file without believing the bytes before them: the next one after damage, and the summary
at the end of the file."""

from __future__ import annotations

import os
import re
import struct
import threading
import weakref
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from wirebond.recording import layout
from wirebond.recording.mcap_file import (
    CHANNEL,
    DATA_END,
    FOOTER,
    FOOTER_SIZE,
    HEAD,
    MAGIC,
    METADATA_INDEX,
    STATISTICS,
)

MOST_RECORD = 1 << 28  # bytes of any record
_MOST_SUMMARY = 1 << 26  # bytes
_PIECE = 1 << 18  # bytes that are searched at once
_MOST_SEARCHED = 1 << 26  # bytes after damage in which the next record must begin
_CHAIN = 3  # records that must follow each other, so that none is found by chance in other data
_HEAD = re.compile(rb"(?=[\x01-\x0f].{3}[\x00-\x0f]\x00{4})", re.DOTALL)  # opcode and length of a record of MCAP


class Source:
    """A file that passes read, as large as it was when it was opened. It stays the same one when another file takes its
    name. Any thread.

    :raises OSError: it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        with path.open("rb") as file:  # which says in words that a folder is none
            self._file = os.dup(file.fileno())
        self.close = weakref.finalize(self, os.close, self._file)
        self._lock = threading.Lock()
        self.size = os.lseek(self._file, 0, os.SEEK_END)

    def read(self, at: int, size: int) -> bytes:
        """Read; returns fewer bytes if the file has become shorter."""
        parts = []
        with self._lock:
            os.lseek(self._file, at, os.SEEK_SET)
            while size > 0 and (part := os.read(self._file, size)):
                parts.append(part)
                size -= len(part)
        return parts[0] if len(parts) == 1 else b"".join(parts)


class Search:
    """:param source: the file."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self._end = source.size - len(MAGIC)
        self._is_whole = source.size > 2 * len(MAGIC) and source.read(self._end, len(MAGIC)) == MAGIC

    def is_head(self, at: int) -> bool:
        """Return whether a record may begin there, and ends within the file."""
        return self._behind(at) is not None

    def is_next(self, at: int) -> bool:
        """Return whether a record may begin there, or the file ends."""
        return at == self._source.size or (self._is_whole and at == self._end) or self.is_head(at)

    def leads_on(self, at: int) -> bool:
        """Return whether some records follow each other from there on, or all until the end of the file."""
        for _ in range(_CHAIN):
            if self._is_whole and at == self._end:
                return True
            behind = self._behind(at)
            if behind is None:
                return False
            at = behind
        return True

    def next_from(self, begin: int) -> int | None:
        """Return the first place from there on from which records follow each other."""
        for first in range(begin, min(self._source.size, begin + _MOST_SEARCHED), _PIECE):
            piece = self._source.read(first, _PIECE + HEAD.size - 1)
            for found in _HEAD.finditer(piece):
                if found.start() < _PIECE and self.leads_on(first + found.start()):
                    return first + found.start()
        return None

    def _behind(self, at: int) -> int | None:
        head = self._source.read(at, HEAD.size)
        if len(head) < HEAD.size:
            return None
        opcode, length = HEAD.unpack(head)
        behind = int(at + HEAD.size + length)
        return None if opcode == 0 or DATA_END < opcode < 0x80 or behind > self._source.size else behind


@dataclass(frozen=True)
class Summary:
    """The summary at the end of a file.

    :ivar channels: bodies of records, by opcode.
    :ivar abouts: places and sizes of the records with the recording's own metadata.
    :ivar chunk_count: how many chunks the file has.
    """

    channels: tuple[tuple[int, bytes], ...]
    abouts: tuple[tuple[int, int], ...]
    chunk_count: int


def read_summary(source: Source) -> Summary | None:
    """Return the summary of a finished file; None: there is none that is whole."""
    at = source.size - len(MAGIC) - FOOTER_SIZE
    footer = source.read(at, FOOTER_SIZE) if at > 0 else b""
    if len(footer) < FOOTER_SIZE:
        return None
    opcode, length, begin, _, crc = struct.unpack("<BQQQI", footer)
    if (opcode, length) != (FOOTER, 20) or not 0 < begin <= at or at - begin > _MOST_SUMMARY:
        return None
    data = source.read(begin, at - begin)
    if crc and zlib.crc32(data + footer[:-4]) != crc:
        return None
    try:
        return _summary(data)
    except (struct.error, IndexError, UnicodeDecodeError):
        return None


def _summary(data: bytes) -> Summary:
    channels, abouts, chunk_count = [], [], 0
    for opcode, body in _records(data):
        if opcode == CHANNEL:
            channels.append((opcode, body))
        elif opcode == METADATA_INDEX:
            at, length, size = struct.unpack_from("<QQI", body)
            if body[20 : 20 + size].decode() == layout.METADATA:
                abouts.append((at, length))
        elif opcode == STATISTICS:
            (chunk_count,) = struct.unpack_from("<I", body, 22)
    return Summary(tuple(channels), tuple(abouts), chunk_count)


def _records(data: bytes) -> Iterator[tuple[int, bytes]]:
    at = 0
    while at + HEAD.size <= len(data):
        opcode, length = HEAD.unpack_from(data, at)
        yield opcode, data[at + HEAD.size : at + HEAD.size + length]
        at += HEAD.size + length
