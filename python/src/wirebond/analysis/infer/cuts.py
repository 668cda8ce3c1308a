"""Ways to cut a stream of an unknown format into frames, by what repeats in it. Bytes in, cuts out.

A way is proposed where most of the stream falls into frames that follow one another. Which of them is right, a check
that fits the frames proves, and else how much of the stream each explains.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Literal

from wirebond.analysis.explain.stuffing import Unstuffed, unstuff
from wirebond.analysis.explain.together import Together, chance_of
from wirebond.codec import Codec
from wirebond.protocol import loads
from wirebond.protocol.spelling import bytes_text

Order = Literal["little", "big"]

_LEAST_FRAMES = 8
_LONGEST_START = 4  # bytes
_MOST_STARTS = 10  # beginnings of each length that are looked at
_DEEPEST = 8  # bytes after the start that may hold the length
_MOST_BESIDE = 40  # bytes of a frame that its length does not count
_MOST_FRAME = 4096
_AHEAD = 4  # following starts in which the next frame may begin
_VOTES = 0.25  # part of the starts that agree
_LEAST_COVERED = 0.15  # part of the stream that is in frames
_MOST_CUTS = 12
_RULES = 10_000  # ways that are tried, about
_CHANCE = 1e-3  # that one of them leads from start to start by accident


@dataclass(frozen=True)
class Length:
    """A number at ``at`` of the frame, of ``size`` bytes; ``beside`` more bytes are in the frame than it says."""

    at: int
    size: int
    order: Order
    beside: int

    def frame_size(self, data: bytes, start: int) -> int | None:
        """Return the size of the frame that begins at ``start``, or None if the stream ends before it does."""
        begin = start + self.at
        found = data[begin : begin + self.size]
        return int.from_bytes(found, self.order) + self.beside if len(found) == self.size else None


@dataclass(frozen=True)
class Sizes:
    """A byte at ``at`` that says which of the sizes a frame has."""

    at: int
    of: dict[int, int]

    def frame_size(self, data: bytes, start: int) -> int | None:
        """See ``Length.frame_size``; None also if the byte is none of these."""
        at = start + self.at
        return self.of.get(data[at]) if at < len(data) else None


@dataclass(frozen=True)
class Fixed:
    """Every frame has this size."""

    size: int

    def frame_size(self, data: bytes, start: int) -> int | None:
        """See ``Length.frame_size``."""
        return self.size if start + self.size <= len(data) else None


@dataclass(frozen=True)
class Between:
    """Frames between delimiters. ``stuffing``: as the file names it; empty if bytes are sent as they are."""

    opening: bytes
    closing: bytes
    stuffing: str

    def spelled(self, parts: str) -> str:
        """Return the stuffed parts, as a file has them."""
        return f"{self.stuffing}: {parts}"


ByStart = Length | Sizes | Fixed
Rule = ByStart | Between


@dataclass(frozen=True)
class Cut:
    """``frames``: the bytes of each, in order; between delimiters without them, and unstuffed. ``covered``: bytes of
    the stream that are in them."""

    rule: Rule
    start: bytes  # first bytes of every frame; empty between delimiters
    frames: tuple[bytes, ...]
    covered: int
    tail: bytes = b""  # last bytes of every frame

    @property
    def by_start(self) -> bool:
        return not isinstance(self.rule, Between)


def cuts_of(data: bytes) -> list[Cut]:
    """Return the most promising ways, the one that covers most of the stream first."""
    found = [*_between(data), *_by_start(data)]
    found.sort(key=lambda cut: (-cut.covered, isinstance(cut.rule, Sizes), len(cut.start)))
    unlike: list[Cut] = []
    for cut in found:
        if cut.covered > _LEAST_COVERED * len(data) and not any(one.frames == cut.frames for one in unlike):
            unlike.append(_with_tail(cut))
    return unlike[:_MOST_CUTS]


# ---- by the first bytes of frames ----


def _by_start(data: bytes) -> Iterator[Cut]:
    for start in _starts(data):
        places = _places(data, start)
        rules: list[ByStart] = [*_lengths(data, places, len(start)), *_fixed(places), *_by_id(data, places, len(start))]
        for rule in rules:
            frames, tried = _chain(data, places, rule)
            if len(frames) >= _LEAST_FRAMES and _is_no_accident(len(frames), tried, len(places) / len(data)):
                yield _with_start(Cut(rule, start, tuple(frames), sum(map(len, frames))))


def _starts(data: bytes) -> list[bytes]:
    """Find frequent beginnings of one to four bytes."""
    found: list[bytes] = []
    for size in range(1, _LONGEST_START + 1):
        counts = Counter(data[at : at + size] for at in range(len(data) - size + 1))
        found += [one for one, count in counts.most_common(_MOST_STARTS) if count >= _LEAST_FRAMES]
    pairs = [one for one in found if len(one) == 2]  # their bytes, where the end of one frame is in them
    return list(dict.fromkeys([*found, *(one[:1] for one in pairs), *(one[1:] for one in pairs)]))


def _places(data: bytes, start: bytes) -> list[int]:
    return [found.start() for found in re.finditer(b"(?=%b)" % re.escape(start), data)]


def _lengths(data: bytes, places: Sequence[int], start: int) -> Iterator[Length]:
    """Find numbers after the start that lead to the next start."""
    kinds: list[tuple[int, Order]] = [(1, "little"), (2, "little"), (2, "big")]
    for at in range(start, start + _DEEPEST):
        for size, order in kinds:
            votes: Counter[int] = Counter()
            seen: dict[int, set[int]] = {}
            for index, place in enumerate(places):
                number = int.from_bytes(data[place + at : place + at + size], order)
                if number > _MOST_FRAME:
                    continue
                for following in places[index + 1 : index + 1 + _AHEAD]:
                    beside = following - place - number
                    if at + size - number <= beside <= _MOST_BESIDE and beside >= 0:
                        votes[beside] += 1
                        seen.setdefault(beside, set()).add(number)
            for beside, count in votes.most_common(2):
                if count >= max(_LEAST_FRAMES, _VOTES * len(places)) and len(seen[beside]) > 1:
                    yield Length(at, size, order, beside)


def _fixed(places: Sequence[int]) -> Iterator[Fixed]:
    distances = Counter(
        following - place
        for index, place in enumerate(places)
        for following in places[index + 1 : index + 1 + _AHEAD]
        if following - place >= 3
    )
    often = {
        size: count
        for size, count in distances.most_common(_AHEAD)
        if count >= max(_LEAST_FRAMES, _VOTES * len(places))
    }
    for size, count in often.items():  # two frames are as far apart as one and one
        if not any(size % part == 0 and part < size and often[part] > 0.8 * count for part in often):
            yield Fixed(size)


def _by_id(data: bytes, places: Sequence[int], start: int) -> Iterator[Sizes]:
    for at in range(start, start + 4):
        distances: dict[int, Counter[int]] = {}
        for index, place in enumerate(places):
            if place + at >= len(data):
                continue
            for following in places[index + 1 : index + 1 + _AHEAD]:
                if following - place > at:
                    distances.setdefault(data[place + at], Counter())[following - place] += 1
        sizes = {}
        for value, counts in distances.items():
            (size, count), of = (
                counts.most_common(1)[0],
                sum(data[p + at] == value for p in places if p + at < len(data)),
            )
            if count >= 3 and count >= 0.6 * of:
                sizes[value] = size
        if len(set(sizes.values())) >= 2 and len(sizes) <= 32:
            yield Sizes(at, sizes)


def _is_no_accident(frames: int, tried: int, share: float) -> bool:
    """Return whether chance rarely leads from this many of the ``tried`` starts to another start.

    :param share: part of all places that have a start.
    """
    return share < 1 and chance_of(1 / share, _RULES, Together(frames, tried)) < _CHANCE


def _chain(data: bytes, places: Sequence[int], rule: ByStart) -> tuple[list[bytes], int]:
    """Chain frames whose end is the start of another, or the stream's end; and count the tried starts. No frame begins
    within another."""
    known = set(places)
    frames: list[bytes] = []
    at = index = tried = 0
    while index < len(places):
        place = places[index]
        tried += 1
        size = rule.frame_size(data, place)
        end = place + size if size is not None else 0
        if size is not None and 2 < size <= _MOST_FRAME and (end in known or end == len(data)):
            frames.append(data[place:end])
            at = end
            index = bisect_right(places, at - 1)
        else:
            index += 1
    return frames, tried


def _with_start(cut: Cut) -> Cut:
    """Extend the start to the bytes that all frames begin with; to two at most if longer ones are not frequent."""
    start = cut.start
    limit = min(cut.rule.at if isinstance(cut.rule, Length | Sizes) else 2, 2)
    while len(start) < limit:
        values = Counter(frame[len(start)] for frame in cut.frames if len(frame) > len(start))
        value, count = values.most_common(1)[0]
        if count < 0.95 * len(cut.frames):
            break
        start += bytes([value])
    return replace(cut, start=start)


def _with_tail(cut: Cut) -> Cut:
    """Find one or two bytes that nearly all frames end with. A zero does not count if much of the stream is zeros."""
    if not cut.by_start:
        return cut
    tail = b""
    for back in (1, 2):
        values = Counter(frame[-back] for frame in cut.frames if len(frame) > len(cut.start) + back)
        if not values:
            break
        value, count = values.most_common(1)[0]
        if count < 0.95 * len(cut.frames):
            break
        tail = bytes([value]) + tail
    return replace(cut, tail=tail)


# ---- between delimiters ----

_BETWEEN = (
    Between(b"", b"\r\n", ""),
    Between(b"", b"\n", ""),
    Between(b"", b"\r", ""),
    Between(b"\0", b"\0", "cobs"),
    Between(b"\x7e", b"\x7e", "hdlc"),
    Between(b"\xc0", b"\xc0", "slip"),
    Between(b"\x10", b"\x10\x03", "doubled"),
)


def _between(data: bytes) -> Iterator[Cut]:
    for rule in _BETWEEN:
        cut = _cut_between(data, rule)
        if cut is None:
            continue
        if rule.stuffing:
            yield cut
        elif _is_text(cut):
            yield from _of_text(data, rule, cut)


def _cut_between(data: bytes, rule: Between) -> Cut | None:
    if data.count(rule.closing) < _LEAST_FRAMES:
        return None
    decoder = _reader(rule).decoder("mcu")
    raws = [message.raw for message in (*decoder.feed(data), *decoder.finish())]
    contents = (unstuff(_reader(rule).model.format, _inside(raw, rule)) for raw in raws)
    frames = tuple(content.data for content in contents if isinstance(content, Unstuffed) and content.data)
    if len(frames) < _LEAST_FRAMES or all(len(set(frame)) == 1 for frame in frames):
        return None  # runs of one byte, which any stream of a few values has
    return Cut(rule, b"", frames, sum(map(len, raws)))


def _inside(raw: bytes, rule: Between) -> bytes:
    return raw.removeprefix(rule.opening).removesuffix(rule.closing)


@cache
def _reader(rule: Between) -> Codec:
    """Return a codec that accepts everything between such delimiters as a frame."""
    inside = "[id: u8, payload: rest]" if rule.stuffing == "doubled" else "[payload: rest]"  # one must begin it
    parts = [rule.spelled(inside)] if rule.stuffing else ["payload: rest"]
    parts = [*([f"delimiter: {bytes_text(rule.opening)}"] if rule.opening else []), *parts]
    message = "any: {id: 0, sender: mcu}" if rule.stuffing == "doubled" else "any: {sender: mcu}"
    text = (
        f"wirebond: 1\nprotocol: reader\nframe: [{', '.join([*parts, f'delimiter: {bytes_text(rule.closing)}'])}]\n"
        f"max_payload: {_MOST_FRAME}\nunknown: deliver\nmessages: {{{message}}}\n"
    )
    return Codec(loads(text))


def _is_text(cut: Cut) -> bool:
    data = b"".join(cut.frames)
    return sum(32 <= byte < 127 or byte in b"\t\r" for byte in data) > 0.9 * len(data)


def _of_text(data: bytes, rule: Between, cut: Cut) -> Iterator[Cut]:
    """Cut into lines. A character that begins each opens them, and hexadecimal digits alone may be bytes."""
    first, count = Counter(frame[0] for frame in cut.frames).most_common(1)[0]
    if count > 0.9 * len(cut.frames) and not chr(first).isalnum():
        rule = replace(rule, opening=bytes([first]))
        opened = _cut_between(data, rule)
        if opened is not None:
            cut = opened
            of_hex = _cut_between(data, replace(rule, stuffing="hex"))
            if of_hex is not None:
                yield of_hex
    yield cut
