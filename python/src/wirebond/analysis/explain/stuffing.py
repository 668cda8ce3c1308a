"""Undoing a format's byte stuffing, so that every frame byte knows its place on the wire, and doing it again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import takewhile

from wirebond.protocol.model import Escapes, FrameFormat, Stuffing, decimal_digits


@dataclass(frozen=True)
class Unstuffed:
    """``places[i]``: where in the block the frame's byte i begins and ends. ``added``: bytes that stuffing added."""

    block: bytes
    data: bytes
    places: tuple[tuple[int, int], ...]
    added: tuple[tuple[int, str], ...]  # place in the block, meaning


@dataclass(frozen=True)
class Impossible:
    """Why no sender can have made this block."""

    at: int  # place in the block
    reason: str


def plain(block: bytes) -> Unstuffed:
    return Unstuffed(block, block, tuple((i, i + 1) for i in range(len(block))), ())


def unstuff(frame_format: FrameFormat, block: bytes) -> Unstuffed | Impossible:
    """Undo the stuffing of ``block``, the bytes between two delimiters."""
    front, back = plain_sizes(frame_format)
    if len(block) < front + back:
        return Impossible(0, f"{len(block)} bytes, and {front + back} are beside the stuffed ones")
    stop = len(block) - back
    found = _known(frame_format.stuffing)[0](frame_format, block[front:stop])
    if isinstance(found, Impossible):
        return replace(found, at=front + found.at)
    places = [(at, at + 1) for at in range(front)]
    places += [(front + start, front + end) for start, end in found.places]
    places += [(at, at + 1) for at in range(stop, len(block))]
    added = tuple((front + at, meaning) for at, meaning in found.added)
    return Unstuffed(block, block[:front] + found.data + block[stop:], tuple(places), added)


def plain_sizes(frame_format: FrameFormat) -> tuple[int, int]:
    """Return how many bytes before and after the stuffed ones are sent as they are."""
    front = sum(part.size for part in takewhile(lambda part: part.is_plain, frame_format.parts))
    back = sum(part.size for part in takewhile(lambda part: part.is_plain, reversed(frame_format.parts)))
    return front, back


def stuff(frame_format: FrameFormat, data: bytes) -> bytes:
    front, back = plain_sizes(frame_format)
    stop = len(data) - back
    return data[:front] + _known(frame_format.stuffing)[1](frame_format, data[front:stop]) + data[stop:]


def _uncobs(_: FrameFormat, block: bytes) -> Unstuffed | Impossible:
    """Remove COBS. A code is the distance to the next code. Each code is at the place of a zero of the frame, except
    the first and those after 0xFF."""
    data = bytearray()
    places: list[tuple[int, int]] = []
    added: list[tuple[int, str]] = []
    at = 0
    zero_here = False
    while at < len(block):
        code = block[at]
        if code == 0:
            return Impossible(at, "a zero, which COBS leaves nowhere within a frame")
        if at + code > len(block):
            return Impossible(at, f"the COBS code {code:02X} points {at + code - len(block)} past the frame's end")
        if zero_here:
            data.append(0)
            places.append((at, at + 1))
        else:
            added.append((at, _code_meaning(code, at + code == len(block))))
        data += block[at + 1 : at + code]
        places += ((place, place + 1) for place in range(at + 1, at + code))
        zero_here = code != 0xFF
        at += code
    return Unstuffed(block, bytes(data), tuple(places), tuple(added))


def _code_meaning(code: int, is_last: bool) -> str:
    if is_last:
        return "COBS code: no zero up to the end"
    return "COBS code: 254 bytes without a zero follow" if code == 0xFF else f"COBS code: a zero stands {code} bytes on"


def _cobs(_: FrameFormat, data: bytes) -> bytes:
    out = bytearray()
    for run in data.split(b"\0"):
        rest = run
        while len(rest) >= 254:
            out += b"\xff" + rest[:254]
            rest = rest[254:]
        out += bytes([len(rest) + 1]) + rest
    full_at_the_end = len(data) >= 254 and out[-1] == 1 and data[-1] != 0
    return bytes(out[:-1]) if full_at_the_end else bytes(out)


def _rule(frame_format: FrameFormat) -> Escapes:
    assert frame_format.escapes is not None, "stuffing by escapes has its rule"
    return frame_format.escapes


def _unescape(frame_format: FrameFormat, block: bytes) -> Unstuffed | Impossible:
    rule = _rule(frame_format)
    meant = {code: byte for byte, code in rule.pairs}
    data = bytearray()
    places: list[tuple[int, int]] = []
    at = 0
    while at < len(block):
        if block[at] != rule.escape:
            data.append(block[at])
            places.append((at, at + 1))
            at += 1
            continue
        if at + 1 == len(block):
            return Impossible(at, f"the escape {rule.escape:02X} is at the frame's end")
        code = block[at + 1]
        byte = code ^ rule.exclusive_or if rule.exclusive_or else meant.get(code)
        if byte is None:
            return Impossible(at + 1, f"{code:02X} means nothing after the escape {rule.escape:02X}")
        data.append(byte)
        places.append((at, at + 2))
        at += 2
    return Unstuffed(block, bytes(data), tuple(places), ())


def _escape(frame_format: FrameFormat, data: bytes) -> bytes:
    rule = _rule(frame_format)
    codes = dict(rule.pairs)
    out = bytearray()
    for byte in data:
        if byte in codes:
            out += bytes([rule.escape, byte ^ rule.exclusive_or if rule.exclusive_or else codes[byte]])
        else:
            out.append(byte)
    return bytes(out)


def _unhex(frame_format: FrameFormat, block: bytes) -> Unstuffed | Impossible:
    digits = b"0123456789ABCDEFabcdef"
    wrong = next((at for at, byte in enumerate(block) if byte not in digits), None)
    if wrong is not None:
        return Impossible(wrong, f"{block[wrong]:02X} is not a hex digit")
    alone = min(len(block), _digits_alone(frame_format))
    if (len(block) - alone) % 2:
        return Impossible(len(block), "the second hex digit of the last byte is missing")
    places = [(0, 1)] * alone + [(at, at + 2) for at in range(alone, len(block), 2)]
    return Unstuffed(block, bytes.fromhex("0" * alone + block.decode()), tuple(places), ())


def _hex(frame_format: FrameFormat, data: bytes) -> bytes:
    return data.hex().upper().encode()[_digits_alone(frame_format) :]


def _digits_alone(frame_format: FrameFormat) -> int:
    """Return how many digits are a byte of their own: 1 if the first one is, otherwise 0."""
    return int(frame_format.stuffing == Stuffing.HEX_AFTER_DIGIT)


def _uninsert(frame_format: FrameFormat, block: bytes) -> Unstuffed | Impossible:
    rule = frame_format.insertion
    assert rule is not None, "stuffing by insertion has its rule"
    data = bytearray()
    places: list[tuple[int, int]] = []
    added: list[tuple[int, str]] = []
    at = 0
    while at < len(block):
        data.append(block[at])
        places.append((at, at + 1))
        at += 1
        if data.endswith(rule.after):
            if at == len(block) or block[at] != rule.byte:
                return Impossible(at, f"the inserted {rule.byte:02X} is missing after {rule.after.hex(' ').upper()}")
            added.append((at, f"inserted behind {rule.after.hex(' ').upper()}"))
            at += 1
    return Unstuffed(block, bytes(data), tuple(places), tuple(added))


def _insert(frame_format: FrameFormat, data: bytes) -> bytes:
    rule = frame_format.insertion
    assert rule is not None, "stuffing by insertion has its rule"
    return data.replace(rule.after, rule.after + bytes([rule.byte]))


def _undecimal(frame_format: FrameFormat, block: bytes) -> Unstuffed | Impossible:
    size = frame_format.decimal_bytes
    digits = sum(1 for _ in takewhile(lambda byte: byte in b"0123456789", reversed(block)))
    digits = min(digits, decimal_digits(size))
    begin = len(block) - digits
    if not digits:
        return Impossible(begin, "the decimal digits of the check are missing")
    number = int(block[begin:])
    if number >> 8 * size:
        return Impossible(begin, f"{number} is not a check of {8 * size} bits")
    places = [(at, at + 1) for at in range(begin)] + [(begin, len(block))] * size
    return Unstuffed(block, block[:begin] + number.to_bytes(size, "big"), tuple(places), ())


def _decimal(frame_format: FrameFormat, data: bytes) -> bytes:
    stop = len(data) - frame_format.decimal_bytes
    return data[:stop] + str(int.from_bytes(data[stop:], "big")).encode()


_Entry = tuple[Callable[[FrameFormat, bytes], Unstuffed | Impossible], Callable[[FrameFormat, bytes], bytes]]

# One entry for each stuffing in the model: undo, do.
_STUFFINGS: dict[Stuffing, _Entry] = {
    Stuffing.NONE: (lambda _, block: plain(block), lambda _, data: data),
    Stuffing.COBS: (_uncobs, _cobs),
    Stuffing.ESCAPE: (_unescape, _escape),
    Stuffing.HEX: (_unhex, _hex),
    Stuffing.HEX_AFTER_DIGIT: (_unhex, _hex),
    Stuffing.INSERTION: (_uninsert, _insert),
    Stuffing.DECIMAL_CHECK: (_undecimal, _decimal),
}


def _known(stuffing: Stuffing) -> _Entry:
    if stuffing not in _STUFFINGS:
        raise NotImplementedError(f"stuffing.py has no entry for '{stuffing}'")
    return _STUFFINGS[stuffing]
