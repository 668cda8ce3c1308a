"""Derives the view of an end from intact frames: which are for another address, and how many are missing by their
numbers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum

from tests.reference.decoding import Frame
from wirebond.analysis.explain.numbers import number_of
from wirebond.protocol.model import Address, End, HeaderField, Protocol


class Addressee(Enum):
    OWN = 0
    ALL = 1  # a broadcast
    ANOTHER = 2  # foreign: counted, and nothing else


@dataclass
class Sequence:
    """Counts over all peers."""

    numbered: int = 0
    gaps: int = 0
    repeats: int = 0
    restarts: int = 0


def receiver_field(protocol: Protocol, sender: End | None) -> HeaderField | None:
    """The header field that says whom a frame of ``sender`` is for."""
    return _field_with(protocol, Address.RECEIVER, Address.MCU if sender == End.HOST else None)


def addressees(protocol: Protocol, frames: Iterable[Frame], sender: End, own: object | None = None) -> list[Addressee]:
    """Whom each of these frames is for, at an end whose address is ``own``; by default what ``sender`` sends."""
    described = receiver_field(protocol, sender)
    if described is None:
        return [Addressee.OWN for _ in frames]
    own = described.default(sender) if own is None else own
    found = []
    for frame in frames:
        address = frame.header.get(described.name, own)  # a frame without it concerns everybody
        if address == own:
            found.append(Addressee.OWN)
        else:
            found.append(Addressee.ALL if address in described.broadcast else Addressee.ANOTHER)
    return found


def sequence_of(protocol: Protocol, frames: Iterable[Frame], sender: End | None, peers: int) -> Sequence | None:
    """Derive the sequence account from these frames' numbers, at an end that remembers this many ``peers``: the last
    ones. None: frames have no number, or two senders mix theirs."""
    number = next((described for described in _fields(protocol) if described.is_sequence), None)
    owner = _field_with(protocol, Address.SENDER, Address.MCU if sender == End.MCU else None)
    if number is None or (sender is None and owner is None):
        return None
    total = Sequence()
    known: dict[object, dict[str, int]] = {}  # of each peer the newest number of each counter; the latest peer last
    for frame in frames:
        if number.name not in frame.header or (number.per_message and frame.name == "unknown"):
            continue
        address = None if owner is None else frame.header.get(owner.name, number_of(owner.value, 0)[0])
        peer = known.pop(address, {})
        known[address] = peer
        for forgotten in list(known)[:-peers]:
            del known[forgotten]
        value = frame.header[number.name]
        assert isinstance(value, int)
        _take(peer, frame.name if number.per_message else "", value, number.value.width, total)
    return total


def _take(newest: dict[str, int], counter: str, number: int, bits: int, total: Sequence) -> None:
    total.numbered += 1
    if counter in newest:
        missing = (number - newest[counter] - 1) % 2**bits
        if number == newest[counter]:
            total.repeats += 1
        elif missing < 2 ** (bits - 1):
            total.gaps += missing
        else:
            total.restarts += 1
    newest[counter] = number


def _fields(protocol: Protocol) -> list[HeaderField]:
    held = [holder.header for part in protocol.format.parts for holder in (part, *part.bits)]
    return [described for described in held if described is not None]


def _field_with(protocol: Protocol, *whose: Address | None) -> HeaderField | None:
    """The header field that holds one of these addresses."""
    found = (described for described in _fields(protocol) if described.address and described.address in whose)
    return next(found, None)
