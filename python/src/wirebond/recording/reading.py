"""Decoding both directions of a recording as its link did, piece by piece or many at once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from wirebond.codec import Message, Stats
from wirebond.link.ends import other
from wirebond.protocol.model import End
from wirebond.protocol.planning import told_by_request
from wirebond.recording.pieces import KINDS, Pieces

if TYPE_CHECKING:
    from wirebond.recording.recording import Recording

SENDERS = (str(End.HOST), str(End.MCU))


@dataclass(frozen=True)
class Found:
    """Messages in their order, in lists side by side: an object for each would cost as much as decoding it.

    :ivar behind: the index of the piece that completed each.
    :ivar senders: the end that sent each: an index of ``SENDERS``.
    """

    behind: NDArray[np.uint32]
    senders: NDArray[np.uint8]
    messages: list[Message]

    @staticmethod
    def joined(parts: Sequence[Found]) -> Found:
        """Join by the pieces; those after the same piece in the order of ``parts``."""
        if len(parts) == 1:
            return parts[0]
        behind = np.concatenate([_NO_PLACES, *(part.behind for part in parts)])
        senders = np.concatenate([_NO_SENDERS, *(part.senders for part in parts)])
        messages = [message for part in parts for message in part.messages]
        order = np.argsort(behind, kind="stable")
        return Found(behind[order], senders[order], [messages[index] for index in order.tolist()])

    @staticmethod
    def of(found: Iterable[tuple[int, str, Message]]) -> Found:
        """Return the result for some of them."""
        rows = list(found)
        return Found(
            np.array([row[0] for row in rows], np.uint32),
            np.array([SENDERS.index(row[1]) for row in rows], np.uint8),
            [row[2] for row in rows],
        )


_NO_PLACES, _NO_SENDERS = np.zeros(0, np.uint32), np.zeros(0, np.uint8)


class Reading:
    """Reads from the first piece to the last. One thread at a time.

    :param sender: whose messages are wanted; None: of both ends.
    :param keep: False: messages are only counted.
    """

    def __init__(self, recording: Recording, sender: str | None, *, keep: bool = True) -> None:
        self._keep = keep
        self._wanted = {End.HOST, End.MCU} if sender is None else {End(sender)}
        messages = recording.codec.model.messages
        self._told = {end for end in (End.HOST, End.MCU) if told_by_request(messages, end)}
        self._asks = {m.name for m in messages if m.reply is not None}
        needed = self._wanted | {other(end) for end in self._told & self._wanted}
        self._decoders = {end: recording._decoder(end) for end in needed}
        self._ends = [recording._sender_of(KINDS[kind]) for kind in (0, 1)]
        self._is_told = bool(self._told & self._wanted)

    def take(self, pieces: Pieces) -> Found:
        """Return the messages that these complete."""
        found: list[Found] = []
        begin = 0
        for index in np.flatnonzero(pieces.kinds == 2).tolist():
            event = pieces.event(index)
            if event is not None and event.kind == "port_down":
                found += self._between(pieces, begin, index)
                found.append(Found.of((index, end, message) for end, message in self.finish()))
                begin = index
        found += self._between(pieces, begin, len(pieces))
        return Found.joined(found)

    def _between(self, pieces: Pieces, begin: int, end: int) -> list[Found]:
        part = pieces if (begin, end) == (0, len(pieces)) else pieces.part(begin, end)
        return [Found.of(self._one_by_one(part, begin))] if self._is_told else list(self._many(part, begin))

    def _many(self, pieces: Pieces, begin: int) -> Iterator[Found]:
        for kind, end in enumerate(self._ends):
            decoder = self._decoders.get(end)
            mine = np.flatnonzero(pieces.kinds == kind)
            if decoder is None or not len(mine):
                continue
            rows, run = pieces.rows[mine], pieces.run
            places, sizes = run.places[rows], run.sizes[rows]
            messages, reads = decoder.engine.feed_reads(run.data, places, sizes, pieces.before[mine], self._keep)
            behind = (mine[np.frombuffer(reads, np.uint32)] + begin).astype(np.uint32)
            yield Found(behind, np.full(len(messages), SENDERS.index(end), np.uint8), messages)

    def _one_by_one(self, pieces: Pieces, begin: int) -> Iterator[tuple[int, str, Message]]:
        """Yield messages one by one, if only the request identifies a reply."""
        for index in np.flatnonzero(pieces.kinds < 2).tolist():
            end = self._ends[pieces.kinds[index]]
            decoder = self._decoders.get(end)
            if decoder is None:
                continue
            chunk = pieces.chunk(index)
            found = decoder.idle(chunk.before) + decoder.feed(chunk.bytes, chunk.before)
            answered = other(end)
            if answered in self._told and answered in self._decoders:
                for message in found:
                    if message.name in self._asks:
                        self._decoders[answered].expect(message.name)
            if end in self._wanted and self._keep:
                yield from ((begin + index, str(end), message) for message in found)

    def finish(self) -> Iterator[tuple[str, Message]]:
        """Settle what is pending."""
        for end, decoder in self._decoders.items():
            found = decoder.finish()
            if end in self._wanted and self._keep:
                yield from ((str(end), message) for message in found)

    def end_stats(self, sender: End) -> Stats:
        """Return the account after the last piece."""
        list(self.finish())
        return self._decoders[sender].stats
