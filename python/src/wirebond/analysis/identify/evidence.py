"""Computes the evidence of a frame for its format, in bits: how much more briefly than chance the format describes it.

Chance means: every byte of the stream is drawn by itself, as often as it occurs in the stream. A byte ``b`` then takes
``-log2 f(b)`` bits. A format describes a frame with fewer bits: constants, checks and delimiters follow from it. What
remains unknown is charged: which message, which size, and where frames are among the other bytes.
The evidence is what is saved less what is charged. Bytes of chance give a format an evidence of ``n`` bits in at most
one of ``2**n`` cases, whatever its check is. So a weak check cannot win because it has many chances.

Nothing here decodes, and nothing here reads a file.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from wirebond.analysis.check.frame_facts import payload_sizes
from wirebond.protocol.model import Insertion, Message, PayloadRule, Protocol, Stuffing
from wirebond.protocol.plan import Form, Framing, Plan

_BYTE_BITS = 8
_COBS_BITS = 7.5  # random bytes without a zero are a chain of COBS blocks in 1 of about 180 cases
_HEX_DIGITS = b"0123456789ABCDEFabcdef"


@dataclass(frozen=True)
class Background:
    """The frequency of each byte value in a stream, plus half a count so that none is impossible."""

    counts: tuple[int, ...]
    size: int
    bits: tuple[float, ...] = field(init=False)  # of each value: -log2 of its share

    def __post_init__(self) -> None:
        total = self.size + 128
        object.__setattr__(self, "bits", tuple(-math.log2((count + 0.5) / total) for count in self.counts))

    def share(self, values: Sequence[int]) -> float:
        """Return the part of the stream's bytes that have one of these values."""
        return min(1.0, sum(self.counts[value] + 0.5 for value in values) / (self.size + 128))

    def mean_bits(self, data: bytes) -> float:
        """Return the bits of an average byte of ``data``."""
        return sum(map(self.bits.__getitem__, data)) / len(data)

    def masked_bits(self, value: int, mask: int) -> float:
        """Return the bits saved if these bits of a byte are known."""
        return -math.log2(self.share([byte for byte in range(256) if byte & mask == value]))


def background(data: bytes) -> Background:
    """Return the byte values of this stream."""
    return Background(tuple(data.count(value) for value in range(256)), len(data))


class Worth:
    """The evidence of frames of one format, from one end, on one stream."""

    def __init__(self, protocol: Protocol, plan: Plan, over: Background, messages: list[Message]) -> None:
        """:param messages: those whose frames are taken for known ones, of either end."""
        self._over = over
        self._plan = plan
        self._forms = [_FormWorth(form, protocol, over, messages) for form in plan.forms]
        self._inside = _stuffing_bits(protocol, plan, over)
        self._opening = sum(over.bits[byte] for byte in plan.opening)
        self._closing = sum(over.bits[byte] for byte in plan.closing)

    def of(self, raw: bytes, is_known: bool) -> float:
        """Return the bits saved by one frame. If several forms fit, the one that saves least counts."""
        mean = self._over.mean_bits(raw)
        content = len(raw)
        saved = 0.0
        if self._plan.closing:
            saved += self._closing
            content -= len(self._plan.closing)
            if self._plan.sends_opening and raw.startswith(self._plan.opening):
                saved += self._opening
                content -= len(self._plan.opening)
        saved += self._inside * content
        if self._plan.stuffing == Stuffing.COBS:
            saved += _COBS_BITS / _BYTE_BITS * mean
        is_plain = self._plan.framing == Framing.BY_START
        fitting = [form for form in self._forms if not is_plain or form.fits(raw)] or self._forms
        return saved + min(form.of(mean, is_known) for form in fitting)


class _FormWorth:
    def __init__(self, form: Form, protocol: Protocol, over: Background, messages: list[Message]) -> None:
        self._form = form
        self._constants = sum(over.masked_bits(c.value, c.mask) for c in form.constants)
        self._checks = sum(rule.bits for rule in form.checks) / _BYTE_BITS
        self._told = 0
        if form.id is not None:
            self._told += form.id.mask.bit_count()
        if form.length is not None:
            self._told += form.length.mask.bit_count()
        sizes = _size_choices(form, protocol.format.max_payload)
        ids = 2.0 ** (0 if form.id is None else form.id.mask.bit_count())
        self._any = math.log2(max(1.0, ids * sizes))
        known = sum(_id_choices(m) * (m.max_payload - m.min_payload + 1 if sizes > 1 else 1) for m in messages)
        self._known = math.log2(max(1, known))

    def fits(self, raw: bytes) -> bool:
        if len(raw) < self._form.prefix + self._form.suffix:
            return False
        return all(
            raw[c.at.offset + (len(raw) if c.at.from_end else 0)] & c.mask == c.value for c in self._form.constants
        )

    def of(self, mean: float, is_known: bool) -> float:
        """Return the evidence of the frame's checks. ``mean``: bits of an average byte of the frame; a check byte
        counts as much."""
        determined = self._checks + self._told / _BYTE_BITS
        return self._constants + determined * mean - (self._known if is_known else self._any)


def _size_choices(form: Form, most: int) -> int:
    if form.payload in (PayloadRule.FIXED, PayloadRule.BY_ID):
        return 1
    possible = payload_sizes(form, most)
    return most + 1 if possible is None else max(1, len(possible))


def _id_choices(message: Message) -> int:
    ids = message.ids
    return 1 if ids is None else sum(high - low + 1 for low, high in ids.ranges)


def _stuffing_bits(protocol: Protocol, plan: Plan, over: Background) -> float:
    """Return the bits saved by each byte between the delimiters, because its value is allowed there."""
    frame_format = protocol.format
    wrong = 0.0
    rule = frame_format.escapes
    if rule is not None and rule.doubles:
        escape = over.share([rule.escape])
        return -math.log2(1 - escape * (1 - escape))
    for delimiter in {plan.opening, plan.closing} - {b""}:
        wrong += math.prod(over.share([byte]) for byte in delimiter)
    if rule is not None:
        if not rule.exclusive_or:
            wrong += over.share([rule.escape]) * (1 - over.share([code for _, code in rule.pairs]))
        starts = [byte for byte, _ in rule.pairs[: plan.starts]] if plan.framing == Framing.SIZED else []
        wrong += over.share(starts) if starts else 0.0
    if frame_format.insertion is not None:
        wrong += _missing_insertion(frame_format.insertion, over)
    if frame_format.stuffing in (Stuffing.HEX, Stuffing.HEX_AFTER_DIGIT):
        wrong = max(wrong, 1 - over.share(list(_HEX_DIGITS)))
    return -math.log2(max(1e-3, 1 - wrong))


def _missing_insertion(rule: Insertion, over: Background) -> float:
    return math.prod(over.share([byte]) for byte in rule.after) * (1 - over.share([rule.byte]))


def cost_of_places(frames: int, other_bytes: int) -> float:
    """Return the bits that encode the places of the frames: their number, and their order among the other bytes."""
    total = frames + other_bytes
    return _log2_choose(total, frames) + math.log2(total + 1)


def cost_of_kinds(known: int, others: int) -> float:
    """Return the bits that encode which frames are of messages in the file."""
    return _log2_choose(known + others, known) + math.log2(known + others + 1)


def _log2_choose(total: int, chosen: int) -> float:
    ln = math.lgamma(total + 1) - math.lgamma(chosen + 1) - math.lgamma(total - chosen + 1)
    return ln / math.log(2)
