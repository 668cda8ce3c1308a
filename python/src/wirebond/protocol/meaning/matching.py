"""Reads what distinguishes messages besides one id: several ids, header fields, numbers of the payload and its size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations

from wirebond.protocol.matching import ID_BITS, overlap
from wirebond.protocol.meaning.conditions import Fault, magic_ranges, magic_values, ranges_of
from wirebond.protocol.meaning.draft import Draft
from wirebond.protocol.meaning.messages import Entry, Messages, spoken
from wirebond.protocol.model import (
    BitRole,
    End,
    Field,
    FieldKind,
    HeaderField,
    Match,
    MatchOf,
    Message,
    Part,
    PartKind,
    PayloadPlace,
    PayloadRule,
)
from wirebond.protocol.model.forms import header_fields
from wirebond.protocol.payload_rules import named_numbers
from wirebond.protocol.planning import matches_late
from wirebond.protocol.problems import Place, Problems, suggestion
from wirebond.protocol.text.matching import MatchText
from wirebond.protocol.text.yaml_tree import Mapping

ID = "id"
_Numbers = dict[str, tuple[Field, PayloadPlace]]


def read_matches(draft: Draft, messages: Messages, problems: Problems) -> tuple[Draft, Messages]:
    """Return the messages with what they match, and the frame with its id as a header field where a message has
    several."""
    found: Messages = {}
    for name, entry in messages.items():
        if entry.message is None or (entry.ids is None and not entry.match):
            found[name] = entry
        else:
            found[name] = replace(entry, message=_Reader(draft, entry, entry.message, problems).read())
    read = [(entry, entry.message) for entry in found.values() if entry.message is not None]
    matched = [(entry, message) for entry, message in read if message.match]
    if not matched:
        return draft, found
    if any(message.ids is not None for _, message in matched):
        draft = _with_ids(draft, matched, problems)
    if any(part.seeded for part in draft.parts):
        for entry, _ in matched:
            problems.add(
                entry.place,
                f"with `seed: message` the id alone must determine the seed; give `{entry.name}` one id and no "
                "`match`, or remove `seed: message`",
            )
    _validate_moment(draft, matched, problems)
    _validate_overlaps(read, problems)
    return draft, found


@dataclass
class _Reader:
    draft: Draft
    entry: Entry
    message: Message
    problems: Problems

    def read(self) -> Message:
        header = {field.name: field for field in header_fields(self.draft.parts)}
        numbers = dict(named_numbers(self.message.fields)) if self.entry.has_all_fields else {}
        if self.entry.ids is not None and self.draft.id_bits:
            ids = self.entry.ids
            self._add(self.entry.node.value_place("id"), lambda: self._of_id(ids))
        places = self.entry.node.get("match")
        for name, text in self.entry.match:
            assert isinstance(places, Mapping), "the grammar gives no others"
            place = places.key_place(name)
            if name == "size":
                self._add(places.value_place(name), lambda text=text: self._of_size(text))  # type: ignore[misc]
            elif name == ID:
                self.problems.add(place, "the id is not part of `match`; write `id: 0x80..0xFF` in the message")
            elif name in header and name in numbers:
                self.problems.add(
                    place, f"`{name}` is a field of the header, and a number of this message, too; rename one of them"
                )
            elif name in header:
                self._add(
                    places.value_place(name),
                    lambda text=text, field=header[name]: self._of_header(text, field),  # type: ignore[misc]
                )
            elif paths := paths_of(name, numbers):
                self._add(
                    places.value_place(name),
                    lambda text=text, name=name, paths=paths: self._of_path(text, name, paths, numbers),  # type: ignore[misc]
                )
            elif self.entry.has_all_fields:
                known = dict.fromkeys((*header, *numbers, "size"))
                self.problems.add(
                    place,
                    f"`{name}` is neither a field of the header nor an unsigned number at a constant place of this "
                    f"message; {suggestion(name, known)}",
                )
        return self.message

    def _add(self, place: Place, read: Callable[[], Match | None]) -> None:
        try:
            match = read()
        except Fault as fault:
            self.problems.add(place, str(fault))
            return
        if match is not None:
            self.message = replace(self.message, match=(*self.message.match, match))

    def _of_id(self, text: MatchText) -> Match | None:
        width = self.draft.id_bits
        ranges = ranges_of(text, width, {}, "the id")
        mask = (1 << ID_BITS) - 1 if text.mask is None or text.mask == (1 << width) - 1 else text.mask
        match = Match(MatchOf.ID, ranges, ID_BITS, mask)
        self.message = replace(self.message, id=match.least)
        return None if match.is_one_value else match

    def _of_header(self, text: MatchText, field: HeaderField) -> Match:
        part = next(part for part in self.draft.parts if _holds(part, field))
        if part.kind == PartKind.MAGIC:
            listed = [v for one in self.draft.parts if one.kind == PartKind.MAGIC for v in magic_values(one)]
            if text.mask is not None:
                raise Fault("a magic has no bits to select; write its bytes")
            return _match(MatchOf.HEADER, magic_ranges(text, listed), field.value.width, None, field.name)
        if field.is_sequence:
            raise Fault(f"`{field.name}` counts frames, so it cannot identify a message; match another field")
        if field.address is not None:
            raise Fault(f"`{field.name}` is an address, so it cannot identify a message; match another field")
        kind = "scaled" if field.value.is_scaled else "signed" if field.value.coding.is_signed else ""
        if kind and text.mask is None:
            raise Fault(f"`{field.name}` is {kind}; match its bits, such as `{{mask: 0x80, value: 0x80}}`")
        ranges = ranges_of(text, field.value.width, dict(field.value.enum), f"`{field.name}`")
        return _match(MatchOf.HEADER, ranges, field.value.width, text.mask, field.name)

    def _of_path(self, text: MatchText, name: str, paths: list[str], numbers: _Numbers) -> Match:
        if len(paths) > 1:
            listed = " or ".join(f"`{path}`" for path in paths)
            raise Fault(f"`{name}` could be {listed} in this message; write the whole path of the one you mean")
        path = paths[0]
        if any(match.of == MatchOf.PAYLOAD and match.name == path for match in self.message.match):
            raise Fault(f"`{path}` is matched twice; write it once")
        return self._of_payload(text, path, *numbers[path])

    def _of_payload(self, text: MatchText, name: str, field: Field, place: PayloadPlace) -> Match:
        if field.is_count:
            raise Fault(f"`{name}` counts other fields, and their number is free; match another field")
        width = place.mask.bit_length()
        match = _match(
            MatchOf.PAYLOAD, ranges_of(text, width, dict(field.enum), f"`{name}`"), width, text.mask, name, place
        )
        if match.is_one_value:  # then it is not a value any more
            self.message = replace(self.message, fields=_with_constant(self.message.fields, name, match.least))
        return match

    def _of_size(self, text: MatchText) -> Match:
        payload = self.draft.payload
        if payload.payload not in (PayloadRule.BY_LENGTH, PayloadRule.REST):
            raise Fault(
                "every payload has the same size in this frame; match something else"
                if payload.payload == PayloadRule.FIXED
                else "with `payload: by_id` the message determines the size, so the size cannot identify the message; "
                "use a frame with a length"
            )
        if payload.trims_zeros:
            raise Fault("with `trim_zeros` a payload has any size; match something else")
        match = _match(MatchOf.SIZE, ranges_of(text, 16, {}, "the payload's size"), 16, text.mask, "size")
        least, most = self.message.min_payload, self.message.max_payload
        if self.entry.has_all_fields and not any(match.holds(size) for size in range(least, most + 1)):
            sizes = f"{least}" if least == most else f"{least} to {most}"
            raise Fault(f"`{self.message.name}` has {sizes} payload bytes, and none of these sizes; write {sizes}")
        return match


def _match(
    of: MatchOf,
    ranges: tuple[tuple[int, int], ...],
    width: int,
    mask: int | None,
    name: str,
    place: PayloadPlace | None = None,
) -> Match:
    return Match(of, ranges, width, (1 << width) - 1 if mask is None else mask, name, place)


def _holds(part: Part, field: HeaderField) -> bool:
    return part.header is field or any(run.header is field for run in part.bits)


def paths_of(name: str, numbers: _Numbers) -> list[str]:
    """Return the numbers that a name may mean: the one with this path, else those whose paths end with it."""
    return [name] if name in numbers else [path for path in numbers if path.endswith(f".{name}")]


def _with_constant(fields: tuple[Field, ...], path: str, value: int) -> tuple[Field, ...]:
    """Make the number with this path a constant. A struct that has one is of no type of the file any more: in other
    messages that type has the number."""
    name, _, rest = path.partition(".")

    def fixed(one: Field) -> Field:
        if one.name != name:
            return one
        if rest:
            return replace(one, fields=_with_constant(one.fields, rest, value), type_name="")
        return Field(name, FieldKind.PADDING, one.size, one.order, bits=one.bits, constant=value)

    return tuple(fixed(one) for one in fields)


def _with_ids(draft: Draft, matched: list[tuple[Entry, Message]], problems: Problems) -> Draft:
    """Return the id as a header field, which says what a received message has, and what a sender chooses."""
    if any(field.name == ID for field in header_fields(draft.parts)):
        for entry, message in matched:
            if message.ids is not None:
                problems.add(
                    entry.node.value_place("id"),
                    f"`{entry.name}` has several ids, so received frames have a header field `id`, but the frame "
                    "already has a field of that name; rename that field",
                )
        return draft
    if draft.forbidden_first and draft.parts[0].kind == PartKind.ID:
        for entry, message in matched:
            if message.ids is not None and any(_begins(draft, message.ids, byte) for byte in draft.forbidden_first):
                problems.add(
                    entry.node.value_place("id"),
                    f"a frame of `{entry.name}` could begin with a byte of the delimiter after it; leave out ids "
                    "that begin with that byte",
                )
    wholes = [part for part in draft.parts if part.kind == PartKind.ID]
    if wholes:  # of several in parts that exclude each other the widest
        widest = max(wholes, key=lambda part: part.size)
        field = HeaderField(Field(ID, FieldKind.INTEGER, widest.size, widest.order))
    else:
        field = HeaderField(Field(ID, FieldKind.INTEGER, 0, bits=draft.id_bits))

    def with_field(part: Part) -> Part:
        runs = tuple(replace(run, header=field) if run.role == BitRole.ID else run for run in part.bits)
        return replace(part, header=field) if part.kind == PartKind.ID else replace(part, bits=runs)

    return replace(draft, parts=tuple(with_field(part) for part in draft.parts))


def _begins(draft: Draft, ids: Match, byte: int) -> bool:
    """Check whether an id can begin with this byte. It is assumed of a wide one."""
    return draft.parts[0].size > 1 or ids.holds(byte)


def _validate_moment(draft: Draft, matched: list[tuple[Entry, Message]], problems: Problems) -> None:
    """If the message determines the payload's size: check that it is known before the payload."""
    if draft.payload.payload != PayloadRule.BY_ID:
        return
    for entry, message in matched:
        if matches_late((message,), draft.parts):
            problems.add(
                entry.place,
                f"with `payload: by_id` the size of `{entry.name}` must be known before its payload, but its `match` "
                "is not; match a field before the payload, or use a frame with a length",
            )


def _validate_overlaps(read: list[tuple[Entry, Message]], problems: Problems) -> None:
    replies = {message.reply for _, message in read}
    for (first, one), (second, other) in combinations(read, 2):
        if not one.match and not other.match:  # their ids are compared elsewhere
            continue
        ends = [end for end in (End.HOST, End.MCU) if one.sent_by(end) and other.sent_by(end)]
        if not ends or one.name in replies or other.name in replies:
            continue
        shared = overlap(one, other)
        if shared is None:
            continue
        example = ", ".join(f"{_spoken_of(s.match)} {s.value} (0x{s.value:02X})" for s in shared) or "anything"
        problems.add(
            second.place,
            f"the {spoken(ends[0])} sends `{first.name}` (line {first.place.line}) and `{second.name}`, and a frame "
            f"with {example} fits both; distinguish them by `id` or `match`, or make one the `reply` of its request",
        )


def _spoken_of(match: Match) -> str:
    if match.of == MatchOf.ID:
        return "the id"
    return "a payload size of" if match.of == MatchOf.SIZE else f"`{match.name}`"
