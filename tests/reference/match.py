"""The slow decoder's way to a frame's message: every number that a message names is read, and compared."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import lru_cache

from wirebond.protocol.model import BitRole, ByteOrder, End, Match, MatchOf, Message, Part, PartKind, Protocol


@dataclass(frozen=True)
class Seen:
    """What is known of a frame: ``payload`` is None before it is there."""

    id: int | None
    numbers: dict[str, int] = field(default_factory=dict)  # of the header, as bits
    size: int = 0
    payload: bytes | None = None
    trims_zeros: bool = False


def is_late(protocol: Protocol, sender: End | None) -> bool:
    """Does a message of this sender look at anything that does not stand before the payload?"""
    before = []
    for part in protocol.format.parts:
        if part.kind == PartKind.PAYLOAD:
            break
        before += [part.name, "magic" if part.kind == PartKind.MAGIC else "", *(run.name for run in part.bits)]
    matches = [match for message in protocol.messages if message.sent_by(sender) for match in message.match]
    return any(m.of == MatchOf.PAYLOAD or (m.of == MatchOf.HEADER and m.name not in before) for m in matches)


def find(protocol: Protocol, seen: Seen, sender: End | None) -> Message | None:
    return next((m for m in protocol.messages if m.sent_by(sender) and _is(m, seen)), None)


def _is(message: Message, seen: Seen) -> bool:
    if message.has_id != (seen.id is not None):
        return False
    if message.has_id and not any(match.of == MatchOf.ID for match in message.match) and seen.id != message.id:
        return False
    return all(_has(match, seen) for match in message.match)


def _has(match: Match, seen: Seen) -> bool:
    number: int | None
    if match.of == MatchOf.ID:
        number = seen.id
    elif match.of == MatchOf.SIZE:
        number = seen.size
    elif match.of == MatchOf.HEADER:
        number = seen.numbers.get(match.name)
    else:
        number = _in_payload(match, seen)
    return number is not None and any(low <= number & match.mask <= high for low, high in match.ranges)


def _in_payload(match: Match, seen: Seen) -> int | None:
    place = match.place
    assert place is not None
    if seen.payload is None:
        return None
    piece = seen.payload[place.at : place.at + place.bytes]
    if len(piece) < place.bytes and not seen.trims_zeros:
        return None
    piece = piece.ljust(place.bytes, b"\0")
    return int.from_bytes(piece, "big" if place.order == ByteOrder.BIG else "little") >> place.shift & place.mask


def share_frames(one: Message, other: Message) -> bool:
    """Can a frame be both messages?"""
    if one.has_id != other.has_id:
        return False
    if not one.match and not other.match:
        return one.id == other.id
    mine, theirs = _sets(one), _sets(other)
    return all(_meet(mine[key], theirs[key]) for key in mine.keys() & theirs.keys())


def _sets(message: Message) -> dict[object, Match]:
    found: dict[object, Match] = {}
    if message.has_id:
        found["id"] = Match(MatchOf.ID, ((message.id, message.id),), 32, 2**32 - 1)
    for match in message.match:
        found["id" if match.of == MatchOf.ID else match.place or (match.of, match.name)] = match
    return found


@lru_cache(maxsize=4096)
def _meet(one: Match, other: Match) -> bool:
    """Is there a number that both allow? One exists whose bits above 16 are those of a bound."""
    if one.mask == other.mask:
        return any(a <= d and c <= b for a, b in one.ranges for c, d in other.ranges)
    bounds = {bound for match in (one, other) for pair in match.ranges for bound in pair}
    low = min(one.width, 16)
    bases = {bound >> low << low for bound in bounds} | {(bound | 1 << 31) >> low << low for bound in bounds}
    return any(one.holds(base | bits) and other.holds(base | bits) for base in bases for bits in range(1 << low))


def header_numbers(parts: Iterable[Part], data: bytes, payload_size: int) -> dict[str, int]:
    """Every number of the header, as bits, by name."""
    found: dict[str, int] = {}
    at = 0
    for part in parts:
        size = payload_size if part.kind == PartKind.PAYLOAD else part.size
        order = "big" if part.kind == PartKind.MAGIC or part.order == ByteOrder.BIG else "little"
        number = int.from_bytes(data[at : at + size], "big" if order == "big" else "little")
        at += size
        if part.kind in (PartKind.FIELD, PartKind.MAGIC):
            found["magic" if part.kind == PartKind.MAGIC else part.name] = number
        for run in part.bits:
            if run.role == BitRole.FIELD:
                found[run.name] = number >> run.shift & run.mask
    return found
