"""Closing a recording: chunks of a second, compressed, with the decoded messages, which replace the file.

The new file is written beside the old one and takes its name at the end: whoever stops this finds the old one whole.
A recording has no index of its chunks. Readers in other languages find no message in a chunk whose messages are not
indexed one by one, and that takes 16 bytes for each, uncompressed: more than the messages of a rover take. Without it
they read the file from its beginning. An exported file has the whole index.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from wirebond import _engine
from wirebond.codec import Message
from wirebond.errors import WirebondError
from wirebond.protocol.model.forms import header_fields
from wirebond.recording import layout
from wirebond.recording.locking import lock
from wirebond.recording.mcap_file import McapWriter, Packed
from wirebond.recording.pieces import Pieces
from wirebond.recording.reading import SENDERS, Found, Reading
from wirebond.recording.recording import Recording
from wirebond.recording.whole import whole_file
from wirebond.recording.writer import LIBRARY

_Columns = tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]
Progress = Callable[[int, int], object]
CHUNK = 1 << 20  # bytes before compression, at most
SPAN_NS = 10**9  # of one chunk: so much is lost where a bit of it flips


def close_recording(path: Path, *, progress: Progress | None = None) -> None:
    """Rewrite a finished or unfinished recording. The file's metadata say what was cut off or damaged.

    :raises WirebondError: it is not a recording; it is being recorded.
    :raises OSError: it cannot be written; the file is as it was.
    """
    with path.open("rb") as file:
        if not lock(file.fileno()):
            raise WirebondError(f"{path} is being recorded; stop the recording first")
        write_mcap(Recording(path), path, progress=progress)


def write_mcap(
    recording: Recording,
    out: Path,
    *,
    raw: bool = True,
    message: str | None = None,
    new: bool = False,
    progress: Progress | None = None,
) -> None:
    """Write a whole MCAP file of a recording at ``out``, or nothing.

    :param raw: with the raw bytes, events and the protocol file; False: decoded messages alone.
    :param message: only this one, of decoded messages; None: all.
    :param new: nothing may exist at ``out``.
    """
    with whole_file(out, new=new) as file:
        _Rewriting(recording, file, raw, message).run(progress)


class _Rewriting:
    def __init__(self, recording: Recording, file: IO[bytes], raw: bool, message: str | None) -> None:
        self._recording = recording
        self._wanted = message
        self._raw = raw
        self._has_header = bool(header_fields(recording.codec.model.format.parts))
        self._topics: tuple[dict[str, int], ...] = tuple({} for _ in SENDERS)  # channels of messages by their names
        self._writer = writer = McapWriter(file, layout.PROFILE, LIBRARY, chunk=CHUNK, span_ns=SPAN_NS, index=not raw)
        about = dict(recording._about) or {"version": layout.VERSION}
        if recording.problems:
            about["repaired"] = "; ".join(recording.problems)[:4096]
        self._about = layout.with_checksum(about)
        self._add_about()
        if raw:
            schema = writer.add_schema("wirebond.Event", "jsonschema", layout.event_schema())
            received, sent = (writer.add_channel(topic, layout.RAW, 0) for topic in (layout.RECEIVED, layout.SENT))
            events = writer.add_channel(layout.EVENTS, "json", schema)
            self._channels = np.array([received, sent, events], np.uint16)
            for note in recording._notes:
                writer.add_metadata(layout.NOTE, note)

    def run(self, progress: Progress | None) -> None:
        reading = Reading(self._recording, None)
        for pieces in self._recording._pieces.passes(progress):
            self._add(pieces, reading.take(pieces))
        last = self._recording._ns(np.array([self._recording.duration]))
        self._add_decoded(Found.of((0, end, message) for end, message in reading.finish()), last)
        if self._raw:
            self._add_about()  # again: without it nothing could be read, wherever a bit flips
        self._writer.finish()

    def _add_about(self) -> None:
        self._writer.add_metadata(layout.METADATA, self._about)
        if self._recording.protocol_text:
            text = self._recording.protocol_text.encode()
            self._writer.add_attachment(self._recording._start_ns, layout.PROTOCOL_FILE, layout.MEDIA_TYPE, text)

    def _add(self, pieces: Pieces, found: Found) -> None:
        at = self._recording._ns(pieces.times)
        if not self._raw:
            self._add_decoded(found, at)
            return
        run, rows = pieces.run, pieces.rows
        before = self._recording._ns(pieces.before)
        raw = (self._channels[pieces.kinds], at, before, run.places[rows], run.sizes[rows])
        self._pack(run.data, raw, found, at)

    def _add_decoded(self, found: Found, at: NDArray[np.uint64]) -> None:
        nothing = np.zeros(0, np.uint64)
        none = (nothing.astype(np.uint16), nothing, nothing, nothing, nothing.astype(np.uint32))
        self._pack(b"", none, found, at)

    def _pack(self, data: object, raw: _Columns, found: Found, at: NDArray[np.uint64]) -> None:
        """Pack pieces. ``at``: when each piece was done, after which its messages follow."""
        behind, channels, times, payloads = [], [], [], []
        for index, sender, message in zip(found.behind.tolist(), found.senders.tolist(), found.messages, strict=True):
            name = message.name
            if self._wanted in (None, name):
                behind.append(index)
                channels.append(self._topics[sender].get(name) or self._new_channel(message, sender))
                times.append(message.t)
                payloads.append(layout.message_json(message, self._has_header))
        places = np.array(behind, np.uint32)
        decoded = (places, np.array(channels, np.uint16), at[places], self._recording._ns(np.array(times, np.float64)))
        self._writer.add_records(Packed.of(*_engine.packed_records(data, raw, decoded, payloads)))

    def _new_channel(self, message: Message, sender: int) -> int:
        topic = layout.topic_of(message, SENDERS[sender])
        schema = layout.message_schema(self._recording.codec, message.name)
        number = self._writer.add_channel(topic, "json", self._writer.add_schema(topic, "jsonschema", schema))
        self._topics[sender][message.name] = number
        return number
