"""Decodes a whole stream with `explain`: slow, in one piece, without the engine's plan, tables or state."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

from wirebond.analysis.explain.parts import header_values
from wirebond.analysis.explain.scan import Found, scan
from wirebond.protocol.model import End, Protocol
from wirebond.protocol.planning import expecting


@dataclass(frozen=True)
class Frame:
    offset: int
    wire: bytes
    id: int
    name: str  # of the message, or "unknown"
    header: dict[str, object] = field(default_factory=dict)


@dataclass
class Result:
    frames: list[Frame] = field(default_factory=list)
    fill_bytes: int = 0
    discarded_bytes: Counter[str] = field(default_factory=Counter)
    rejected_candidates: Counter[str] = field(default_factory=Counter)


def decode(protocol: Protocol, stream: bytes, sender: End | None = None, request: str | None = None) -> Result:
    """Everything in ``stream``, as if nothing ever followed it. ``request`` went out before it."""
    reply = protocol.message(request).reply if request is not None else ""
    return decode_blocks(expecting(protocol, reply) if reply else protocol, [stream], sender)


def decode_blocks(protocol: Protocol, blocks: Iterable[bytes], sender: End | None = None) -> Result:
    """Decode a format whose frames end by silence: the bytes between silences, one block at a time."""
    total = Result()
    begin = 0
    for block in blocks:
        found = scan(protocol, block, sender)
        total.frames += [replace(_frame(one, block), offset=begin + one.offset) for one in found.frames]
        total.fill_bytes += len(found.fill)
        total.discarded_bytes += found.discarded
        total.rejected_candidates += found.rejected
        begin += len(block)
    return total


def _frame(found: Found, block: bytes) -> Frame:
    verdict = found.verdict
    header, _ = header_values(verdict.parts, found.content.data, verdict.payload_size or 0)
    wire = block[found.offset : found.offset + found.size]
    return Frame(found.offset, wire, verdict.id or 0, verdict.delivered_as, header)
