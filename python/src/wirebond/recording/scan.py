"""Reading the records of an MCAP file that may be unfinished, cut short or damaged. Every length is checked before it
is believed; what cannot be read is said, and what can be read is given."""

from __future__ import annotations

import contextlib
import mmap
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np
import zstandard
from numpy.typing import NDArray

from wirebond import _engine
from wirebond.errors import WirebondError
from wirebond.recording import layout

MAGIC = b"\x89MCAP0\r\n"
_MOST_CHUNK = 1 << 28  # bytes of a chunk without compression; files of others have some MiB
_HEAD = 9  # of a record: opcode and length
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 1, 2, 3, 4, 5, 6
_ATTACHMENT, _METADATA, _DATA_END = 9, 12, 15
_LAST_OPCODE = 15


@dataclass(frozen=True)
class Run:
    """Messages that lie behind each other. ``logged`` and ``published`` are nanoseconds."""

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
    """What the records say, messages left out.

    :ivar problems: sentences: what was cut off or damaged.
    :ivar is_finished: the file has its end.
    :ivar is_chunked: its messages lie in chunks.
    """

    library: str = ""
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    notes: list[dict[str, str]] = field(default_factory=list)
    attachments: dict[str, bytes] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    is_finished: bool = False
    is_chunked: bool = False


class DamagedError(Exception):
    """A record that is not what its length says."""


class Scan:
    """One pass over a file: ``runs`` gives the messages in the order of the file and fills ``contents`` meanwhile.

    :raises WirebondError: it is no MCAP file.
    :raises OSError: it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.contents = Contents()
        with path.open("rb") as file:
            self.size = file.seek(0, 2)
            begin = b"" if self.size == 0 else mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        self._data: Any = begin
        if begin[: len(MAGIC)] != MAGIC:
            what = "is empty" if not self.size else "is no MCAP file, and a recording is one"
            raise WirebondError(f"{path} {what}; name a file that `wirebond record` has written")

    def close(self) -> None:
        if isinstance(self._data, mmap.mmap):
            with contextlib.suppress(BufferError):  # a run of it lives on; it goes with that
                self._data.close()

    def runs(self, progress: Callable[[int, int], object] | None = None) -> Iterator[Run]:
        data, size, at = self._data, self.size, len(MAGIC)
        while True:
            if progress is not None:
                progress(min(at, size), size)
            if at == size or at + _HEAD > size:
                self._cut(at)
                return
            opcode, length = data[at], struct.unpack_from("<Q", data, at + 1)[0]
            if opcode == _MESSAGE:
                behind, run = _messages(data, at, size)
                if run is None:
                    self._cut(at)
                    return
                yield run
                at = behind
                continue
            if opcode == 0 or _LAST_OPCODE < opcode < 0x80 or length > size - at - _HEAD:
                self._cut(at)
                return
            begin, at = at + _HEAD, at + _HEAD + length
            if opcode == _DATA_END:
                self.contents.is_finished = data[size - len(MAGIC) : size] == MAGIC and size > at
                if not self.contents.is_finished:
                    self._problem("its index is cut short")
                return
            try:
                if opcode == _CHUNK:
                    yield from self._chunk(begin, at)
                else:
                    self._record(opcode, data, begin, at)
            except (DamagedError, struct.error, UnicodeDecodeError, IndexError) as error:
                self._problem(f"the record at byte {begin - _HEAD} is damaged ({error}), and was left out")

    def _cut(self, at: int) -> None:
        behind = self.size - at
        what = f"the {behind} bytes behind that are lost" if behind else "nothing behind that is known"
        self._problem(f"it ends without its end: the last whole record ends at byte {at}, {what}")

    def _problem(self, sentence: str) -> None:
        if len(self.contents.problems) < 100:  # a file of nothing but damage
            self.contents.problems.append(sentence)

    def _record(self, opcode: int, data: Any, begin: int, end: int) -> None:
        contents = self.contents
        reader = _Reader(data, begin, end)
        if opcode == _HEADER:
            reader.text()
            contents.library = reader.text()
        elif opcode == _CHANNEL:
            number, _schema = reader.number("<H"), reader.number("<H")
            contents.channels[number] = Channel(reader.text(), reader.text())
        elif opcode == _METADATA:
            name = reader.text()
            values = _Reader(reader.block(reader.number("<I")), 0).texts()
            if name == layout.NOTE:
                contents.notes.append(values)
            else:
                contents.metadata[name] = values
        elif opcode == _ATTACHMENT:
            reader.number("<Q"), reader.number("<Q")
            name, _media = reader.text(), reader.text()
            contents.attachments[name] = reader.block(reader.number("<Q"))
            crc = reader.number("<I")
            if crc and zlib.crc32(data[begin : end - 4]) != crc:
                raise DamagedError(f"the checksum of {name!r} is wrong")

    def _chunk(self, begin: int, end: int) -> Iterator[Run]:
        self.contents.is_chunked = True
        reader = _Reader(self._data, begin, end)
        reader.number("<Q"), reader.number("<Q")
        size, crc = reader.number("<Q"), reader.number("<I")
        compression = reader.text()
        packed = reader.block(reader.number("<Q"))
        if size > _MOST_CHUNK:
            raise DamagedError(f"a chunk of {size} bytes")
        data = _unpacked(compression, packed, size)
        if crc and zlib.crc32(data) != crc:
            raise DamagedError("the checksum of a chunk is wrong")
        at = 0
        while at + _HEAD <= len(data):
            opcode, length = data[at], struct.unpack_from("<Q", data, at + 1)[0]
            if opcode == _MESSAGE:
                at, run = _messages(data, at, len(data))
                if run is None:
                    raise DamagedError("a message of a chunk is cut short")
                yield run
                continue
            if length > len(data) - at - _HEAD:
                raise DamagedError("a record of a chunk is cut short")
            self._record(opcode, data, at + _HEAD, at + _HEAD + length)
            at += _HEAD + length


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
            raise DamagedError("it is shorter than it says")
        found = bytes(self._data[self._at : self._at + size])
        self._at += size
        return found

    def text(self) -> str:
        return self.block(self.number("<I")).decode()

    def texts(self) -> dict[str, str]:
        found = {}
        while self._at < self._end:
            key = self.text()
            found[key] = self.text()
        return found


def _messages(data: Any, at: int, end: int) -> tuple[int, Run | None]:
    """The messages from ``at`` on; None: the first one is not whole."""
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
    """Never more than ``size`` bytes, whatever the compressed ones say."""
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
        raise DamagedError("a chunk is not as large as it says")
    return data


def _zstd(packed: bytes, size: int) -> bytes:
    with zstandard.ZstdDecompressor(max_window_size=1 << 27).stream_reader(packed) as stream:
        return stream.read(size + 1)
