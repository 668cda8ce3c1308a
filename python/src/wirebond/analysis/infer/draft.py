"""The protocol file of a cut and its check, with the evidence for each line as a comment."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from wirebond.analysis.infer.checks import Check, header_check
from wirebond.analysis.infer.columns import Column, column, tells_size
from wirebond.analysis.infer.cuts import Between, Cut, Fixed, Length, Sizes
from wirebond.protocol.model import ByteOrder, End
from wirebond.protocol.spelling import bytes_text, number_type

_MOST_HEADER = 4  # columns in front of a payload in which an id is looked for
_MOST_COUNTED = 6  # bytes between the length and the payload
_MOST_MESSAGES = 64
_WIDTH = 44  # of a line before its comment


@dataclass(frozen=True)
class Draft:
    """``text`` is the file. ``uncertain``: sentences about what the bytes do not say."""

    text: str
    cut: Cut
    check: Check | None
    uncertain: tuple[str, ...]


@dataclass(frozen=True)
class _Line:
    """A part: its bytes from ``at`` on, its name, as the file has it, and why."""

    at: int
    size: int
    name: str
    text: str
    why: str


@dataclass
class _Writer:
    cut: Cut
    check: Check | None
    with_id: bool
    sender: End
    head: Check | None = None  # one over the header alone
    uncertain: list[str] = field(default_factory=list)

    @property
    def frames(self) -> tuple[bytes, ...]:
        return self.cut.frames

    @property
    def intact(self) -> list[bytes]:
        """Those whose check holds; without a check all."""
        check = self.check
        return [frame for frame in self.frames if check is None or check.holds(frame)]

    @property
    def behind(self) -> int:
        """Bytes after the payload."""
        check = self.check
        if check is None or check.place.looks_ahead:
            return len(self.cut.tail)
        return -check.place.at + check.place.gap

    def write(self, name: str, source: str) -> Draft:
        lines, id_at = self._header()
        payload_at = max((line.at + line.size for line in lines), default=0)
        parts = [*lines, self._payload(payload_at), *self._back()]
        parts = [self._spelled(line, parts) for line in parts]
        text = "\n".join(
            [
                f"# Drafted from {source} by `wirebond infer`. Compare it with your knowledge of the device.",
                f"# {len(self.frames)} frames, {self.cut.covered} bytes. Each comment gives the evidence for its line.",
                "wirebond: 1",
                f"protocol: {name}",
                "frame:",
                *self._framed(parts),
                *self._messages(id_at, payload_at),
            ]
        )
        self._doubts(id_at, lines)
        text += "".join(f"\n# Uncertain: {sentence}" for sentence in self.uncertain) + "\n"
        return Draft(text, self.cut, self.check, tuple(self.uncertain))

    # ---- the frame ----

    def _framed(self, parts: Sequence[_Line]) -> list[str]:
        rule = self.cut.rule
        if not isinstance(rule, Between):
            return [_commented(f"  - {line.text}", line.why) for line in parts]
        frames = len(self.frames)
        opening = [f"  - delimiter: {bytes_text(rule.opening)}"] if rule.opening else []
        closing = _commented(f"  - delimiter: {bytes_text(rule.closing)}", f"{frames} frames end with it")
        if not rule.stuffing:
            return [*opening, *(_commented(f"  - {line.text}", line.why) for line in parts), closing]
        inside = [_commented(f"    - {line.text}", line.why) for line in parts]
        return [*opening, f"  - {rule.stuffing}:", *inside, closing]

    def _header(self) -> tuple[list[_Line], int | None]:
        """Return the parts before the payload, and where the id is."""
        cut, rule = self.cut, self.cut.rule
        lines: list[_Line] = []
        if cut.start:
            why = f"{len(self.frames)} frames begin with it"
            lines.append(_Line(0, len(cut.start), "magic", f"magic: {bytes_text(cut.start)}", why))
        at = len(cut.start)
        end = at
        if isinstance(rule, Length):
            end = rule.at + rule.size
            if end < rule.beside - self.behind <= end + _MOST_COUNTED:  # then it counts the payload alone
                end = rule.beside - self.behind
            self.head = header_check(self.frames, at, end + 3)
        id_at = self._id_place(end) if self.with_id else None
        if isinstance(rule, Sizes):
            id_at = rule.at
        if id_at is not None:
            end = max(end, id_at + 1)
        check = self.check
        if check is not None:
            front = (
                check.place.at + check.place.size + check.place.first if check.place.looks_ahead else check.place.first
            )
            end = max(end, front)
        if self.head is not None:
            end = max(end, self.head.place.at + self.head.place.size)
        while at < end:
            lines.append(self._column(at, end, id_at))
            at += lines[-1].size
        return lines, id_at

    def _column(self, at: int, end: int, id_at: int | None) -> _Line:
        rule, check, head = self.cut.rule, self.check, self.head
        if isinstance(rule, Length) and at == rule.at:
            return self._length(rule)
        if check is not None and check.place.looks_ahead and at == check.place.at:
            return _Line(at, check.place.size, "check", "", f"holds in {check.fits} of {check.of} frames that differ")
        if head is not None and at == head.place.at:
            return _Line(
                at, head.place.size, "header_check", "", f"holds in {head.fits} of {head.of} frames that differ"
            )
        if at == id_at:
            of = column(self.frames, at)
            values = () if of is None else of.few
            return _Line(at, 1, "id", "id: u8", f"{len(values)} value{'s' * (len(values) != 1)}")
        special = [place for place in self._special(id_at) if place > at]
        run = min([end, *special]) - at
        size = 8 if run >= 8 and check is not None and check.place.first > 8 else 1
        of = column(self.frames, at)
        if size == 1 and of is not None and of.steps == 1:
            return _Line(at, 1, f"sequence_{at}", f"{{sequence: u8, name: sequence_{at}}}", "counts up by one")
        return _Line(at, size, f"byte_{at}", f"{{field: byte_{at}, type: u{8 * size}}}", _seen(of) if size == 1 else "")

    def _special(self, id_at: int | None) -> list[int]:
        rule, check, head = self.cut.rule, self.check, self.head
        places = [rule.at] if isinstance(rule, Length) else []
        places += [id_at] if id_at is not None else []
        places += [head.place.at, head.place.first] if head is not None else []
        if check is not None:
            places += [check.place.at, check.place.first] if check.place.at >= 0 else [check.place.first]
        return places

    def _id_place(self, end: int) -> int | None:
        """Return the column that tells best how long a frame is, of those with a few values; one right behind the
        length first. Where all frames have one size, nothing speaks for another one than the first."""
        start = len(self.cut.start)
        if isinstance(self.cut.rule, Fixed):
            of = column(self.frames, start)
            return start if of is not None and (of.few or of.constant is not None) and of.steps is None else None
        length = self.cut.rule if isinstance(self.cut.rule, Length) else None
        taken = set(range(length.at, length.at + length.size)) if length is not None else set()
        if self.head is not None:
            taken |= set(range(self.head.place.at, self.head.place.at + self.head.place.size))
        places = [length.at + length.size] if length is not None and length.at + length.size not in taken else []
        places += [at for at in range(start, max(end, start + _MOST_HEADER)) if at not in taken and at not in places]
        frames = self.intact or list(self.frames)
        least = min(map(len, frames)) - self.behind
        best: tuple[float, int] | None = None
        for at in places:
            of = column(frames, at) if at < least and (length is None or at <= end) else None
            if of is None or not of.few or of.constant is not None or of.steps is not None:
                continue
            told = tells_size(frames, at)
            if best is None or told > best[0] + 0.05:
                best = told, at
        return None if best is None else best[1]

    def _length(self, rule: Length) -> _Line:
        why = f"leads from each frame to the next, {len(self.frames)} times"
        return _Line(rule.at, rule.size, "length", "", why)

    def _payload(self, at: int) -> _Line:
        rule = self.cut.rule
        if isinstance(rule, Length):
            return _Line(at, 0, "payload", "payload: by_length", "")
        if isinstance(rule, Sizes):
            return _Line(at, 0, "payload", "payload: by_id", "the id tells the size")
        if isinstance(rule, Fixed):
            return _Line(at, 0, "payload", f"payload: {rule.size - at - self.behind}", "every frame has the same size")
        return _Line(at, 0, "payload", "payload: rest", "")

    def _back(self) -> list[_Line]:
        check, tail = self.check, self.cut.tail
        lines = []
        if check is not None and not check.place.looks_ahead:
            if check.place.gap:
                before = self.frames[0][check.place.at - check.place.gap + len(self.frames[0])]
                lines.append(
                    _Line(0, 1, "mark", f"{{constant: 0x{before:02X}, name: mark}}", "stands before the check")
                )
            why = f"holds in {check.fits} of {check.of} frames that differ"
            lines.append(_Line(0, check.place.size, "check", "", why))
        if tail:
            lines.append(_Line(0, len(tail), "tail", f"tail: {bytes_text(tail)}", "ends nearly every frame"))
        return lines

    def _spelled(self, line: _Line, parts: Sequence[_Line]) -> _Line:
        """Add the text that depends on the neighbouring parts."""
        if line.name == "length":
            return _replaced(line, self._length_text(parts))
        if line.name == "header_check":
            head = self.head
            assert head is not None, "there is one"
            first = _name_of(one for one in parts if one.at == head.place.first)
            last = _name_of(one for one in parts if one.at + one.size == line.at and one.size)
            over = first if first == last else f"{first}..{last}"
            return _replaced(line, f"{{{_check_text(head, over)}, name: header_check}}")
        if line.name == "check":
            check = self.check
            assert check is not None, "there is one"
            first_at = check.place.first + (check.place.at + check.place.size if check.place.looks_ahead else 0)
            behind = ("check", "tail", "mark")
            first = _name_of(one for one in parts if one.at == first_at and one.name not in behind)
            return _replaced(line, _check_text(check, first if first == "payload" else f"{first}..payload"))
        return line

    def _length_text(self, parts: Sequence[_Line]) -> str:
        rule = self.cut.rule
        assert isinstance(rule, Length)
        beside_payload = sum(part.size for part in parts)
        counted = {
            "payload": beside_payload,
            "rest": rule.at + rule.size,
            "frame": 0,
            "self_and_rest": rule.at,
        }
        order = ByteOrder.BIG if rule.order == "big" else ByteOrder.LITTLE
        kind = number_type("u", rule.size, order)
        exact = next((counts for counts, bytes_ in counted.items() if bytes_ == rule.beside), None)
        if exact == "payload":
            return f"length: {kind}"
        if exact is not None:
            return f"length: {{type: {kind}, counts: {exact}}}"
        return f"length: {{type: {kind}, counts: payload, offset: {beside_payload - rule.beside}}}"

    # ---- messages ----

    def _messages(self, id_at: int | None, payload_at: int) -> list[str]:
        beside = payload_at + self.behind
        sizes: defaultdict[int | None, list[int]] = defaultdict(list)
        for frame in self.intact or self.frames:
            if len(frame) >= beside:
                sizes[None if id_at is None else frame[id_at]].append(len(frame) - beside)
        most = max((size for found in sizes.values() for size in found), default=0)
        rule = self.cut.rule
        limit = 256**rule.size - 1 + rule.beside - beside if isinstance(rule, Length) else _rounded(most)
        lines = [f"max_payload: {min(_rounded(most), limit)}"] if isinstance(rule, Length | Between) and most else []
        lines.append("messages:")
        known = sorted(sizes.items(), key=lambda entry: (-len(entry[1]), entry[0] or 0))
        if id_at is not None:  # an id that came once may be a damaged frame
            known = [entry for entry in known if len(entry[1]) > 1 or self.check is not None] or known
        for number, found in sorted(known[:_MOST_MESSAGES], key=lambda entry: entry[0] or 0):
            name = "message" if number is None else f"message_{number:02x}"
            told = "" if number is None else f"id: 0x{number:02X}, "
            least, most = self._bounds(found)
            content = f"{{type: bytes, size: {most}}}" if least == most else f"{{type: bytes, max: {most}}}"
            fields = f"{{data: {content}}}" if most else "{}"
            size = f"{most} byte{'s' * (most != 1)}" if least == most else f"{least} to {most} bytes"
            times = f"{len(found)} time{'s' * (len(found) != 1)}, {size}"
            lines.append(_commented(f"  {name}: {{{told}sender: {self.sender}, fields: {fields}}}", times))
        return lines

    def _bounds(self, found: Sequence[int]) -> tuple[int, int]:
        if isinstance(self.cut.rule, Sizes | Fixed):
            size = max(set(found), key=found.count)
            return size, size
        return min(found), max(found)

    def _doubts(self, id_at: int | None, lines: Sequence[_Line]) -> None:
        if self.check is None:
            self.uncertain.append(
                "no check of the catalogue fits; frames are recognised by their start and size alone, or the check "
                "has a part that no capture shows."
            )
        if id_at is None:
            self.uncertain.append("no byte looks like an id, so all frames are one message.")
        constant = [line.at for line in lines if line.name.startswith("byte_") and "always" in line.why]
        if constant:
            places = " and ".join(map(str, constant))
            many = len(constant) > 1
            self.uncertain.append(
                f"byte{'s' * many} {places} never change{'s' * (not many)} here: an address, a version, or a part of "
                "the magic."
            )
        self.uncertain.append("the meaning of the payloads: here they are plain bytes.")


def draft(cut: Cut, check: Check | None, name: str, source: str, sender: End, *, with_id: bool = True) -> Draft | None:
    """Return the file for frames that are cut and checked so. None where the check begins or ends within a part: no
    file can say that.

    :param source: where the bytes are from, for the first line.
    :param sender: whose bytes they are.
    :param with_id: find a byte that distinguishes messages.
    """
    try:
        return _Writer(cut, check, with_id, sender).write(name, source)
    except _WithinPartError:
        return None


class _WithinPartError(Exception):
    """A check begins or ends where no part does."""


def _name_of(parts: Iterable[_Line]) -> str:
    for part in parts:
        return part.name
    raise _WithinPartError


def _rounded(most: int) -> int:
    """Return the next power of two, 16 at least: longer frames than those seen are likely to come."""
    return max(16, 1 << (most - 1).bit_length())


def _replaced(line: _Line, text: str) -> _Line:
    return _Line(line.at, line.size, line.name, text, line.why)


def _check_text(check: Check, over: str) -> str:
    name = check.algorithm.name
    told = [f"type: {name}", f"over: {over}"]
    if check.place.size > 1:
        told.append(f"byte_order: {check.order.value}")
    if check.place.hexadecimal:
        told.append("text: hex")
    return f"check: {{{', '.join(told)}}}"


def _seen(of: Column | None) -> str:
    if of is None:
        return ""
    if of.constant is not None:
        return f"always {of.constant:02X}"
    return f"{len(of.few)} values" if of.few else "many values"


def _commented(text: str, why: str) -> str:
    return f"{text.ljust(_WIDTH)}  # {why}" if why else text
