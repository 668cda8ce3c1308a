"""Writing MCAP (https://mcap.dev/spec): records, chunks and the summary. Knows no channel's meaning, no clock."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import zstandard
from numpy.typing import NDArray

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
ATTACHMENT, ATTACHMENT_INDEX, STATISTICS, METADATA, METADATA_INDEX, SUMMARY_OFFSET, DATA_END = range(9, 16)
HEAD = struct.Struct("<BQ")  # opcode of a record, and how many bytes follow
FOOTER_SIZE = HEAD.size + 20
METADATA_COUNT_AT = 18  # in the statistics
_MESSAGE = struct.Struct("<BQHIQQ")
_COMPRESSION = "zstd"
_SMALL = 1 << 17  # bytes of a chunk that is compressed with more effort, since it has less to repeat


class Output(Protocol):
    """The target of a writer."""

    def write(self, data: bytes, /) -> int: ...
    def tell(self) -> int: ...


@dataclass(frozen=True)
class Packed:
    """Message records one after the other, as ``_engine.packed_records`` makes them. Times are nanoseconds."""

    data: bytes
    places: NDArray[np.uint64]
    channels: NDArray[np.uint16]
    logged: NDArray[np.uint64]

    @staticmethod
    def of(data: bytes, places: bytes, channels: bytes, logged: bytes) -> Packed:
        return Packed(
            data, np.frombuffer(places, np.uint64), np.frombuffer(channels, np.uint16), np.frombuffer(logged, np.uint64)
        )


class McapWriter:
    """A file, from its beginning to ``finish``. Messages go either one by one, or in chunks.

    :param chunk: bytes of a chunk before compression; 0: no chunks.
    :param span_ns: a chunk has only messages that were logged within so long after its first one; None: any.
    :param index: with an index of every message, for readers that jump; it takes 16 bytes for each.
    """

    def __init__(
        self,
        file: Output,
        profile: str,
        library: str,
        *,
        chunk: int = 0,
        span_ns: int | None = None,
        index: bool = False,
    ) -> None:
        self._file = file
        self._chunk = chunk
        self._span_ns = span_ns
        self._index = index
        self._schemas: list[bytes] = []
        self._channels: list[bytes] = []
        self._groups: dict[int, list[bytes]] = {}
        self._counts: dict[int, int] = {}  # of messages, by channel
        self._first: int | None = None
        self._last = 0
        self._chunk_count = 0
        self._open: list[Packed] = []  # of the chunk that is not written yet
        self._open_size = 0
        self._new: list[bytes] = []  # schemas and channels that it begins with
        self._compress = zstandard.ZstdCompressor(level=3).compress
        self._compress_small = zstandard.ZstdCompressor(level=12).compress
        file.write(MAGIC + record(HEADER, string(profile) + string(library)))

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Add a schema; return its number."""
        number = len(self._schemas) + 1
        body = struct.pack("<H", number) + string(name) + string(encoding) + struct.pack("<I", len(data)) + data
        self._define(self._schemas, record(SCHEMA, body))
        return number

    def add_channel(self, topic: str, encoding: str, schema: int) -> int:
        """Add a channel. ``schema``: 0: it has none.

        :returns: its number.
        """
        number = len(self._channels) + 1
        body = struct.pack("<HH", number, schema) + string(topic) + string(encoding) + strings({})
        self._define(self._channels, record(CHANNEL, body))
        return number

    def _define(self, all_of_them: list[bytes], found: bytes) -> None:
        all_of_them.append(found)
        if self._chunk:
            self._new.append(found)
        else:
            self._file.write(found)

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        at, written = self._file.tell(), record(METADATA, string(name) + strings(values))
        self._file.write(written)
        self._note(METADATA_INDEX, struct.pack("<QQ", at, len(written)) + string(name))

    def add_attachment(self, at_ns: int, name: str, media_type: str, data: bytes) -> None:
        at = self._file.tell()
        body = (
            struct.pack("<QQ", at_ns, at_ns) + string(name) + string(media_type) + struct.pack("<Q", len(data)) + data
        )
        written = record(ATTACHMENT, body + struct.pack("<I", zlib.crc32(body)))
        self._file.write(written)
        entry = struct.pack("<QQQQQ", at, len(written), at_ns, at_ns, len(data)) + string(name) + string(media_type)
        self._note(ATTACHMENT_INDEX, entry)

    def add_message(self, channel: int, logged: int, data: bytes, published: int) -> None:
        """Add one message, not in a chunk."""
        self._file.write(_MESSAGE.pack(MESSAGE, 22 + len(data), channel, 0, logged, published) + data)
        self._counts[channel] = self._counts.get(channel, 0) + 1
        self._first = logged if self._first is None or logged < self._first else self._first
        self._last = max(self._last, logged)

    def add_records(self, packed: Packed) -> None:
        """Add many records, for chunks."""
        if not len(packed.places):
            return
        numbers, counts = np.unique(packed.channels, return_counts=True)
        for number, count in zip(numbers.tolist(), counts.tolist(), strict=True):
            self._counts[number] = self._counts.get(number, 0) + count
        first = int(packed.logged.min())
        self._first = first if self._first is None else min(self._first, first)
        self._last = max(self._last, int(packed.logged.max()))
        begin = 0
        while begin < len(packed.places):
            room = max(self._chunk - self._open_size, 0)
            start = int(packed.places[begin])
            end = int(np.searchsorted(packed.places, start + room, "right"))  # the record that crosses the bound, too
            end = min(end, begin + self._within(packed.logged[begin:end]))
            if end == begin:
                self._write_chunk()
                continue
            stop = len(packed.data) if end >= len(packed.places) else int(packed.places[end])
            piece = packed.data[start:stop]
            places = packed.places[begin:end] - np.uint64(start)
            self._open.append(Packed(piece, places, packed.channels[begin:end], packed.logged[begin:end]))
            self._open_size += len(piece)
            begin = end
            if self._open_size >= self._chunk:
                self._write_chunk()

    def _within(self, logged: NDArray[np.uint64]) -> int:
        """Return how many of them belong to the open chunk by their time, which begins with its first one."""
        if self._span_ns is None:
            return len(logged)
        first = self._open[0].logged[0] if self._open else logged[0]
        is_far = np.maximum(logged, first) - np.minimum(logged, first) >= np.uint64(self._span_ns)
        return int(is_far.argmax()) if is_far.any() else len(logged)

    def finish(self) -> None:
        """Write the end of the file."""
        self._write_chunk()
        self._file.write(record(DATA_END, bytes(4)))
        counts = b"".join(struct.pack("<HQ", *each) for each in sorted(self._counts.items()))
        statistics = struct.pack(
            "<QHIIIIQQI",
            sum(self._counts.values()),
            len(self._schemas),
            len(self._channels),
            len(self._groups.get(ATTACHMENT_INDEX, ())),
            len(self._groups.get(METADATA_INDEX, ())),
            self._chunk_count,
            self._first or 0,
            self._last,
            len(counts),
        )
        groups = {SCHEMA: self._schemas, CHANNEL: self._channels, STATISTICS: [record(STATISTICS, statistics + counts)]}
        self._file.write(ending({**groups, **self._groups}, self._file.tell()))

    def _note(self, opcode: int, entry: bytes) -> None:
        self._groups.setdefault(opcode, []).append(record(opcode, entry))

    def _write_chunk(self) -> None:
        if not self._open and not self._new:
            return
        parts, self._open, self._open_size = self._open, [], 0
        head, self._new = b"".join(self._new), []
        data = head + b"".join(part.data for part in parts)
        packed = self._compress_small(data) if len(data) < _SMALL else self._compress(data)
        logged = np.concatenate([part.logged for part in parts]) if parts else np.zeros(0, np.uint64)
        first, last = (int(logged.min()), int(logged.max())) if len(logged) else (0, 0)
        at = self._file.tell()
        body = struct.pack("<QQQI", first, last, len(data), zlib.crc32(data)) + string(_COMPRESSION)
        self._file.write(HEAD.pack(CHUNK, len(body) + 8 + len(packed)) + body + struct.pack("<Q", len(packed)) + packed)
        self._chunk_count += 1
        if self._index:
            behind = self._file.tell()
            offsets, length = self._write_index(parts, len(head), logged)
            entry = struct.pack("<QQQQ", first, last, at, behind - at) + struct.pack("<I", len(offsets)) + offsets
            sizes = struct.pack("<QQ", len(packed), len(data))
            self._note(CHUNK_INDEX, entry + struct.pack("<Q", length) + string(_COMPRESSION) + sizes)

    def _write_index(self, parts: list[Packed], begin: int, logged: NDArray[np.uint64]) -> tuple[bytes, int]:
        """Return the position of each channel's index in the file, and the size of all of them."""
        places = []
        for part in parts:
            places.append(part.places + np.uint64(begin))
            begin += len(part.data)
        if not parts:
            return b"", 0
        channels = np.concatenate([part.channels for part in parts])
        entries = np.stack([logged, np.concatenate(places)], axis=1)
        offsets, length = b"", 0
        for number in np.unique(channels).tolist():
            rows = entries[channels == number].tobytes()
            offsets += struct.pack("<HQ", number, self._file.tell())
            written = record(MESSAGE_INDEX, struct.pack("<HI", number, len(rows)) + rows)
            self._file.write(written)
            length += len(written)
        return offsets, length


def record(opcode: int, body: bytes) -> bytes:
    return HEAD.pack(opcode, len(body)) + body


def string(value: str) -> bytes:
    data = value.encode()
    return struct.pack("<I", len(data)) + data


def strings(values: Mapping[str, str]) -> bytes:
    data = b"".join(string(key) + string(value) for key, value in values.items())
    return struct.pack("<I", len(data)) + data


def ending(groups: Mapping[int, list[bytes]], begin: int) -> bytes:
    """Return the summary section that begins at this place of the file, the footer, and the file's last bytes.

    :param groups: records by their opcode.
    """
    records, offsets = b"", b""
    for opcode, group in groups.items():
        if group:
            place = struct.pack("<BQQ", opcode, begin + len(records), sum(map(len, group)))
            offsets += record(SUMMARY_OFFSET, place)
            records += b"".join(group)
    footer = HEAD.pack(FOOTER, 20) + struct.pack("<QQ", begin, begin + len(records))
    crc = zlib.crc32(records + offsets + footer)
    return records + offsets + footer + struct.pack("<I", crc) + MAGIC
