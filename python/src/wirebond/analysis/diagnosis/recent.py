"""The last seconds of a dump, cut where no frame is cut."""

from __future__ import annotations

import itertools

from wirebond.link import Dump
from wirebond.link.dump import Piece

_STATES = ("port_up", "port_down")  # which last, other than momentary events
_QUESTIONS = 1.0  # seconds of sent bytes that are kept as well: replies may need their request


def recent(dump: Dump, seconds: float) -> Dump:
    """Return the bytes received and sent in the last seconds, with whole frames that began earlier. The last time at
    which the port came up is kept."""
    since = dump.t - seconds
    if not dump.pieces or dump.pieces[0].t >= since:
        return dump
    old = {"received": _size_before(dump, "received", since), "sent": _size_before(dump, "sent", since - _QUESTIONS)}
    dropped = dump.dropped_bytes + sum(old.values())
    pieces: list[Piece] = []
    for piece in dump.pieces:
        cut = min(len(piece.bytes), old.get(piece.kind, 0))
        if cut:
            old[piece.kind] -= cut
        if piece.kind == "received" and cut == len(piece.bytes):
            pieces.append(Piece(piece.t, "port_up", b""))  # it worked until here
        elif piece.bytes[cut:] or piece.kind in _STATES or (piece.kind not in old and piece.t >= since):
            pieces.append(Piece(piece.t, piece.kind, piece.bytes[cut:]))
    return dump.with_pieces(_without_old_ports(pieces), dropped)


def _size_before(dump: Dump, direction: str, t: float) -> int:
    return sum(
        len(e.bytes)
        for e in itertools.takewhile(lambda e: e.t < t, (e for e in dump.entries if e.direction == direction))
    )


def _without_old_ports(pieces: list[Piece]) -> list[Piece]:
    """Return the pieces, with only the last port event before the first byte."""
    first = next((at for at, piece in enumerate(pieces) if not piece.kind.startswith("port")), len(pieces))
    return pieces[max(0, first - 1) :]
