"""The bytes of a frame or a candidate, each with a name."""

from __future__ import annotations

from wirebond.analysis.explain.layout import payload_index
from wirebond.analysis.explain.parts import Context, meaning
from wirebond.analysis.explain.report import Row, State
from wirebond.analysis.explain.stuffing import Unstuffed
from wirebond.analysis.explain.values import Reading, read_fields
from wirebond.analysis.explain.verdict import Verdict
from wirebond.protocol.model import End, PartKind, Protocol


def rows_of(
    protocol: Protocol,
    sender: End | None,
    verdict: Verdict,
    second_look: Verdict,
    content: Unstuffed,
    offset: int,
) -> tuple[Row, ...]:
    """Return the rows of a frame. ``verdict`` says which rules hold; ``second_look`` where the payload is, if that was
    found later.

    ``offset``: where the content's block begins in all that was given.
    """
    rows = _Rows(protocol, sender, verdict, second_look, content, offset)
    rows.add_parts()
    rows.add_what_stuffing_added()
    return tuple(sorted(rows.rows, key=lambda row: row.offset))


class _Rows:
    def __init__(
        self,
        protocol: Protocol,
        sender: End | None,
        verdict: Verdict,
        second_look: Verdict,
        content: Unstuffed,
        offset: int,
    ) -> None:
        self.protocol = protocol
        self.sender = sender
        self.verdict = verdict
        self.second_look = second_look
        self.content = content
        self.offset = offset
        self.rows: list[Row] = []

    def _add(self, name: str, level: int, start: int, stop: int, text: str, state: State) -> None:
        """Add a row for the frame's bytes [start, stop); none if there are no bytes."""
        stop = min(stop, len(self.content.data))
        if start >= stop:
            return
        first, last = self.content.places[start][0], self.content.places[stop - 1][1]
        wire = self.content.block[first:last]
        data = self.content.data[start:stop]
        self.rows.append(Row(name, level, self.offset + first, wire, data, text, state))

    def add_parts(self) -> None:
        parts = self.second_look.parts
        at = payload_index(parts)
        end = 0
        size = len(self.content.data)
        for index, part in enumerate(parts):
            context = Context(self.protocol, self.sender, self.second_look, self.content.data, index)
            start, stop = context.places[index]
            if index == at and self.second_look.payload is None:
                break
            end = stop
            missing = stop - max(start, size)
            text = meaning(context) if missing <= 0 else f"{min(missing, stop - start)} bytes are missing"
            self._add(part.name, 0, start, stop, text, self._state(index))
            if part.kind == PartKind.PAYLOAD:
                self._add_fields(start, min(stop, size))
        rest = "the bytes from here on are in no frame"
        if self.second_look.payload is None:
            rest = "the payload's size is not known, so that the rest has no places"
        self._add("rest", 0, end, size, rest, State.NAMED)

    def _state(self, index: int) -> State:
        rules = [rule for rule in self.verdict.rules if rule.part == index]
        if any(not rule.holds for rule in rules):
            return State.WRONG
        return State.GOOD if rules or self.verdict.is_frame else State.NAMED

    def _add_fields(self, start: int, stop: int) -> None:
        message = self.second_look.message
        if message is None:
            return
        readings = read_fields(message, self.content.data[start:stop])
        at = start
        for reading in readings:
            self._add_reading(reading, start, 1)
            at = start + reading.offset + len(reading.data)
        padding = "padding: zeros up to the fixed size"
        text = padding if not any(self.content.data[at:stop]) else "more than the file describes: ignored"
        cut = len(readings) < len(message.fields)
        self._add("rest", 1, at, stop, "the field's bytes are not all there" if cut else text, State.NAMED)

    def _add_reading(self, reading: Reading, payload: int, level: int) -> None:
        begin = payload + reading.offset
        faults = "".join(f":{fault}" for fault in reading.faults)
        state = State.WRONG if reading.faults else State.NAMED
        text = reading.text + faults
        if reading.data:
            self._add(reading.name, level, begin, begin + len(reading.data), text, state)
        else:  # among the bits of the row before, or nothing on the wire
            place = self.offset + (self.content.places[begin][0] if begin < len(self.content.places) else 0)
            self.rows.append(Row(reading.name, level, place, b"", b"", text, state))
        for part in reading.parts:
            self._add_reading(part, payload, level + 1)

    def add_what_stuffing_added(self) -> None:
        for place, text in self.content.added:
            inside = any(row.offset <= self.offset + place < row.offset + len(row.wire) for row in self.rows)
            if not inside:
                wire = self.content.block[place : place + 1]
                self.rows.append(Row("stuffing", 0, self.offset + place, wire, b"", text, State.NAMED))
