"""Explains bytes: the stretches of a stream, each with its rows, rules and nearest explanations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from wirebond.analysis.explain.guesses.format import MOST_LONGER
from wirebond.analysis.explain.guesses.guess import Case, constants_as_found, look
from wirebond.analysis.explain.layout import id_index, id_text
from wirebond.analysis.explain.nearest import (
    Search,
    join,
    repaired,
    search_all,
    search_sender,
    search_unstuffed,
)
from wirebond.analysis.explain.parts import check_text, header_values, sent_by
from wirebond.analysis.explain.report import Applied, Explanation, FittingGuess, Kind, Row, State, Stretch
from wirebond.analysis.explain.rows import rows_of
from wirebond.analysis.explain.scan import Candidate, Found, Scan, longest_frame, scan, start_bytes
from wirebond.analysis.explain.shapes import forms
from wirebond.analysis.explain.sharing import sharing, wanted_text
from wirebond.analysis.explain.stuffing import Unstuffed, plain
from wirebond.analysis.explain.together import Stream
from wirebond.analysis.explain.values import faults_of, read_fields, values_of, values_text
from wirebond.analysis.explain.verdict import Cause, Question, Rule, Verdict
from wirebond.errors import UsageError
from wirebond.protocol.meaning.messages import spoken
from wirebond.protocol.model import End, Part, Protocol

MOST_BYTES = 4096  # or one largest frame: more is for `decode`


def explain(
    protocol: Protocol,
    data: bytes,
    sender: str | None = None,
    peers: Sequence[Protocol] = (),
    *,
    quick: bool = False,
) -> Explanation:
    """Name every byte of ``data``, as if nothing followed.

    Some seconds at most for each of the first eight refused stretches; pure, any thread.

    :param sender: whose bytes these are, ``"mcu"`` or ``"host"``; None: of either end.
    :param peers: other protocols, of which the bytes may be frames.
    :param quick: everything is tried on four stretches instead of eight, and of the checks that no catalogue lists
        only those that need no long computation. For a link that is running.
    :raises UsageError: another sender, or more bytes than can be explained at once.
    """
    if sender not in (None, End.MCU, End.HOST):
        raise UsageError(f"sender is {sender!r}; expected 'mcu' or 'host'")
    end = None if sender is None else End(sender)
    most = most_bytes(protocol)
    if len(data) > most:
        raise UsageError(
            f"{len(data)} bytes are too many to explain at once, {most} are the most; find the frames with "
            "`wirebond decode`, and give the bytes around one place"
        )
    found = scan(protocol, data, end)
    stretches = _Stretches(protocol, data, end, tuple(peers), found, quick=quick).all()
    name = None if end is None else end.value
    return Explanation(protocol.name, name, stretches, _by_name(found.discarded), _by_name(found.rejected))


def most_bytes(protocol: Protocol) -> int:
    """Return how many bytes can be explained at once."""
    return max(MOST_BYTES, protocol.max_wire_bytes())


def _by_name(counts: Counter[Cause]) -> dict[str, int]:
    return {cause.value: count for cause, count in counts.items()}


@dataclass(frozen=True)
class _Refused:
    """A run of discarded bytes, and the candidate at its start; None: nothing in front could begin a frame."""

    start: int
    stop: int
    candidate: Candidate | None


class _Stretches:
    def __init__(
        self,
        protocol: Protocol,
        data: bytes,
        sender: End | None,
        peers: tuple[Protocol, ...],
        found: Scan,
        *,
        quick: bool,
    ) -> None:
        self._protocol = protocol
        self._data = data
        self._sender = sender
        self._peers = peers
        self._scan = found
        self._quick = quick

    def all(self) -> tuple[Stretch, ...]:
        stretches = [self._frame(found) for found in self._scan.frames]
        stretches += self._fill()
        runs = self._refused_runs()
        cases = [self._case(run) for run in runs]
        for run, case, search in zip(runs, cases, self._searches(runs, cases), strict=True):
            stretches.append(self._refused(run, case, search))
        stretches.sort(key=lambda stretch: stretch.offset)
        assert b"".join(stretch.wire for stretch in stretches) == self._data
        return tuple(stretches)

    # ---- frames ----

    def _frame(self, found: Found) -> Stretch:
        verdict = found.verdict
        begin = found.begin
        rows = rows_of(self._protocol, self._sender, verdict, verdict, found.content, begin)
        values: dict[str, Any] = {}
        header, faults = header_values(verdict.parts, found.content.data, verdict.payload_size or 0)
        text = ""
        name = verdict.delivered_as
        if name != "unknown" and verdict.message is not None and verdict.payload is not None:
            readings = read_fields(verdict.message, verdict.payload_of(found.content.data))
            values = values_of(readings)
            faults = faults_of(readings) + faults
            text = values_text(readings)
        wire = self._data[found.offset : found.offset + found.size]
        guesses: tuple[FittingGuess, ...] = ()
        if name == "unknown":
            summary = f"unknown: every check holds, but {self._why_unknown(verdict)}"
            guesses = search_sender(Case(self._protocol, found.content.block, self._sender)).guesses
        else:
            assert verdict.message is not None
            summary = f"{name} {sent_by(verdict.message)}" + (f": {text}" if text else "")
        end = begin + len(found.content.block)
        rows = self._with_delimiters(rows, found.offset, begin, end, found.offset + found.size)
        return Stretch(
            Kind.FRAME,
            found.offset,
            wire,
            "",
            summary,
            rows,
            self._applied(verdict),
            name,
            values,
            header,
            tuple(faults),
            guesses,
        )

    def _why_unknown(self, verdict: Verdict) -> str:
        message, payload = verdict.message, verdict.payload
        whose = "" if self._sender is None else f" of the {spoken(self._sender)}"
        if message is None or payload is None:
            if id_index(verdict.parts) is None:
                return f"no message{whose} is without an id, and this frame has none"
            number = id_text(verdict.parts, verdict.id or 0)
            near = sharing(self._protocol, self._sender, verdict.id)
            if near:
                return f"of the messages with the id {number} it is none: {wanted_text(near)}"
            return f"no message{whose} has the id {number}"
        return f"{message.name} needs {message.min_payload} payload bytes, and here are {payload[1] - payload[0]}"

    def _with_delimiters(self, rows: tuple[Row, ...], start: int, begin: int, end: int, stop: int) -> tuple[Row, ...]:
        """Return the bytes of [start, stop) around the content [begin, end)."""
        marks = [
            Row("delimiter", 0, at, self._data[at:behind], b"", text, State.GOOD)
            for at, behind, text in ((start, begin, "opens the frame"), (end, stop, "ends the frame"))
            if behind > at
        ]
        return tuple(sorted((*marks, *rows), key=lambda row: row.offset))

    def _fill(self) -> list[Stretch]:
        """Make one stretch of delimiters that are next to each other."""
        found: list[Stretch] = []
        for at in self._scan.fill:
            wire = self._data[at : at + 1]
            if found and found[-1].offset + len(found[-1].wire) == at:
                found[-1] = replace(found[-1], wire=found[-1].wire + wire)
            else:
                found.append(Stretch(Kind.FILL, at, wire, "", "delimiters between frames"))
        return found

    # ---- refused bytes ----

    def _refused_runs(self) -> list[_Refused]:
        """Group discarded bytes into runs, each with the candidate at its beginning.

        A candidate begins a run of its own where the one before claims no more bytes, and only if it got past its
        header or the run before could have held a frame: else garbage would fall into crumbs.
        """
        runs: list[_Refused] = []
        for at in sorted(self._scan.blamed):
            candidate = self._scan.blamed[at]
            before = runs[-1] if runs and runs[-1].stop == at else None
            if before is not None and not self._begins_a_run(before, at, candidate):
                runs[-1] = replace(before, stop=at + 1)
            else:
                runs.append(_Refused(at, at + 1, candidate))
        return runs

    def _begins_a_run(self, before: _Refused, at: int, candidate: Candidate | None) -> bool:
        if candidate is None or candidate is before.candidate or candidate.offset != at:
            return False
        claimed = before.start if before.candidate is None else before.candidate.offset + before.candidate.extent
        least = self._least
        reached_far = candidate.extent >= least or candidate.cause == Cause.INCOMPLETE
        return at >= claimed and (reached_far or (at - before.start >= least and candidate.extent > 1))

    def _case(self, run: _Refused) -> Case:
        begin, end = (run.start, None) if run.candidate is None else (run.candidate.begin, run.candidate.end)
        if end is None:  # it says itself how long it is, and may be longer than the file says
            longest = longest_frame(self._protocol, self._sender)
            most = longest + self._protocol.format.overhead(longest) + MOST_LONGER
            end = min(self._region_end(run.stop), begin + most)
        block = self._data[begin:end]
        return Case(self._protocol, block, self._sender, self._peers, begin)

    def _searches(self, runs: Sequence[_Refused], cases: Sequence[Case]) -> list[Search]:
        """Search an explanation for each run, except runs shorter than a frame in which no frame begins."""
        searches = [Search((), 0, True)] * len(cases)
        asked: list[int] = []
        for index, (run, case) in enumerate(zip(runs, cases, strict=True)):
            if case.verdict is not None and case.verdict.is_frame:  # then a delimiter is missing
                searches[index] = search_unstuffed(case)
            elif run.candidate is not None or len(case.block) >= self._least:
                asked.append(index)
        found = search_all([cases[index] for index in asked], Stream(self._data, self._scan), quick=self._quick)
        for index, search in zip(asked, found, strict=True):
            searches[index] = search
        if asked and self._protocol.format.delimiter is not None and not self._scan.frames:
            whole = search_unstuffed(replace(cases[asked[0]], block=self._data))
            searches[asked[0]] = join(whole, searches[asked[0]])
        return searches

    def _refused(self, run: _Refused, case: Case, search: Search) -> Stretch:
        candidate = run.candidate
        wire = self._data[run.start : run.stop]
        if candidate is None:
            return self._noise(run, wire, case, search)
        begin, end = candidate.begin, candidate.end
        rows: tuple[Row, ...]
        if candidate.verdict is None or case.verdict is None:
            inside = self._data[begin : run.stop if end is None else end]
            rows = (Row("rest", 0, begin, inside, inside, "cannot be taken apart", State.WRONG),) if inside else ()
        else:
            content = candidate.content if end is not None else plain(self._data[begin : run.stop])
            assert content is not None, "the unstuffed bytes were examined"
            rows = self._rows(case, case.verdict, content, begin)
        if end is not None:
            rows = self._with_delimiters(rows, run.start, begin, end, run.stop)
        return Stretch(
            Kind.REFUSED,
            run.start,
            wire,
            candidate.cause,
            self._refusal(candidate),
            rows,
            () if candidate.verdict is None else self._applied(candidate.verdict),
            guesses=search.guesses,
            repaired=repaired(case),
            tried=search.tried,
            searched_all=search.complete,
        )

    def _noise(self, run: _Refused, wire: bytes, case: Case, search: Search) -> Stretch:
        """Explain bytes in which no frame begins. They are laid out as a frame only if that explains them."""
        rows: tuple[Row, ...] = (_nameless(run.start, wire),)
        if search.guesses and case.verdict is not None:
            rows = self._rows(case, case.verdict, plain(wire), run.start)
        return Stretch(
            Kind.NOISE,
            run.start,
            wire,
            Cause.NO_START,
            self._no_start(),
            rows,
            guesses=search.guesses,
            tried=search.tried,
            searched_all=search.complete,
        )

    def _region_end(self, stop: int) -> int:
        """Return the end of the discarded bytes that begin before ``stop``."""
        while stop in self._scan.blamed:
            stop += 1
        return stop

    @property
    def _least(self) -> int:
        """The fewest bytes of a frame."""
        return min(sum(part.size for part in form.parts) for form in forms(self._protocol, self._sender))

    def _rows(self, case: Case, verdict: Verdict, content: Unstuffed, begin: int) -> tuple[Row, ...]:
        """Return the rows. A second examination that accepts the constants as they are may be needed to find the
        payload."""
        second_look = verdict
        if verdict.payload is None:
            changed = constants_as_found(case)
            second = None if changed is None else look(changed.protocol, changed.block, changed.sender)
            second_look = second[0] if second is not None else verdict
        return rows_of(self._protocol, self._sender, verdict, second_look, content, begin)

    def _no_start(self) -> str:
        starts = start_bytes(self._protocol, self._sender)
        if self._protocol.format.opening is not None:
            starts = {self._protocol.format.opening[0]}
        known = " or ".join(f"{byte:02X}" for byte in sorted(starts)) if len(starts) <= 4 else "one of a few values"
        return f"no byte here begins a frame, which would be {known}"

    def _refusal(self, candidate: Candidate) -> str:
        if candidate.verdict is None:
            return candidate.reason
        rule = candidate.verdict.failed
        if rule is None:
            return candidate.cause
        name = _rule_name(candidate.verdict.parts, rule)
        return f"{name}: expected {rule.expected}, found {rule.found}"

    def _applied(self, verdict: Verdict) -> tuple[Applied, ...]:
        return tuple(
            Applied(_rule_name(verdict.parts, rule), rule.expected, rule.found, rule.holds) for rule in verdict.rules
        )


def _nameless(offset: int, wire: bytes) -> Row:
    return Row("rest", 0, offset, wire, wire, "belongs to no frame", State.NAMED)


def _rule_name(parts: tuple[Part, ...], rule: Rule) -> str:
    if rule.part is None:
        names = {Question.MESSAGE: "id", Question.MATCH: "match", Question.CONDITION: "payload size"}
        return names.get(rule.question, "size")
    part = parts[rule.part]
    if rule.question == Question.MATCH:
        return "match"
    if rule.question == Question.FIELD:
        return "constant field"
    if rule.question == Question.CHECK:
        return f"{part.name}, {check_text(parts, part)}"
    if rule.question == Question.MESSAGE and "payload" in rule.expected:
        return "payload"
    return part.name
