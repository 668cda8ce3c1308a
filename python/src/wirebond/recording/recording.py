"""A recording that is read: its raw chunks, its messages as an iterator or as columns, its events."""

from __future__ import annotations

import json
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
from wirebond.link.tap import Chunk, LinkEvent
from wirebond.protocol import loads
from wirebond.protocol.model import End
from wirebond.protocol.plan import told_by_request
from wirebond.recording import layout
from wirebond.recording.notes import Note, notes_from
from wirebond.recording.scan import Contents, Run, Scan

if TYPE_CHECKING:
    import threading
    from collections.abc import Sequence

    from wirebond.link import Link

Progress = Callable[[int, int], object]
_KINDS = ("received", "sent", "event")


@dataclass(frozen=True)
class _Direction:
    """All reads, or all writes: their bytes, and where each one ends."""

    data: bytes
    ends: NDArray[np.uint64]
    times: NDArray[np.float64]  # seconds since the start when each one was done
    before: NDArray[np.float64]  # when each one began; they do not fall

    def chunk(self, index: int, direction: str) -> Chunk:
        begin = int(self.ends[index - 1]) if index else 0
        data = self.data[begin : int(self.ends[index])]
        return Chunk(float(self.times[index]), float(self.before[index]), direction, data)


@dataclass(frozen=True)
class Reads:
    """The bytes of one end, as the engine decodes them.

    :ivar ends: where each read ends in ``data``.
    :ivar times: when each began.
    :ivar breaks: the port was away before the read of each of these indices.
    :ivar expected: before the read of this index, the message of this index was asked for; None: not known.
    """

    data: bytes
    ends: NDArray[np.uint64]
    times: NDArray[np.float64]
    breaks: list[int]
    expected: list[tuple[int, int]] | None


class Recording:
    """What ``wirebond record`` wrote, read whole when first asked for. Times are seconds since its start. It does not
    change; any thread may use it.

    :param path: of the file. One that was cut short or damaged is read as far as it goes; ``problems`` says what is
        lost.
    :param protocol: a protocol file, or a codec, to decode with in the place of the recording's own.
    :param progress: called as ``progress(done, size)``, in bytes of the file, while it is read.
    :ivar path: of the file.
    :ivar codec: the protocol.
    :ivar is_finished: False: it was not closed, or was cut short.
    :ivar problems: what is lost, as sentences; empty where nothing is.
    :raises WirebondError: it is no recording, or its protocol file is missing.
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
        scan = Scan(self.path)
        self.size = scan.size
        collected = _Collected(scan.contents)
        for run in scan.runs(progress):
            collected.add(run)
        scan.close()
        contents = scan.contents
        self.is_finished = contents.is_finished
        self.is_closed = contents.is_finished and contents.is_chunked
        self.problems = tuple(contents.problems)
        self._about = contents.metadata.get(layout.METADATA, {})
        self._notes = contents.notes
        topics = {channel.topic for channel in contents.channels.values()}
        if not self._about and layout.RECEIVED not in topics:
            raise WirebondError(
                f"{self.path} is an MCAP file of another program ({contents.library or 'it does not say which'}): it "
                "has no raw bytes of a link; name a file that `wirebond record` has written"
            )
        self.protocol_text = contents.attachments.get(layout.PROTOCOL_FILE, b"").decode(errors="replace")
        self.codec = self._codec(protocol)
        self._start_ns = self._number("started_ns", collected.first_ns)
        self._directions = {name: collected.direction(kind, self._start_ns) for kind, name in enumerate(_KINDS[:2])}
        self._kinds = collected.kinds()
        self._events_raw = collected.events
        self.events: tuple[LinkEvent, ...] = tuple(self._read_events())

    def _codec(self, protocol: str | os.PathLike[str] | Codec | None) -> Codec:
        if isinstance(protocol, Codec):
            return protocol
        if protocol is not None:
            return load(protocol)
        if not self.protocol_text:
            raise WirebondError(
                f"{self.path} has no protocol file in it; say which one it is of: `--protocol FILE`, or in Python "
                "protocol='FILE'"
            )
        try:
            return Codec(loads(self.protocol_text, f"{self.path}:{layout.PROTOCOL_FILE}"))
        except ProtocolFileError as error:
            raise ProtocolFileError(error.problems) from None

    def _number(self, name: str, default: int) -> int:
        text = self._about.get(name, "")
        return int(text) if text.isdecimal() and len(text) < 20 else default

    # ---- what it says of itself

    @property
    def role(self) -> str:
        """The end that the link played: ``"host"`` or ``"mcu"``."""
        return End(self._about["role"]) if self._about.get("role") in (End.HOST, End.MCU) else End.HOST

    @property
    def started(self) -> datetime:
        """When it began, by the wall clock of the computer that recorded it; UTC."""
        return datetime.fromtimestamp(min(self._start_ns, 32503680000 * 10**9) / 1e9, UTC)

    @property
    def protocol_hash(self) -> str:
        """The hash of the protocol that it was recorded with, 16 hex digits; empty where the file does not say it."""
        return self._about.get("hash", "")

    @property
    def repaired(self) -> str:
        """What was lost before the file was closed, as sentences; empty where nothing was."""
        return self._about.get("repaired", "")

    @property
    def notes(self) -> tuple[Note, ...]:
        """What persons wrote about it."""
        return notes_from(self._notes)

    @property
    def port(self) -> str:
        """The port that was recorded."""
        return self._about.get("port", "")

    @property
    def duration(self) -> float:
        """Seconds from the start to the last byte or event."""
        last = [float(d.times.max()) for d in self._directions.values() if len(d.times)]
        return max([*last, *(event.t for event in self.events[-1:])], default=0.0)

    @property
    def idle(self) -> float:
        """Seconds of silence that ended an incomplete frame: the protocol's, and what the adapter may hold back."""
        try:
            latency = float(self._about.get("adapter_latency", "0"))
        except ValueError:
            latency = 0.0
        return self.codec.model.idle_seconds + (latency if 0 <= latency <= 1 else 0.0)

    # ---- raw

    def raw(self, direction: str) -> bytes:
        """All bytes of one direction, without times.

        :param direction: ``"received"`` or ``"sent"``.
        :returns: the bytes.
        :raises UsageError: another direction.
        """
        return self._of(direction).data

    def chunks(self, direction: str | None = None) -> Iterator[Chunk]:
        """Every read and every write, in the order of the recording.

        :param direction: ``"received"`` or ``"sent"``; None: both.
        :returns: an iterator of them.
        :raises UsageError: another direction.
        """
        wanted = (0, 1) if direction is None else (_KINDS.index(self._direction(direction)),)
        counts = [0, 0]
        for kind in self._kinds[self._kinds < 2].tolist():
            index, counts[kind] = counts[kind], counts[kind] + 1
            if kind in wanted:
                yield self._directions[_KINDS[kind]].chunk(index, _KINDS[kind])

    # ---- decoded

    def __iter__(self) -> Iterator[Message]:
        """All messages of both ends."""
        return self.messages()

    def messages(self, sender: str | None = None) -> Iterator[Message]:
        """Messages in the order in which they came, as a link gives them. ``message.t`` is when the read began that
        completed it, or when it was written.

        :param sender: whose: ``"mcu"`` or ``"host"``; None: both.
        :returns: an iterator of them.
        :raises UsageError: another sender.
        """
        for _, message in self.messages_of(sender):
            yield message

    def messages_of(self, sender: str | None = None) -> Iterator[tuple[str, Message]]:
        """The same, each with the end that sent it.

        :param sender: as for ``messages``.
        :returns: an iterator of end and message.
        :raises UsageError: another sender.
        """
        for _, end, message in self.walk(sender):
            if message is not None:
                yield end, message

    def walk(self, sender: str | None = None) -> Iterator[tuple[Chunk | LinkEvent, str, Message | None]]:
        """Every piece of the recording, once with None, and then once for each message that it completed.

        :param sender: as for ``messages``.
        :returns: an iterator of piece, end that sent it, and message.
        :raises UsageError: another sender.
        """
        if sender is not None:
            self._direction_of(sender)
        reading = _Reading(self, sender)
        counts = [0, 0, 0]
        for kind in self._kinds.tolist():
            index, counts[kind] = counts[kind], counts[kind] + 1
            if kind == 2:
                event = self._event_at(index)
                if event is None:
                    continue
                yield event, "", None
                yield from ((event, end, m) for end, m in (reading.finish() if event.kind == "port_down" else ()))
                continue
            name = _KINDS[kind]
            chunk = self._directions[name].chunk(index, name)
            end = self._sender_of(name)
            yield chunk, end, None
            yield from ((chunk, end, m) for m in reading.feed(chunk, end))
        last = LinkEvent(self.duration, "end")
        yield from ((last, end, m) for end, m in reading.finish())

    def columns(self, sender: str = "mcu", *, progress: Progress | None = None) -> Columns:
        """All messages of one end at once, without a Python object for each: as ``Codec.decode_columns``, and each
        table has ``t``, the time of each row.

        :param sender: whose: ``"mcu"`` or ``"host"``.
        :param progress: called as ``progress(done, size)`` in bytes.
        :returns: a table for each message that occurred.
        :raises UsageError: another sender.
        """
        of = self.reads(sender)
        reads: dict[str, Any] = {
            "ends": of.ends,
            "times": of.times,
            "idle": self.idle,
            "breaks": of.breaks,
            "expected": of.expected,
        }
        codec = self.codec
        form = codec._format_for(End(sender))
        result = _engine.decode_timed_columns(codec._table, form, of.data, reads, progress)
        tables = {name: Table(**table) for name, table in result["messages"].items()}
        return Columns(tables, stats_from(result["stats"]))

    def reads(self, sender: str) -> Reads:
        """All bytes of one end, with the times at which they came.

        :param sender: whose: ``"mcu"`` or ``"host"``.
        :returns: what ``columns`` decodes.
        :raises UsageError: another sender.
        """
        direction = self._direction_of(sender)
        data = self._directions[direction]
        return Reads(data.data, data.ends, data.before, self._breaks(direction), self._expected(sender))

    def stats(self, sender: str = "mcu") -> Stats:
        """Where every byte of this end went.

        :param sender: whose: ``"mcu"`` or ``"host"``.
        :returns: the account at the end of the recording.
        :raises UsageError: another sender.
        """
        return self.columns(sender).stats

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
        """Let it happen again, in the calling thread. A link that reads a recording is opened with the port
        ``replay:run.mcap``.

        :param into: called with each chunk, whose times count from ``start``; or a link, which sends again what its end
            sent, message by message.
        :param speed: 1: as it happened; 2: twice as fast; 0: as fast as possible.
        :param start: from here on, in seconds since the start of the recording.
        :param stop: up to here; None: to its end.
        :param loop: again and again.
        :param direction: ``"received"`` or ``"sent"``; None: both.
        :param ends: ends it when it is set, from another thread.
        :returns: how many chunks there were.
        :raises UsageError: no such speed or section.
        """
        from wirebond.recording.replay import Section, replay  # noqa: PLC0415 it needs this module

        return replay(self, into, Section(speed, start, stop, loop), direction, ends)

    # ---- inside

    def _direction(self, direction: str) -> str:
        if direction not in self._directions:
            raise UsageError(f"direction is {direction!r}; expected 'received' or 'sent'")
        return direction

    def _of(self, direction: str) -> _Direction:
        return self._directions[self._direction(direction)]

    def _sender_of(self, direction: str) -> End:
        return End(self.role) if direction == "sent" else other(End(self.role))

    def _direction_of(self, sender: str) -> str:
        if sender not in (End.HOST, End.MCU):
            raise UsageError(f"sender is {sender!r}; expected 'mcu' or 'host'")
        return "sent" if sender == self.role else "received"

    def _breaks(self, direction: str) -> list[int]:
        """The port was away before the read of each of these indices."""
        places = np.flatnonzero(self._kinds == 2)
        counts = np.cumsum(self._kinds == _KINDS.index(direction))
        found = []
        for index, place in enumerate(places.tolist()):
            event = self._event_at(index)
            if event is not None and event.kind == "port_down":
                found.append(int(counts[place]))
        return sorted(set(found))

    def _expected(self, sender: str) -> list[tuple[int, int]]:
        """Where only the request tells what a reply is: before which read which reply was asked for."""
        codec = self.codec
        if not told_by_request(codec.model.messages, End(sender)):
            return []
        replies = {m.name: m.reply for m in codec.model.messages if m.reply is not None}
        asking = self._directions[self._direction_of(other(End(sender)))]
        reads = self._directions[self._direction_of(sender)].before
        found = []
        decoder = self._decoder(other(End(sender)))
        for index in range(len(asking.ends)):
            chunk = asking.chunk(index, "")
            for message in decoder.feed(chunk.bytes, chunk.before):
                if (reply := replies.get(message.name)) is not None:
                    place = int(np.searchsorted(reads, chunk.before))
                    found.append((place, codec._index_of(reply)))
        return found

    def _decoder(self, sender: End) -> Decoder:
        codec = self.codec
        return Decoder(_engine.Decoder(codec._table, codec._format_for(sender), self.idle), codec, sender)

    def _read_events(self) -> Iterator[LinkEvent]:
        for index in range(len(self._events_raw)):
            event = self._event_at(index)
            if event is not None:
                yield event

    def _event_at(self, index: int) -> LinkEvent | None:
        t_ns, data = self._events_raw[index]
        try:
            values = json.loads(data)
            values.pop("t", None)
            return LinkEvent(max(0, t_ns - self._start_ns) / 1e9, str(values.pop("kind")), values)
        except (ValueError, KeyError, AttributeError, RecursionError):
            return None  # damaged

    def __repr__(self) -> str:
        return f"<wirebond.Recording {self.path.name} of {self.codec.name}: {self.duration:.1f} s>"


class _Reading:
    """Both directions of a recording, decoded as a link did."""

    def __init__(self, recording: Recording, sender: str | None) -> None:
        self._codec = recording.codec
        self._wanted = {End.HOST, End.MCU} if sender is None else {End(sender)}
        messages = self._codec.model.messages
        self._told = {end for end in (End.HOST, End.MCU) if told_by_request(messages, end)}
        self._asks = {m.name for m in messages if m.reply is not None}
        needed = self._wanted | {other(end) for end in self._told & self._wanted}
        self._decoders = {end: recording._decoder(end) for end in needed}

    def feed(self, chunk: Chunk, end: str) -> Sequence[Message]:
        decoder = self._decoders.get(End(end))
        if decoder is None:
            return ()
        found = decoder.idle(chunk.before) + decoder.feed(chunk.bytes, chunk.before)
        answered = other(End(end))
        if answered in self._told and answered in self._decoders:
            for message in found:
                if message.name in self._asks:
                    self._decoders[answered].expect(message.name)
        return found if end in self._wanted else ()

    def finish(self) -> Iterator[tuple[str, Message]]:
        for end, decoder in self._decoders.items():
            found = decoder.finish()
            if end in self._wanted:
                yield from ((end, message) for message in found)


class _Collected:
    """What the runs of a file bring, put together by channel."""

    def __init__(self, contents: Contents) -> None:
        self._contents = contents
        self._parts: list[list[Any]] = [[], []]  # by direction: bytes, sizes, logged, published
        self._kinds: list[NDArray[np.uint8]] = []
        self.events: list[tuple[int, bytes]] = []
        self.first_ns = 0

    def add(self, run: Run) -> None:
        kinds = {layout.RECEIVED: 0, layout.SENT: 1, layout.EVENTS: 2}
        table = np.full(1 << 16, 255, np.uint8)
        for number, channel in self._contents.channels.items():
            table[number] = kinds.get(channel.topic, 255)
        of = table[run.channels]
        if not self.first_ns and (of < 3).any():
            self.first_ns = int(run.logged[of < 3][0])
        for kind in (0, 1):
            mine = of == kind
            if not mine.any():
                continue
            sizes = run.sizes[mine]
            data = _engine.gathered(run.data, run.places[mine], sizes)
            self._parts[kind].append((data, sizes, run.logged[mine], run.published[mine]))
        for index in np.flatnonzero(of == 2).tolist():
            self.events.append((int(run.logged[index]), run.payload(index)))
        self._kinds.append(of[of < 3])

    def kinds(self) -> NDArray[np.uint8]:
        """The order of all pieces: 0 received, 1 sent, 2 event."""
        return np.concatenate(self._kinds) if self._kinds else np.zeros(0, np.uint8)

    def direction(self, kind: int, start_ns: int) -> _Direction:
        parts = self._parts[kind]
        if not parts:
            return _Direction(b"", np.zeros(0, np.uint64), np.zeros(0), np.zeros(0))
        data, sizes, logged, published = zip(*parts, strict=True)
        ends = np.cumsum(np.concatenate(sizes), dtype=np.uint64)
        return _Direction(b"".join(data), ends, _seconds(logged, start_ns), _rising(_seconds(published, start_ns)))


def _seconds(nanoseconds: Sequence[NDArray[np.uint64]], start_ns: int) -> NDArray[np.float64]:
    """Never before the start: a damaged time is no reason to stop."""
    whole = np.concatenate(nanoseconds)
    later = np.where(whole > start_ns, whole - np.uint64(start_ns), np.uint64(0))
    return np.minimum(later, np.uint64(10**18)).astype(np.float64) / 1e9


def _rising(times: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.maximum.accumulate(times) if len(times) else times


def open_recording(path: str | os.PathLike[str], protocol: str | os.PathLike[str] | Codec | None = None) -> Recording:
    """Read a recording.

    :param path: of the file.
    :param protocol: a corrected protocol file, or a codec, to decode with; None: the recording's own.
    :raises WirebondError: it is no recording, or its protocol file is missing or cannot be used.
    :raises OSError: it cannot be read.
    """
    return Recording(path, protocol)
