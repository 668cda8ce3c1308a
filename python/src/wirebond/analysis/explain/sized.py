"""A stuffed candidate that its length ends: unstuffed byte by byte, as far as its rules allow. No stream."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from wirebond.analysis.explain.examine import examine
from wirebond.analysis.explain.layout import payload_index
from wirebond.analysis.explain.shapes import forms
from wirebond.analysis.explain.stuffing import Unstuffed, plain_sizes
from wirebond.analysis.explain.verdict import Cause, Outcome, Verdict
from wirebond.protocol.model import End, FrameFormat, Protocol, Stuffing


@dataclass
class _Undoing:
    """``read`` bytes of ``data`` gave ``out``; ``places`` and ``added`` as in ``Unstuffed``."""

    frame_format: FrameFormat
    data: bytes
    starts: frozenset[int]  # bytes that begin a frame are never within an escaped one
    out: bytearray = field(default_factory=bytearray)
    places: list[tuple[int, int]] = field(default_factory=list)
    added: list[tuple[int, str]] = field(default_factory=list)
    read: int = 0
    reason: str = ""  # why the next byte is none that a sender makes

    def run(self, limit: int, count: int | None, stuffed_end: int | None) -> bool:
        """Go on until ``count`` bytes are out; those from ``stuffed_end`` on are sent as they are. False: the first
        ``limit`` bytes are not enough, or `reason` says why not."""
        front, _ = plain_sizes(self.frame_format)
        while True:
            if self.owes:
                if self.read == limit:
                    return False
                rule = self.frame_format.insertion
                if rule is None or self.data[self.read] != rule.byte:
                    self.reason = "the byte that is inserted after the sequence is missing"
                    return False
                self.added.append((self.read, f"inserted behind {rule.after.hex(' ').upper()}"))
                self.read += 1
            if len(self.out) == count:
                return True
            if self.read == limit:
                return False
            is_stuffed = len(self.out) >= front and (stuffed_end is None or len(self.out) < stuffed_end)
            if not self._take(limit, is_stuffed):
                return False

    def _take(self, limit: int, is_stuffed: bool) -> bool:
        byte, size = self.data[self.read], 1
        rule = self.frame_format.escapes
        if is_stuffed and rule is not None:
            pair = self.data[self.read : min(self.read + 2, limit)] if byte == rule.escape else bytes([byte])
            wrong = next((i for i, one in enumerate(pair) if one in self.starts), None)
            if wrong is not None:
                self.read += wrong
                self.reason = f"{self.data[self.read]:02X} begins a frame, but occurs within one"
                return False
            if byte == rule.escape:
                if len(pair) < 2:
                    return False
                byte, size = pair[1] ^ rule.exclusive_or, 2
        self.out.append(byte)
        self.places.append((self.read, self.read + size))
        self.read += size
        return True

    @property
    def owes(self) -> bool:
        """Does what is out end with the sequence, and the inserted byte has not come?"""
        rule = self.frame_format.insertion
        front, _ = plain_sizes(self.frame_format)
        ends = rule is not None and bytes(self.out[front:]).endswith(rule.after)
        return ends and not (self.added and self.added[-1][0] >= self.places[-1][0])

    def so_far(self) -> Unstuffed:
        return Unstuffed(self.data[: self.read], bytes(self.out), tuple(self.places), tuple(self.added))


@dataclass(frozen=True)
class SizedVerdict:
    """``extent``: on the wire. ``verdict``: None where unstuffing failed; then ``reason`` says why."""

    outcome: Outcome
    cause: Cause
    extent: int
    verdict: Verdict | None
    content: Unstuffed
    reason: str = ""


def examine_sized(protocol: Protocol, data: bytes, sender: End | None) -> SizedVerdict:
    """Return the verdict on the candidate that begins with ``data``, as ``examine`` gives it for frames without
    stuffing."""
    frame_format = protocol.format
    _, back = plain_sizes(frame_format)
    parts = forms(protocol, sender)[0].parts
    prefix = sum(part.size for part in parts[: payload_index(parts)])
    magic = frame_format.parts[0]
    values = [value for _, value in magic.by_sender] or magic.alternatives or (magic.value,)
    starts = frozenset(value[0] for value in values) if frame_format.stuffing == Stuffing.ESCAPE else frozenset()
    undoing = _Undoing(frame_format, data, starts)

    def refused(cause: Cause, extent: int, reason: str) -> SizedVerdict:
        return SizedVerdict(Outcome.REFUSED, cause, extent, None, undoing.so_far(), reason)

    def incomplete(verdict: Verdict | None) -> SizedVerdict:
        return SizedVerdict(Outcome.INCOMPLETE, Cause.INCOMPLETE, len(data), verdict, undoing.so_far())

    done = undoing.run(len(data), prefix, None)
    verdict = examine(protocol, bytes(undoing.out), sender)
    if verdict.outcome == Outcome.REFUSED:
        extent = undoing.read if verdict.extent > 1 else verdict.extent
        return SizedVerdict(verdict.outcome, verdict.cause, extent, verdict, undoing.so_far())
    if undoing.reason:
        return refused(Cause.BAD_STUFFING, undoing.read + 1, undoing.reason)
    if not done:
        return incomplete(verdict)
    while verdict.outcome == Outcome.INCOMPLETE and verdict.payload is None:  # a count among the fields gives the size
        if not undoing.run(len(data), verdict.extent, None):
            if undoing.reason:
                return refused(Cause.BAD_STUFFING, undoing.read + 1, undoing.reason)
            return incomplete(verdict)
        verdict = examine(protocol, bytes(undoing.out), sender)
        if verdict.outcome == Outcome.REFUSED:
            return SizedVerdict(verdict.outcome, verdict.cause, undoing.read, verdict, undoing.so_far())
    if frame_format.length_on_wire:
        on_wire = verdict.extent
        end = on_wire - back
        if len(data) < on_wire:
            return incomplete(verdict)
        if undoing.read > end:
            return refused(Cause.LENGTH_OUT_OF_RANGE, on_wire, "the length ends the frame within its header")
        undoing.run(end, None, None)
        if undoing.reason:
            return refused(Cause.BAD_STUFFING, undoing.read + 1, undoing.reason)
        if undoing.read != end or undoing.owes:
            return refused(Cause.BAD_STUFFING, on_wire, "the stuffed bytes end in the middle of an escaped byte")
        for at in range(end, on_wire):
            undoing.out.append(data[at])
            undoing.places.append((at, at + 1))
        undoing.read = on_wire
    elif not undoing.run(len(data), verdict.extent, verdict.extent - back):
        if undoing.reason:
            return refused(Cause.BAD_STUFFING, undoing.read + 1, undoing.reason)
        return incomplete(verdict)
    content = undoing.so_far()
    whole = examine(protocol, content.data, sender, block=content.block)
    return SizedVerdict(whole.outcome, whole.cause, undoing.read, replace(whole), content)
