"""Stuffing undone: COBS, escapes, hex and decimal digits, and insertion."""

from __future__ import annotations

import re
from dataclasses import dataclass

from tests.reference.header import magics_of
from wirebond.protocol.model import Escapes, Protocol, Stuffing


def overhead(protocol: Protocol, size: int) -> int:
    if protocol.format.insertion is not None:
        return size // len(protocol.format.insertion.after)
    if protocol.format.stuffing == Stuffing.DECIMAL_CHECK:
        return _most_digits(protocol) - protocol.format.parts[-1].size
    return {Stuffing.NONE: 0, Stuffing.COBS: 1 + size // 254}.get(protocol.format.stuffing, size)


def unstuffed(protocol: Protocol, block: bytes) -> bytes | None:
    """What the sender stuffed, and around it what it sent as it is."""
    if protocol.format.stuffing == Stuffing.NONE:
        return block
    stuffed = [i for i, part in enumerate(protocol.format.parts) if not part.is_plain]
    front = sum(part.size for part in protocol.format.parts[: stuffed[0]])
    back = sum(part.size for part in protocol.format.parts[stuffed[-1] + 1 :])
    if len(block) < front + back:
        return None
    middle = block[front : len(block) - back]
    escapes = protocol.format.escapes
    if protocol.format.stuffing == Stuffing.HEX:
        content = bytes.fromhex(middle.decode()) if re.fullmatch(rb"([0-9A-Fa-f]{2})*", middle) else None
    elif protocol.format.stuffing == Stuffing.HEX_AFTER_DIGIT:
        digits = re.fullmatch(rb"[0-9A-Fa-f]([0-9A-Fa-f]{2})*", middle)
        content = bytes.fromhex("0" + middle.decode()) if digits else None if middle else b""
    elif protocol.format.stuffing == Stuffing.DECIMAL_CHECK:
        content = _undecimal(protocol, middle)
    else:
        content = unescape(escapes, middle) if escapes is not None else uncobs(middle)
    return None if content is None else block[:front] + content + block[len(block) - back :]


def _most_digits(protocol: Protocol) -> int:
    """Of the check, which is sent in decimal digits."""
    return {1: 3, 2: 5, 3: 8, 4: 10}[protocol.format.parts[-1].size]


def _undecimal(protocol: Protocol, block: bytes) -> bytes | None:
    """The digits at the end, leading zeros included, are the check."""
    size = protocol.format.parts[-1].size
    found = re.search(rb"[0-9]{1,%d}\Z" % _most_digits(protocol), block)
    if found is None or int(found[0]) >= 256**size:
        return None
    return block[: found.start()] + int(found[0]).to_bytes(size, "big")


def uncobs(block: bytes) -> bytes | None:
    """COBS undone; None where a code points past the end."""
    out = bytearray()
    at = 0
    while at < len(block):
        code = block[at]
        if code == 0 or at + code > len(block):
            return None
        out += block[at + 1 : at + code]
        at += code
        if code != 0xFF and at < len(block):
            out.append(0)
    return bytes(out)


def unescape(rule: Escapes, block: bytes) -> bytes | None:
    """Escapes undone; None where one stands at the end or has a code that means nothing."""
    out = bytearray()
    stream = iter(block)
    for byte in stream:
        if byte != rule.escape:
            out.append(byte)
            continue
        code = next(stream, None)
        if code is None:
            return None
        plain = code ^ rule.exclusive_or if rule.exclusive_or else {c: p for p, c in rule.pairs}.get(code)
        if plain is None:
            return None
        out.append(plain)
    return bytes(out)


@dataclass(frozen=True)
class Undone:
    """What the first ``used`` bytes were before stuffing. ``is_bad``: the byte behind them is none that a sender makes;
    ``is_complete``: they are all that was asked for, and no half of a pair is left."""

    data: bytes
    used: int
    is_bad: bool
    is_complete: bool


def undone(protocol: Protocol, wire: bytes, count: int | None, stuffed_end: int | None) -> Undone:
    """The first ``count`` bytes of the frame; None: all. Those from ``stuffed_end`` on were not stuffed."""
    frame_format = protocol.format
    front = sum(part.size for part in frame_format.parts[: [p.is_plain for p in frame_format.parts].index(False)])
    magic = frame_format.parts[0]
    starts = {value[0] for value in magics_of(magic, None)} if frame_format.escapes is not None else set()
    out = bytearray()
    at = 0
    owes = False
    while at < len(wire) and (len(out) != count or owes):
        if owes:
            assert frame_format.insertion is not None
            if wire[at] != frame_format.insertion.byte:
                return Undone(bytes(out), at, True, False)
            at, owes = at + 1, False
            continue
        stuffed = front <= len(out) and (stuffed_end is None or len(out) < stuffed_end)
        byte, size = wire[at], 1
        if stuffed and frame_format.escapes is not None:
            if byte in starts:
                return Undone(bytes(out), at, True, False)
            if byte == frame_format.escapes.escape:
                if at + 1 == len(wire):
                    return Undone(bytes(out), at, False, False)
                if wire[at + 1] in starts:
                    return Undone(bytes(out), at + 1, True, False)
                byte, size = wire[at + 1] ^ frame_format.escapes.exclusive_or, 2
        out.append(byte)
        at += size
        if stuffed and frame_format.insertion is not None:
            owes = bytes(out[front:]).endswith(frame_format.insertion.after)
    return Undone(bytes(out), at, False, not owes and count in (None, len(out)))
