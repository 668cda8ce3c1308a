"""Reading the records of an MCAP file that may be unfinished, cut short or damaged. Every length is checked before it
is believed; what cannot be read is said, and what can be read is given."""

from __future__ import annotations

import contextlib
import struct
import zlib
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field
from typing import Any

import lz4.frame
import numpy as np
import zstandard
from numpy.typing import NDArray

from wirebond import _engine
from wirebond.errors import WirebondError
from wirebond.recording import layout
from wirebond.recording.mcap_file import (
    ATTACHMENT,
    CHANNEL,
    CHUNK,
    DATA_END,
    HEAD,
    HEADER,
    MAGIC,
    MESSAGE,
    METADATA,
)
from wirebond.recording.searching import MOST_RECORD as _MOST_RECORD
from wirebond.recording.searching import Search, Source, Summary, read_summary

_MOST_CHUNK = 1 << 28  # bytes of a chunk without compression; files of others have some MiB
_KNOWN = (HEADER, CHANNEL, METADATA, ATTACHMENT)  # the content of these records gives their length
_WINDOW = 1 << 18  # bytes that are read at once


@dataclass(frozen=True)
class Run:
    """Messages that follow each other. ``logged`` and ``published`` are nanoseconds."""

    data: Any  # a buffer
    channels: NDArray[np.uint16]
    logged: NDArray[np.uint64]
    published: NDArray[np.uint64]
    places: NDArray[np.uint64]
    sizes: NDArray[np.uint32]

    def payload(self, index: int) -> bytes:
        at = int(self.places[index])
        return bytes(self.data[at : at + int(self.sizes[index])])


@dataclass(frozen=True)
class Channel:
    topic: str
    encoding: str


@dataclass
class Contents:
    """The content of the records, without messages.

    :ivar problems: sentences: what was cut off or damaged.
    :ivar is_finished: the file has its end.
    :ivar is_chunked: its messages are in chunks.
    """

    library: str = ""
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    notes: list[dict[str, str]] = field(default_factory=list)
    attachments: dict[str, bytes] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    is_finished: bool = False
    is_chunked: bool = False


class ShorterError(Exception):
    """The file has become shorter while it was read."""


class DamagedError(Exception):
    """A record that is not what its length says."""


class _Window:
    """The bytes of a source around the place that is looked at."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self.begin = 0
        self.data = b""

    def load(self, at: int, size: int) -> int:
        """Load ``size`` bytes from ``at`` on; return where they begin in ``data``.

        :raises ShorterError: the file has become shorter.
        """
        if not self.begin <= at <= at + size <= self.begin + len(self.data):
            self.data = self._source.read(at, max(size, min(_WINDOW, self._source.size - at)))
            self.begin = at
            if len(self.data) < size:
                raise ShorterError
        return at - self.begin


class Scan:
    """One pass over a file: ``runs`` gives the messages in the order of the file and fills ``contents`` on the way. It
    has some MiB of the file in memory at a time.

    :raises WirebondError: it is not an MCAP file.
    :raises OSError: it cannot be read.
    """

    def __init__(self, source: Source) -> None:
        self.contents = Contents()
        self.size = source.size
        self._source = source
        self._window = _Window(source)
        self._search = Search(source)
        self._chunks = 0  # that were seen, damaged ones too
        if source.read(0, len(MAGIC)) != MAGIC:
            if not self._search.leads_on(len(MAGIC)):
                what = "is not an MCAP file, and a recording is one" if self.size else "is empty"
                raise WirebondError(
                    f"{source.path} {what}; name a file that `wirebond record` has written, or name the protocol of a "
                    "raw capture: `--protocol FILE`, or in Python protocol='FILE'"
                )
            self._problem("its first bytes are damaged")
        self._summary = read_summary(source)
        if self._summary is not None:
            self._take_summary(self._summary)

    def _take_summary(self, summary: Summary) -> None:
        """Use the summary at the end of the file, in case its beginning is damaged."""
        for opcode, body in summary.channels:
            self._record(opcode, body, 0, len(body))
        for at, length in summary.abouts:
            if HEAD.size < length <= _MOST_RECORD and at + length <= self.size:
                body = self._source.read(at, length)[HEAD.size :]
                with contextlib.suppress(DamagedError, struct.error, UnicodeDecodeError):  # the pass reports it
                    self._record(METADATA, body, 0, len(body))

    def runs(self, progress: Callable[[int, int], object] | None = None) -> Iterator[Run]:
        at = len(MAGIC)
        try:
            while True:
                behind = yield from self._next(at)
                if behind is None:
                    return
                at = behind
                if progress is not None:
                    progress(at, self.size)
        except ShorterError:
            self._cut(at)

    def _next(self, at: int) -> Generator[Run, None, int | None]:
        """Yield the messages of a record, or of many that are messages; where the next one begins. None: the end."""
        window = self._window
        if not self._search.is_head(at):
            return self._resume(at, at)
        place = window.load(at, HEAD.size)
        opcode, length = HEAD.unpack_from(window.data, place)
        behind: int = at + HEAD.size + length
        if opcode == DATA_END and length == 4:
            self._end(behind)
            return None
        if length > _MOST_RECORD:
            if not self._search.is_next(behind):
                return self._resume(at, at + 1)
            self._problem(f"the record at byte {at} has {length} bytes, which no recording has, and was left out")
            return behind
        place = window.load(at, behind - at)
        if opcode == MESSAGE:
            stop, run = _messages(window.data, place, len(window.data))
            if run is None:
                return self._resume(at, at + 1)
            yield run
            return window.begin + stop
        begin, end = place + HEAD.size, place + behind - at
        try:
            if opcode == CHUNK:
                self._chunks += 1
                yield from self._chunk(window.data, begin, end)
            elif opcode in _KNOWN:
                self._record(opcode, window.data, begin, end)
            elif not self._search.is_next(behind):
                raise DamagedError("its length is wrong")
        except (DamagedError, struct.error, UnicodeDecodeError, IndexError) as error:
            if not self._search.is_next(behind):  # its length is damaged
                return self._resume(at, at + 1)
            self._problem(f"the record at byte {at} is damaged ({error}), and was left out")
        return behind

    def _end(self, behind: int) -> None:
        size = self.size
        self.contents.is_finished = self._source.read(size - len(MAGIC), len(MAGIC)) == MAGIC and size > behind
        if not self.contents.is_finished:
            self._problem("its index is cut short")
        elif self._summary is not None and self._summary.chunk_count > self._chunks and not self.contents.problems:
            self._problem(f"{self._summary.chunk_count - self._chunks} of its chunks cannot be found")

    def _resume(self, at: int, begin: int) -> int | None:
        """Return the position of the next intact record from ``begin`` on, or None."""
        found = self._search.next_from(begin)
        if found is None:
            self._cut(at)
        else:
            self._problem(f"the {found - at} bytes from byte {at} on are damaged, and were left out")
        return found

    def _cut(self, at: int) -> None:
        behind = self.size - at
        what = f"the {behind} bytes after that are lost" if behind else "nothing after that is known"
        self._problem(f"it ends without its end: the last whole record ends at byte {at}, {what}")

    def _problem(self, sentence: str) -> None:
        if len(self.contents.problems) < 100:  # a file of nothing but damage
            self.contents.problems.append(sentence)

    def _record(self, opcode: int, data: Any, begin: int, end: int) -> None:
        contents = self.contents
        reader = _Reader(data, begin, end)
        if opcode == HEADER:
            reader.text()
            contents.library = reader.text()
            reader.end()
        elif opcode == CHANNEL:
            number, _schema = reader.number("<H"), reader.number("<H")
            channel = Channel(reader.text(), reader.text())
            reader.block(reader.number("<I"))
            reader.end()
            contents.channels[number] = channel
        elif opcode == METADATA:
            name = reader.text()
            values = _Reader(reader.block(reader.number("<I")), 0).texts()
            reader.end()
            if name == layout.NOTE:
                contents.notes.append(values)
            elif not layout.is_intact(values):
                raise DamagedError(f"the checksum of {name!r} is wrong")
            elif layout.CHECKSUM in values or layout.CHECKSUM not in contents.metadata.get(name, {}):
                contents.metadata[name] = values
        elif opcode == ATTACHMENT:
            reader.number("<Q"), reader.number("<Q")
            name, _media = reader.text(), reader.text()
            attached = reader.block(reader.number("<Q"))
            crc = reader.number("<I")
            reader.end()
            if crc and zlib.crc32(data[begin : end - 4]) != crc:
                raise DamagedError(f"the checksum of {name!r} is wrong")
            contents.attachments[name] = attached

    def _chunk(self, found: bytes, begin: int, end: int) -> Iterator[Run]:
        self.contents.is_chunked = True
        reader = _Reader(found, begin, end)
        reader.number("<Q"), reader.number("<Q")
        size, crc = reader.number("<Q"), reader.number("<I")
        compression = reader.text()
        packed = reader.block(reader.number("<Q"))
        reader.end()
        if size > _MOST_CHUNK:
            raise DamagedError(f"a chunk of {size} bytes")
        data = _unpacked(compression, packed, size)
        if crc and zlib.crc32(data) != crc:
            raise DamagedError("the checksum of a chunk is wrong")
        at = 0
        while at + HEAD.size <= len(data):
            opcode, length = data[at], struct.unpack_from("<Q", data, at + 1)[0]
            if opcode == MESSAGE:
                at, run = _messages(data, at, len(data))
                if run is None:
                    raise DamagedError("a message of a chunk is cut short")
                yield run
                continue
            if length > len(data) - at - HEAD.size:
                raise DamagedError("a record of a chunk is cut short")
            self._record(opcode, data, at + HEAD.size, at + HEAD.size + length)
            at += HEAD.size + length


class _Reader:
    """Values of one record, within its bounds."""

    def __init__(self, data: Any, at: int, end: int | None = None) -> None:
        self._data = data
        self._at = at
        self._end = len(data) if end is None else end

    def number(self, form: str) -> int:
        size = struct.calcsize(form)
        return int(struct.unpack(form, self.block(size))[0])

    def block(self, size: int) -> bytes:
        if size > self._end - self._at:
            raise DamagedError("it is shorter than its header says")
        found = bytes(self._data[self._at : self._at + size])
        self._at += size
        return found

    def end(self) -> None:
        """Note that the record ends here."""
        if self._at != self._end:
            raise DamagedError("it is longer than its header says")

    def text(self) -> str:
        return self.block(self.number("<I")).decode()

    def texts(self) -> dict[str, str]:
        found = {}
        while self._at < self._end:
            key = self.text()
            found[key] = self.text()
        return found


def _messages(data: Any, at: int, end: int) -> tuple[int, Run | None]:
    """Return the messages from ``at`` on; None: the first one is not whole."""
    behind, channels, logged, published, places, sizes = _engine.message_records(data, at, end)
    if behind == at:
        return at, None
    return behind, Run(
        data,
        np.frombuffer(channels, np.uint16),
        np.frombuffer(logged, np.uint64),
        np.frombuffer(published, np.uint64),
        np.frombuffer(places, np.uint64),
        np.frombuffer(sizes, np.uint32),
    )


def _unpacked(compression: str, packed: bytes, size: int) -> bytes:
    """Unpack at most ``size`` bytes, whatever the compressed ones say."""
    try:
        if compression == "zstd":
            data = _zstd(packed, size)
        elif compression == "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(packed, size + 1)
        elif compression == "":
            data = packed
        else:
            raise DamagedError(f"the compression {compression!r} is not known")
    except (zstandard.ZstdError, RuntimeError, ValueError, EOFError) as error:
        raise DamagedError(f"a chunk cannot be unpacked: {error}") from None
    if len(data) != size:
        raise DamagedError("a chunk's size is not that of its header")
    return data


def _zstd(packed: bytes, size: int) -> bytes:
    with zstandard.ZstdDecompressor(max_window_size=1 << 27).stream_reader(packed) as stream:
        return stream.read(size + 1)
