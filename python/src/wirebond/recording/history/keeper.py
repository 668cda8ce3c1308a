"""Feeds a source from a live link, in a thread of its own: the link never waits for it."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

from wirebond.link.ends import other
from wirebond.link.tap import LinkEvent
from wirebond.protocol.model import End
from wirebond.recording.history.history import MOST_BYTES
from wirebond.recording.history.source import ENDS, Source

if TYPE_CHECKING:
    from wirebond.link import Link

_EVERY = 0.02  # seconds between two turns
_QUIET = 0.1  # seconds: a read that began so long ago is in the tap


class Keeper:
    """Begins at once; ends with ``close``.

    :ivar source: what it feeds.
    :ivar lost: pieces that had no room in the tap.
    """

    def __init__(self, link: Link, most: int = MOST_BYTES) -> None:
        role = End(link.role)
        idle = link.codec.model.idle_seconds + link.adapter_latency
        self.source = Source(link.codec, role, idle, most=most)
        self.lost = 0
        self._tap = link.tap()
        self._directions = {"sent": role, "received": other(role)}
        self._fed = dict.fromkeys(ENDS, 0.0)  # when the newest bytes of each end came
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run, name="history of a link", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop keeping; the kept values stay. A second call does nothing."""
        self._ends.set()
        self._thread.join(5.0)

    def _run(self) -> None:
        try:
            while not self._ends.wait(_EVERY):
                self._step()
        finally:
            self._tap.close()

    def _step(self) -> None:
        now = time.monotonic()
        taken = self._tap.take_raw()
        self.lost += taken.lost_pieces
        chunks: dict[End, list[bytes]] = {end: [] for end in ENDS}
        times: dict[End, list[float]] = {end: [] for end in ENDS}
        breaks: list[tuple[int, int]] = []  # how many reads of each end came before
        events: list[LinkEvent] = []
        for kind, before, _, data in (pieces := taken.pieces):
            end = self._directions.get(kind)
            if end is not None:
                chunks[end].append(data)
                times[end].append(before * 1e-6)
            elif kind == "port_down":
                breaks.append((len(chunks[ENDS[0]]), len(chunks[ENDS[1]])))
        events = [self._tap.event(piece) for piece in pieces if piece[0] not in self._directions]
        for place, end in enumerate(ENDS):
            if chunks[end] or breaks:
                self.source.feed(end, chunks[end], times[end], [b[place] for b in breaks])
                self._fed[end] = now
            elif self._fed[end] and now - self._fed[end] > _QUIET:
                self.source.idle(end, now - _QUIET)
                self._fed[end] = 0.0
        for event in events:
            self.source.happened(event)
        self.source.look(now - _QUIET)
