"""Describes a recording without its messages: when, how long, of which protocol, and its notes."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from wirebond.errors import WirebondError
from wirebond.recording import layout
from wirebond.recording.notes import Note, notes_from
from wirebond.recording.scan import DamagedError, Run, Scan
from wirebond.recording.searching import Source


@dataclass(frozen=True)
class Glance:
    """Times in seconds.

    :ivar started: since 1970.
    :ivar is_closed: False: it was not closed, or was cut short.
    """

    started: float
    seconds: float
    size: int
    protocol: str
    hash: str
    notes: tuple[Note, ...]
    is_closed: bool


def glance(path: Path) -> Glance:
    """Read a recording's ends. Chunks are not unpacked. A file without chunks is read to its end.

    :raises WirebondError: it is not a recording.
    :raises OSError: it cannot be read.
    """
    source = Source(path)
    try:
        scan = _Ends(source)
        first, last = 0, 0
        for run in scan.runs():
            first = first or int(run.logged[0])
            last = max(last, int(run.logged.max()))
    finally:
        source.close()
    contents = scan.contents
    about = contents.metadata.get(layout.METADATA)
    if about is None:
        raise WirebondError(f"{path} is not a recording; name a file that `wirebond record` has written")
    text = about.get("started_ns", "")
    started = int(text) if text.isdecimal() and len(text) < 20 else first
    return Glance(
        started=started / 1e9,
        seconds=max(0, max(last, scan.last) - started) / 1e9,
        size=scan.size,
        protocol=about.get("protocol", ""),
        hash=about.get("hash", ""),
        notes=notes_from(contents.notes),
        is_closed=contents.is_finished and contents.is_chunked,
    )


class _Ends(Scan):
    """Reads only the time of the newest message in a chunk."""

    def __init__(self, source: Source) -> None:
        super().__init__(source)
        self.last = 0  # nanoseconds

    def _chunk(self, found: bytes, begin: int, end: int) -> Iterator[Run]:
        self.contents.is_chunked = True
        if end - begin < 16:
            raise DamagedError("it is shorter than its header says")
        self.last = max(self.last, *struct.unpack_from("<QQ", found, begin))
        yield from ()
