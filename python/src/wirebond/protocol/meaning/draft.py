"""A frame whose parts are right by themselves, and what it decides together with its messages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from wirebond.protocol.meaning.carried import uncarried
from wirebond.protocol.meaning.messages import Messages
from wirebond.protocol.model import (
    BitRole,
    ByteOrder,
    End,
    Escapes,
    Field,
    FrameFormat,
    Insertion,
    Message,
    Part,
    PartKind,
    PayloadRule,
    Stuffing,
)
from wirebond.protocol.model.forms import MAX_SIZE, parts_of_forms
from wirebond.protocol.payload_rules import MAX_COUNTS, payload_rules
from wirebond.protocol.planning import forms
from wirebond.protocol.problems import Place, Problems
from wirebond.protocol.text.yaml_tree import Mapping

STRONG_CHECK_BITS = 16  # from here on a frame of unknown id is taken for a newer peer's, not for noise


@dataclass(frozen=True)
class Envelope:
    """The envelope around the parts: delimiters, stuffing, silence."""

    delimiter: bytes | None = None
    opening: bytes | None = None
    stuffing: Stuffing = Stuffing.NONE
    escapes: Escapes | None = None
    insertion: Insertion | None = None
    silence: float | None = None  # seconds

    @property
    def opens_alone(self) -> bool:
        """Does the doubled byte alone open a frame, and the same byte with another close it?"""
        return self.escapes is not None and self.escapes.doubles and self.opening is not None and len(self.opening) == 1


@dataclass(frozen=True)
class Draft:
    """A frame's parts, right by themselves; what the messages decide is still open."""

    parts: tuple[Part, ...]
    places: tuple[Place, ...]  # of each part
    envelope: Envelope

    def part(self, kind: PartKind) -> Part | None:
        return next((part for part in self.parts if part.kind == kind), None)

    @property
    def is_sized(self) -> bool:
        """Is it stuffed, and ended by its length?"""
        return self.envelope.delimiter is None and self.envelope.stuffing != Stuffing.NONE

    @property
    def forbidden_first(self) -> bytes:
        """Return the values that the first byte of a frame must not have if a doubled byte alone opens it."""
        return (self.envelope.delimiter or b"") if self.envelope.opens_alone else b""

    @property
    def one_digit(self) -> int | None:
        """The part whose first byte is sent as one hex digit."""
        if self.envelope.stuffing != Stuffing.HEX_AFTER_DIGIT:
            return None
        return [part.is_plain for part in self.parts].index(False)

    @property
    def payload_index(self) -> int:
        return next(i for i, part in enumerate(self.parts) if part.kind == PartKind.PAYLOAD)

    @property
    def payload(self) -> Part:
        return self.parts[self.payload_index]

    @property
    def id_bits(self) -> int:
        """Bits of the id, of the widest where several forms of the frame have one; 0 where none has."""
        digit = self.one_digit
        wholes = [4 if at == digit else 8 * part.size for at, part in enumerate(self.parts) if part.kind == PartKind.ID]
        runs = [run.width for part in self.parts for run in part.bits if run.role == BitRole.ID]
        return max((*wholes, *runs), default=0)

    def has_id_from(self, end: End, *, always: bool = False) -> bool:
        """Return whether some or all frames of this end have an id: a part may belong to one magic only."""
        found = [form.id is not None for form in forms(self.parts, end)]
        return all(found) if always else any(found)

    @property
    def length_part(self) -> Part | None:
        found = (
            part
            for part in self.parts
            if part.kind == PartKind.LENGTH or any(run.role == BitRole.LENGTH for run in part.bits)
        )
        return next(found, None)

    def longest_by_length(self, sender: End | None = None) -> int | None:
        """Return the longest payload that a length can give, of all forms that frames of this sender have; None without
        a length. A message of both ends must fit the forms of each. Where the length counts the bytes on the wire, at
        most ``MAX_SIZE``."""
        if self.length_part is None:
            return None
        ends = (End.HOST, End.MCU) if sender == End.BOTH else (sender,)
        longest = min(max(form.most_payload for form in forms(self.parts, end)) for end in ends)
        if not (self.is_sized and self.length_part.is_plain):
            return longest
        form = forms(self.parts, None)[0]
        outside = form.prefix + form.suffix
        return next((p for p in range(min(longest, MAX_SIZE), 0, -1) if p + self._overhead(outside + p) <= longest), 0)

    def _overhead(self, size: int) -> int:
        """Return the maximum number of bytes that stuffing adds to a frame that its length ends."""
        insertion = self.envelope.insertion
        return size if insertion is None else size // len(insertion.after)

    @property
    def is_strong(self) -> bool:
        """Has every frame of either end a check of 16 bits or more that covers its id, length and payload?"""
        return all(_is_strong(form.parts) for end in (End.HOST, End.MCU) for form in parts_of_forms(self.parts, end))


def _is_strong(parts: tuple[Part, ...]) -> bool:
    telling = (PartKind.ID, PartKind.LENGTH, PartKind.PAYLOAD, PartKind.BITS)
    said = [i for i, p in enumerate(parts) if p.kind in telling]
    return any(
        min(part.check_bits, part.algorithm.kept.bit_count()) >= STRONG_CHECK_BITS
        and not part.seeded
        and set(range(min(said), max(said) + 1)) - {index} <= set(part.covered)
        for index, part in enumerate(parts)
        if part.algorithm is not None
    )


def validate_sizes(
    draft: Draft, messages: Messages, max_payload: int | None, problems: Problems, max_place: Place
) -> int:
    """Return the frame's maximum payload in bytes, after validation. ``max_payload``: the file's; None: the
    largest message's."""
    rule = draft.payload.payload
    complete = [(entry, entry.complete) for entry in messages.values()]
    largest = max((message.max_payload for _, message in complete if message is not None), default=0)
    for entry, message in complete:
        if message is None:
            continue
        limit_of, limit = _limit(draft, message.sender, max_payload)
        if limit is not None and message.max_payload > limit:
            problems.add(entry.place, f"`{entry.name}` has up to {message.max_payload} payload bytes; {limit_of}")
        untold = _size_untold(draft, message)
        if untold:
            problems.add(entry.place, f"`{entry.name}` has {message.max_payload} payload bytes; {untold}")
        elif limit is None or message.max_payload <= limit:
            fault = uncarried(draft.parts, draft.id_bits, message)
            if fault:
                problems.add(entry.place, fault)
        field = next((one for one in message.fields if _needs_size(message.fields, one, draft.payload)), None)
        fields = entry.node.get("fields")
        if field is not None and isinstance(fields, Mapping):
            problems.add(fields.key_place(field.name), _varying(field, draft.payload))
        _validate_rules(draft, message, fields, problems)
    if max_payload is None:
        return draft.payload.fixed_payload if rule == PayloadRule.FIXED else largest
    if rule == PayloadRule.FIXED and max_payload != draft.payload.fixed_payload:
        problems.add(
            max_place,
            f"every payload has {draft.payload.fixed_payload} bytes in this frame; remove `max_payload`",
        )
    longest = draft.longest_by_length()
    if longest is not None and max_payload > longest:
        problems.add(
            max_place,
            f"the frame's length can express {longest} payload bytes at most; use fewer, or widen it",
        )
    return max_payload


def _validate_rules(draft: Draft, message: Message, fields: object, problems: Problems) -> None:
    """Check that constants are at places where a receiver can find them."""
    rules = payload_rules(message)
    if not isinstance(fields, Mapping):
        return
    for name, fault in rules.faults:
        problems.add(fields.key_place(name), fault)
    tell_size = draft.payload.payload == PayloadRule.BY_ID and rules.tells_size and len(rules.counts) > MAX_COUNTS
    if tell_size:
        problems.add(
            fields.place,
            f"{len(rules.counts)} fields vary in number here; with `payload: by_id` at most {MAX_COUNTS} can",
        )
    if not rules.faults and rules.needed_counts > MAX_COUNTS and not tell_size:
        problems.add(
            fields.place,
            f"a constant follows {rules.needed_counts} fields of varying size; at most {MAX_COUNTS} are possible: "
            "move it before some of them",
        )


def _size_untold(draft: Draft, message: Message) -> str:
    """Return why a length that counts words cannot express the size of a message of one size; empty if it can."""
    if message.min_payload != message.max_payload:
        return ""
    own = forms(draft.parts, message.sender)
    form = max(own, key=lambda form: form.most_payload)
    if (
        form.length_unit == 1
        or message.max_payload > form.most_payload
        or any(form.carries(message.max_payload) for form in own)
    ):
        return ""
    over = (message.max_payload - form.length_bias) % form.length_unit
    return (
        f"the frame's length counts by {form.length_unit} and cannot express this size; add "
        f"`{{type: padding, size: {form.length_unit - over}}}`"
    )


def _needs_size(fields: tuple[Field, ...], field: Field, payload: Part) -> bool:
    """Check whether this field cannot be read without the payload's size, which the frame does not give."""
    if payload.payload == PayloadRule.BY_ID:
        up_to_it = fields[: fields.index(field) + 1]
        return field.is_variable and not payload_rules(Message("", 0, End.BOTH, up_to_it)).tells_size
    if payload.trims_zeros:  # of a text alone no zeros are missed
        return field.is_variable and not (field.value_type is str and field.reaches_end)
    return payload.payload == PayloadRule.FIXED and field.reaches_end


def _varying(field: Field, payload: Part) -> str:
    if payload.trims_zeros:
        return (
            f"`{field.name}` varies in size, and with `trim_zeros` zeros at its end would be lost; give it a fixed size"
        )
    if field.reaches_end:
        return (
            f"`{field.name}` reaches to the payload's end, but this frame does not show where that is; write `size` "
            "instead of `max`, or use a frame with a length"
        )
    return (
        f"`{field.name}` varies in size, and no count of the message gives its size; with `payload: by_id` let a "
        "field count it (`count: number`), or use a frame with a length"
    )


def _limit(draft: Draft, sender: End, max_payload: int | None) -> tuple[str, int | None]:
    """Return the tightest bound on a message's payload, in words and in bytes."""
    bounds: list[tuple[int, Callable[[int], str]]] = [
        (MAX_SIZE, lambda n: f"a payload has at most {n}"),
    ]
    if draft.payload.payload == PayloadRule.FIXED:
        bounds.append(
            (
                draft.payload.fixed_payload,
                lambda n: f"this frame carries {n}; shorten it, or widen the frame's payload",
            )
        )
    longest = draft.longest_by_length(sender)
    if longest is not None:
        bounds.append((longest, lambda n: f"the frame's length can express {n} at most; widen its type"))
    if max_payload is not None:
        bounds.append((max_payload, lambda n: f"`max_payload` is {n}; raise that, or shorten the message"))
    limit, words = min(bounds, key=lambda bound: bound[0])
    return words(limit), limit


def delivers_unknown(draft: Draft, unknown: str | None, problems: Problems, place: Place) -> bool:
    if draft.payload.payload == PayloadRule.BY_ID:
        if unknown == "deliver":
            problems.add(
                place,
                "with `payload: by_id` the size of an unknown message is not known; write `unknown: reject`",
            )
        return False
    seeded = any(part.seeded for part in draft.parts)
    if seeded and unknown == "deliver":
        problems.add(
            place, "a check with `seed: message` cannot be verified for an unknown message; write `unknown: reject`"
        )
    if seeded:
        return False
    return draft.is_strong if unknown is None else unknown == "deliver"


def validate_first_bytes(draft: Draft, messages: Messages, problems: Problems) -> None:
    """If a doubled byte alone opens a frame that begins with its id: refuse ids that look like the rest of a
    delimiter."""
    first, taken = draft.parts[0], draft.forbidden_first
    if first.kind != PartKind.ID or not taken:
        return
    for entry in messages.values():
        message = entry.complete
        if message is None:
            continue
        begin = message.id >> (8 * (first.size - 1) if first.order == ByteOrder.BIG else 0) & 0xFF
        if begin in taken:
            problems.add(
                entry.place,
                f"the frame of `{entry.name}` would begin with 0x{begin:02X} after the delimiter 0x{taken[0]:02X}, "
                "which looks like a doubled byte or the end of a frame; choose another id",
            )


def skips_failed(draft: Draft, resync: str, problems: Problems, place: Place) -> bool:
    envelope = draft.envelope
    brackets = envelope.opening is not None and envelope.opening != envelope.delimiter
    by_start = envelope.delimiter is None and envelope.silence is None
    if resync == "strict" and by_start and envelope.stuffing != Stuffing.NONE:
        problems.add(place, "a stuffed frame that its length ends is always looked through again; remove `resync`")
    elif resync == "strict" and not by_start and not brackets:
        problems.add(place, "a failed frame ends at its delimiter or silence here, and is skipped; remove `resync`")
    return resync == "strict"


def longest_sent(draft: Draft, messages: Messages) -> tuple[tuple[End, int], ...]:
    """Return the largest payload of each end's messages, which bounds that end's frames where the file gives no
    bound."""
    if draft.payload.payload == PayloadRule.FIXED:
        return ()
    read = [entry.message for entry in messages.values() if entry.message is not None]
    return tuple((end, max((m.max_payload for m in read if m.sent_by(end)), default=0)) for end in (End.HOST, End.MCU))


def finish(
    draft: Draft,
    max_payload: int,
    deliver_unknown: bool,
    is_strict: bool,
    longest: tuple[tuple[End, int], ...],
) -> FrameFormat:
    return FrameFormat(
        parts=draft.parts,
        max_payload=max_payload,
        deliver_unknown=deliver_unknown,
        delimiter=draft.envelope.delimiter,
        opening=draft.envelope.opening,
        stuffing=draft.envelope.stuffing,
        escapes=draft.envelope.escapes,
        insertion=draft.envelope.insertion,
        ends_by_silence=draft.envelope.silence is not None,
        is_strict=is_strict,
        longest_sent=longest,
    )
