"""Reads a recording: its raw chunks, its messages as an iterator or as columns, its events."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from wirebond import _engine
from wirebond.codec import Codec, Columns, Decoder, Message, Stats, Table, load, stats_from
from wirebond.errors import ProtocolFileError, UsageError, WirebondError
from wirebond.link.ends import other
from wirebond.link.stamps import Stamper, has_stamps
from wirebond.link.tap import Chunk, LinkEvent
from wirebond.protocol import loads
from wirebond.protocol.model import End
from wirebond.protocol.planning import told_by_request
from wirebond.recording import layout
from wirebond.recording.capture import as_recording, is_capture
from wirebond.recording.notes import Note, notes_from
from wirebond.recording.pieces import KINDS, PieceFile
from wirebond.recording.reading import SENDERS, Reading
from wirebond.recording.stamps import RecordedClock

if TYPE_CHECKING:
    import threading

    from wirebond.link import Link

Progress = Callable[[int, int], object]


@dataclass(frozen=True)
class Reads:
    """The bytes of one end, as the engine decodes them.

    :ivar ends: where each read ends in ``data``.
    :ivar times: when each began.
    :ivar breaks: indices of the reads before which the port was away.
    :ivar expected: by index of a read, the index of the message that was requested before it; None: not known.
    """

    data: bytes
    ends: NDArray[np.uint64]
    times: NDArray[np.float64]
    breaks: list[int]
    expected: list[tuple[int, int]] | None


class Recording:
    """A file of ``wirebond record``, or a raw capture. Times are seconds since its start. It does not change, even if
    another file takes its name; any thread may use it. Iteration and ``stats`` keep some MiB of the file in memory at a
    time; ``raw`` and ``columns`` keep all that they return.

    :param path: of the file. One that was cut short or damaged is read as far as possible; ``problems`` says what is
        lost.
    :param protocol: a protocol file, or a codec, to decode with instead of the recording's own. A raw capture has none
        of its own: see `capture`.
    :param progress: called as ``progress(done, size)``, in bytes of the file, while it is read.
    :ivar path: of the file.
    :ivar codec: the protocol.
    :ivar is_finished: False: it was not closed, or was cut short.
    :ivar problems: what is lost, as sentences; empty if nothing is.
    :raises WirebondError: it is not a recording, or its protocol file is missing.
    :raises ProtocolFileError: the protocol file cannot be used.
    :raises OSError: it cannot be read.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        protocol: str | os.PathLike[str] | Codec | None = None,
        *,
        progress: Progress | None = None,
    ) -> None:
        self.path = Path(path)
        given = load(protocol) if protocol is not None and not isinstance(protocol, Codec) else protocol
        self._pieces, self.size = _read(self.path, given, progress)
        contents = self._pieces.contents
        self.is_finished = contents.is_finished
        self.is_closed = contents.is_finished and contents.is_chunked
        self._about = contents.metadata.get(layout.METADATA, {})
        self._notes = contents.notes
        topics = {channel.topic for channel in contents.channels.values()}
        if not self._about and layout.RECEIVED not in topics:
            raise WirebondError(
                f"{self.path} is an MCAP file of another program ({contents.library or 'it does not say which'}): it "
                "has no raw bytes of a link; name a file that `wirebond record` has written"
            )
        self.protocol_text = contents.attachments.get(layout.PROTOCOL_FILE, b"").decode(errors="replace")
        self.codec = given or self._own_codec()
        self.problems = (*contents.problems, *self._lacks())
        self._clock = (
            RecordedClock(self.codec, lambda end: self._decoded(end).tables) if has_stamps(self.codec) else None
        )
        self._start_ns = self._pieces.start_ns or self._pieces._start(0)
        self.events: tuple[LinkEvent, ...] = self._pieces.events

    def _own_codec(self) -> Codec:
        if not self.protocol_text:
            raise WirebondError(
                f"{self.path} has no protocol file in it; name its protocol: `--protocol FILE`, or in Python "
                "protocol='FILE'"
            )
        try:
            return Codec(loads(self.protocol_text, f"{self.path}:{layout.PROTOCOL_FILE}"))
        except ProtocolFileError as error:
            raise ProtocolFileError(error.problems) from None

    def _lacks(self) -> Iterator[str]:
        """Yield the facts that a raw capture lacks."""
        if self.is_capture and self.codec.model.format.ends_by_silence:
            yield (
                f"frames of {self.codec.name} end by silence, and a raw capture has no times, so they cannot be "
                "separated; record the line with `wirebond record`"
            )

    @property
    def role(self) -> str:
        """The end that the link played: ``"host"`` or ``"mcu"``."""
        return End(self._about["role"]) if self._about.get("role") in (End.HOST, End.MCU) else End.HOST

    @property
    def started(self) -> datetime:
        """The start of the recording, by the wall clock of the computer that recorded it; UTC."""
        return datetime.fromtimestamp(min(self._start_ns, 32503680000 * 10**9) / 1e9, UTC)

    @property
    def protocol_hash(self) -> str:
        """The hash of the protocol that it was recorded with, 16 hex digits; empty if the file does not have it."""
        return self._about.get("hash", "")

    @property
    def is_capture(self) -> bool:
        """Whether it is a raw capture: received or sent bytes, with times computed from the baud rate."""
        return layout.CAPTURE in self._about

    @property
    def repaired(self) -> str:
        """The losses before the file was closed, as sentences; empty if there were none."""
        return self._about.get("repaired", "")

    @property
    def notes(self) -> tuple[Note, ...]:
        """The notes that people wrote about it."""
        return notes_from(self._notes)

    @property
    def port(self) -> str:
        """The port that was recorded."""
        return self._about.get("port", "")

    @property
    def duration(self) -> float:
        """Seconds from the start to the last byte or event."""
        return max([self._pieces.last, *(event.t for event in self.events[-1:])])

    def wall_ns(self, t: float) -> int:
        """Convert a time to the wall clock of the computer that recorded it.

        :param t: seconds since the start, such as ``message.t``.
        :returns: nanoseconds since 1970, in whole microseconds.
        """
        return self._start_ns + round(t * 1e6) * 1000

    @property
    def idle(self) -> float:
        """Seconds of silence after which an incomplete frame was given up: the protocol's, and the adapter's
        latency."""
        try:
            latency = float(self._about.get("adapter_latency", "0"))
        except ValueError:
            latency = 0.0
        return self.codec.model.idle_seconds + (latency if 0 <= latency <= 1 else 0.0)

    # ---- raw

    def raw(self, direction: str) -> bytes:
        """Return all bytes of one direction, without times.

        :param direction: ``"received"`` or ``"sent"``.
        :returns: the bytes.
        :raises UsageError: another direction.
        """
        return self._pieces.direction(self._kind(direction)).data

    def chunks(self, direction: str | None = None) -> Iterator[Chunk]:
        """Yield every read and every write, in the order of the recording.

        :param direction: ``"received"`` or ``"sent"``; None: both.
        :returns: an iterator of them.
        :raises UsageError: another direction.
        """
        wanted = (0, 1) if direction is None else (self._kind(direction),)
        return self._chunks(wanted)

    def _chunks(self, wanted: tuple[int, ...]) -> Iterator[Chunk]:
        for pieces in self._pieces.passes():
            for index in np.flatnonzero(np.isin(pieces.kinds, wanted)).tolist():
                yield pieces.chunk(index)

    # ---- decoded

    def __iter__(self) -> Iterator[Message]:
        """Yield all messages of both ends."""
        return self.messages()

    def messages(self, sender: str | None = None) -> Iterator[Message]:
        """Yield messages in the order in which they came, as a link gives them. ``message.t`` is when the read began
        that completed it, or when it was written.

        :param sender: whose: ``"mcu"`` or ``"host"``; None: both.
        :returns: an iterator of them.
        :raises UsageError: another sender.
        """
        for _, message in self.messages_of(sender):
            yield message

    def messages_of(self, sender: str | None = None) -> Iterator[tuple[str, Message]]:
        """Yield messages as ``messages`` does, each with the end that sent it.

        :param sender: as for ``messages``.
        :returns: an iterator of end and message.
        :raises UsageError: another sender.
        """
        for _, end, message in self.walk(sender):
            if message is not None:
                yield end, message

    def walk(self, sender: str | None = None) -> Iterator[tuple[Chunk | LinkEvent, str, Message | None]]:
        """Yield every piece of the recording, once with None, and then once for each message that it completed.

        :param sender: as for ``messages``.
        :returns: an iterator of piece, end that sent it, and message.
        :raises UsageError: another sender.
        """
        if sender is not None:
            self.direction_of(sender)
        reading = Reading(self, sender)
        for pieces in self._pieces.passes():
            found = reading.take(pieces)
            behind, at = found.behind.tolist(), 0
            for index, kind in enumerate(pieces.kinds.tolist()):
                piece = pieces.event(index) if kind == 2 else pieces.chunk(index)
                if piece is None:
                    continue
                yield piece, "" if kind == 2 else self._sender_of(KINDS[kind]), None
                while at < len(behind) and behind[at] == index:
                    yield piece, SENDERS[found.senders[at]], found.messages[at]
                    at += 1
        last = LinkEvent(self.duration, "end")
        yield from ((last, end, m) for end, m in reading.finish())

    def columns(self, sender: str = "mcu", *, progress: Progress | None = None) -> Columns:
        """Decode all messages of one end at once, without a Python object for each, as ``Codec.decode_columns`` does.
        Each table has ``t``, the time of each row.

        :param sender: whose: ``"mcu"`` or ``"host"``.
        :param progress: called as ``progress(done, size)`` in bytes.
        :returns: a table for each message that occurred. Where it has a field with ``clock``, and the recording has
            exchanges of the clock service, it has ``stamp`` and ``stamp_error``.
        :raises UsageError: another sender.
        """
        found = self._decoded(sender, progress)
        return found if self._clock is None or sender != End.MCU else self._clock.stamped(found)

    def _decoded(self, sender: str, progress: Progress | None = None) -> Columns:
        of = self.reads(sender)
        reads: dict[str, Any] = {
            "ends": of.ends,
            "times": of.times,
            "idle": self.idle,
            "breaks": of.breaks,
            "expected": of.expected,
        }
        codec = self.codec
        form = codec.tables.format_for(End(sender))
        result = _engine.decode_timed_columns(codec.tables.protocol, form, of.data, reads, progress)
        tables = {name: Table(**table) for name, table in result["messages"].items()}
        return Columns(tables, stats_from(result["stats"]))

    def reads(self, sender: str) -> Reads:
        """Return all bytes of one end, with the times at which they came.

        :param sender: whose: ``"mcu"`` or ``"host"``.
        :returns: the bytes that ``columns`` decodes, with their times.
        :raises UsageError: another sender.
        """
        found = self._pieces.direction(self._kind(self.direction_of(sender)))
        return Reads(found.data, found.ends, found.before, found.breaks, self._expected(sender, found.before))

    def stats(self, sender: str = "mcu", *, progress: Progress | None = None) -> Stats:
        """Return the account of every byte of this end.

        :param sender: whose: ``"mcu"`` or ``"host"``.
        :param progress: called as ``progress(done, size)`` in bytes of the file.
        :returns: the account at the end of the recording.
        :raises UsageError: another sender.
        """
        self.direction_of(sender)
        reading = Reading(self, sender, keep=False)
        for pieces in self._pieces.passes(progress):
            reading.take(pieces)
        return reading.end_stats(End(sender))

    # ---- again

    def replay(
        self,
        into: Callable[[Chunk], object] | Link,
        *,
        speed: float = 1.0,
        start: float = 0.0,
        stop: float | None = None,
        loop: bool = False,
        direction: str | None = None,
        ends: threading.Event | None = None,
    ) -> int:
        """Play it back in the calling thread. To open a link that reads a recording, use the port ``replay:run.mcap``.

        :param into: called with each chunk, whose times count from ``start``; or a link, which sends the messages of
            its end again.
        :param speed: 1: as it happened; 2: twice as fast; 0: as fast as possible.
        :param start: where to begin, in seconds since the start of the recording.
        :param stop: where to end; None: at its end.
        :param loop: True: begin again at the end.
        :param direction: ``"received"`` or ``"sent"``; None: both.
        :param ends: an event; when another thread sets it, the playback ends.
        :returns: the number of chunks.
        :raises UsageError: no such speed or section.
        """
        from wirebond.recording.replay import Section, replay  # noqa: PLC0415 it needs this module

        return replay(self, into, Section(speed, start, stop, loop), direction, ends)

    # ---- inside

    def _kind(self, direction: str) -> int:
        if direction not in KINDS[:2]:
            raise UsageError(f"direction is {direction!r}; expected 'received' or 'sent'")
        return KINDS.index(direction)

    def _ns(self, times: NDArray[np.float64]) -> NDArray[np.uint64]:
        """Convert to nanoseconds since 1970, in whole microseconds as the link counts them."""
        return np.uint64(self._start_ns) + np.round(times * 1e6).astype(np.uint64) * np.uint64(1000)

    def _sender_of(self, direction: str) -> End:
        return End(self.role) if direction == "sent" else other(End(self.role))

    @property
    def byte_counts(self) -> dict[str, int]:
        """Bytes of each direction, ``"received"`` and ``"sent"``."""
        return dict(self._pieces.sizes)

    def direction_of(self, sender: str) -> str:
        """Find the direction in which an end sent, as the recorded link saw it.

        :param sender: ``"mcu"`` or ``"host"``.
        :returns: ``"received"`` or ``"sent"``.
        :raises UsageError: no such end.
        """
        if sender not in (End.HOST, End.MCU):
            raise UsageError(f"sender is {sender!r}; expected 'mcu' or 'host'")
        return "sent" if sender == self.role else "received"

    def _expected(self, sender: str, reads: NDArray[np.float64]) -> list[tuple[int, int]]:
        """If only the request identifies a reply: return before which read which reply was requested."""
        codec = self.codec
        if not told_by_request(codec.model.messages, End(sender)):
            return []
        replies = {m.name: m.reply for m in codec.model.messages if m.reply is not None}
        found = []
        decoder = self._decoder(other(End(sender)))
        for chunk in self.chunks(self.direction_of(other(End(sender)))):
            for message in decoder.feed(chunk.bytes, chunk.before):
                if (reply := replies.get(message.name)) is not None:
                    place = int(np.searchsorted(reads, chunk.before))
                    found.append((place, codec.tables.indices[reply]))
        return found

    def _decoder(self, sender: End) -> Decoder:
        codec = self.codec
        engine = _engine.Decoder(codec.tables.protocol, codec.tables.format_for(sender), self.idle)
        if self._clock is not None and sender == End.MCU:
            engine.set_stamper(Stamper(codec, self._clock))
        return Decoder(engine, codec, sender)

    def __repr__(self) -> str:
        return f"<wirebond.Recording {self.path.name} of {self.codec.name}: {self.duration:.1f} s>"


def _read(path: Path, codec: Codec | None, progress: Progress | None) -> tuple[PieceFile, int]:
    """Return the pieces of a recording or a raw capture, and the size of its file."""
    if codec is not None and is_capture(path):
        with as_recording(path, codec) as stored:
            return PieceFile(stored, progress), path.stat().st_size
    pieces = PieceFile(path, progress)
    return pieces, pieces.size


def open_recording(path: str | os.PathLike[str], protocol: str | os.PathLike[str] | Codec | None = None) -> Recording:
    """Read a recording, or a raw capture.

    :param path: of the file.
    :param protocol: a corrected protocol file, or a codec, to decode with; None: the recording's own. A raw capture
        needs it.
    :raises WirebondError: it is not a recording, or its protocol file is missing or cannot be used.
    :raises OSError: it cannot be read.
    """
    return Recording(path, protocol)
