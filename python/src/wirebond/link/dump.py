"""The last bytes of a link, decoded again: frames, and discarded bytes with their causes. To examine a fault."""

from __future__ import annotations

import bisect
import itertools
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from wirebond.codec import Codec, Message
from wirebond.protocol.model import End
from wirebond.protocol.planning import plan_for, told_by_request


@dataclass(frozen=True)
class DumpEntry:
    """A frame, a run of other bytes, or what the port did.

    :ivar t: seconds on the clock of ``time.monotonic()``: when the read that completed it, or the write, was done; of
        discarded bytes when the first of them came.
    :ivar direction: ``received`` or ``sent``; ``port`` for what the port did.
    :ivar kind: ``frame``; ``discarded``, ``fill`` or ``pending``, as in the account; ``up``,
        ``down``, ``collision`` or ``settings`` of the port.
    :ivar bytes: as they were on the wire.
    :ivar message: of a frame.
    :ivar causes: of discarded bytes: how many for each cause. Bytes between two frames have an entry for each read that
        brought some of them; the first of these entries has the causes of all.
    """

    t: float
    direction: str
    kind: str
    bytes: bytes = b""
    message: Message | None = None
    causes: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class Piece:
    """A read, a write, or an event of the port: ``received``, ``sent``, ``port_up``, ``port_down``, ``port_collision``
    or ``port_settings``, which another program had changed."""

    t: float
    kind: str
    bytes: bytes


class Dump:
    """A copy of the last bytes of a link, from ``Link.dump``. It does not change.

    :ivar codec: the link's protocol.
    :ivar t: when it was taken, in seconds on the clock of ``time.monotonic()``.
    :ivar pieces: every read and write that is still kept, in their order.
    :ivar dropped_bytes: older bytes, whose room was needed. So the first frame may lack its beginning.
    :ivar role: the end that the link played.
    :ivar other_protocols: whose frames the line carries as well; here they are discarded bytes.
    """

    def __init__(
        self,
        codec: Codec,
        t: float,
        pieces: Sequence[Piece],
        dropped_bytes: int,
        role: End = End.HOST,
        other_protocols: Sequence[Codec] = (),
    ) -> None:
        self.role = role
        self.other_protocols = tuple(other_protocols)
        self.codec = codec
        self.t = t
        self.pieces = tuple(pieces)
        self.dropped_bytes = dropped_bytes

    def with_pieces(self, pieces: Sequence[Piece], dropped_bytes: int) -> Dump:
        """Return the same link with other bytes.

        :param pieces: reads and writes in their order, as in ``pieces``.
        :param dropped_bytes: older bytes that are not in ``pieces``.
        :returns: another dump; this one does not change.
        """
        return Dump(self.codec, self.t, pieces, dropped_bytes, self.role, self.other_protocols)

    @property
    def received(self) -> bytes:
        """The received bytes, without times."""
        return b"".join(piece.bytes for piece in self.pieces if piece.kind == "received")

    @property
    def sent(self) -> bytes:
        """The sent bytes, without times."""
        return b"".join(piece.bytes for piece in self.pieces if piece.kind == "sent")

    @cached_property
    def entries(self) -> list[DumpEntry]:
        """Everything in the order of time. Worked out when first asked for: for a million bytes a second, on a bad
        line some seconds."""
        asked: list[tuple[float, str]] = []
        found = []
        of_host, of_mcu = ("sent", "received") if self.role == End.HOST else ("received", "sent")
        for session in self._sessions():
            questions = list(_read(self.codec, [p for p in session if p.kind == of_host], End.HOST, []))
            asked += [(e.t, e.message.name) for e in questions if e.message is not None]
            found += questions
            found += _read(self.codec, [p for p in session if p.kind == of_mcu], End.MCU, asked)
            found += [
                DumpEntry(p.t, "port", p.kind.removeprefix("port_")) for p in session if p.kind.startswith("port")
            ]
        return sorted(found, key=lambda entry: entry.t)

    def _sessions(self) -> Iterator[list[Piece]]:
        """Yield the pieces between two losses of the port: no frame continues after a loss."""
        session: list[Piece] = []
        for piece in self.pieces:
            session.append(piece)
            if piece.kind == "port_down":
                yield session
                session = []
        yield session

    def __repr__(self) -> str:
        return f"<wirebond.Dump of {self.codec.name}: {len(self.received)} bytes received, {len(self.sent)} sent>"


def _read(codec: Codec, pieces: list[Piece], sender: End, asked: Sequence[tuple[float, str]]) -> Iterator[DumpEntry]:
    """Yield entries. ``asked``: the host's requests with their times; if only the request identifies a reply, the last
    one does."""
    if not pieces:
        return
    ends = list(itertools.accumulate(len(piece.bytes) for piece in pieces))
    questions = []
    if told_by_request(codec.model.messages, sender):
        requests = {m.name for m in codec.model.messages if m.reply is not None}
        questions = [one for one in asked if one[1] in requests]
    reading = _Reading(codec, sender)
    for piece in pieces:
        while questions and questions[0][0] <= piece.t:
            reading.expect(questions.pop(0)[1])
        reading.feed(piece)
    plan = plan_for(codec.model, sender)
    delimiters = frozenset(plan.opening + plan.closing)
    stream = b"".join(piece.bytes for piece in pieces)

    def kind(start: int, stop: int) -> str:
        is_fill = not reading.causes[start] and delimiters.issuperset(stream[start:stop])
        return "fill" if is_fill else "discarded"

    at = 0
    for frame in reading.frames:
        yield from _run(pieces, ends, at, frame.offset, reading.causes[at], kind(at, frame.offset))
        yield DumpEntry(frame.t, pieces[0].kind, "frame", frame.raw, frame)
        at = frame.offset + len(frame.raw)
    yield from _run(pieces, ends, at, reading.settled, reading.causes[at], kind(at, reading.settled))
    yield from _run(pieces, ends, reading.settled, ends[-1], Counter(), "pending")


class _Reading:
    """Frames, and the causes of the bytes between two of them, by the offset where those begin.

    The account of a decoder has no places. So it is compared before and after each read. Where a read settles more than
    one run of bytes, a second decoder, which has seen the same, gets the bytes one by one.
    """

    def __init__(self, codec: Codec, sender: End) -> None:
        self.frames: list[Message] = []
        self.causes: defaultdict[int, Counter[str]] = defaultdict(Counter)
        self.settled = 0
        self._fast, self._exact = codec.decoder(sender), codec.decoder(sender)
        self._run = 0  # where the bytes after the last frame begin
        self._known: Counter[str] = Counter()

    def expect(self, request: str) -> None:
        self._fast.expect(request)
        self._exact.expect(request)

    def feed(self, piece: Piece) -> None:
        found = self._fast.idle(piece.t) + self._fast.feed(piece.bytes, piece.t)
        if self._fast.stats.discarded_bytes == dict(self._exact.stats.discarded_bytes) or not found:
            self._take(self._exact.idle(piece.t) + self._exact.feed(piece.bytes, piece.t))
            return
        self._take(self._exact.idle(piece.t))
        for at in range(len(piece.bytes)):
            self._take(self._exact.feed(piece.bytes[at : at + 1], piece.t))

    def _take(self, frames: list[Message]) -> None:
        stats = self._exact.stats
        causes = Counter({cause: count for cause, count in stats.discarded_bytes.items() if count})
        self.causes[self._run] += causes - self._known
        self._known = causes
        self.settled = stats.bytes - stats.pending_bytes
        for frame in frames:
            self.frames.append(frame)
            self._run = frame.offset + len(frame.raw)


def _slice(pieces: list[Piece], ends: list[int], start: int, stop: int) -> list[Piece]:
    """Return the bytes from ``start`` to ``stop``, as they came."""
    found = []
    while start < stop:
        index = bisect.bisect_right(ends, start)
        piece, end = pieces[index], min(ends[index], stop)
        begin = len(piece.bytes) - (ends[index] - start)
        found.append(Piece(piece.t, piece.kind, piece.bytes[begin : begin + end - start]))
        start = end
    return found


def _run(
    pieces: list[Piece], ends: list[int], start: int, stop: int, causes: Counter[str], kind: str
) -> Iterator[DumpEntry]:
    """Yield bytes of no frame: an entry for each read that brought some of them."""
    for piece in _slice(pieces, ends, start, stop):
        yield DumpEntry(piece.t, piece.kind, kind, piece.bytes, causes=dict(causes))
        causes = Counter()
