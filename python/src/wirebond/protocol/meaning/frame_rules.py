"""Checks the rules for a whole frame with its envelope, so that a receiver can read it."""

from __future__ import annotations

from wirebond.protocol import plan, planning
from wirebond.protocol.meaning.draft import Draft, Envelope
from wirebond.protocol.meaning.envelope import Wrong
from wirebond.protocol.meaning.parts import holder
from wirebond.protocol.model import BitRole, Part, PartKind
from wirebond.protocol.problems import Place
from wirebond.protocol.spelling import bytes_text

_FIXED_BYTES = (PartKind.MAGIC, PartKind.CONSTANT, PartKind.TAIL)


def validate_whole(draft: Draft, place: Place, wrong: Wrong) -> None:
    parts = draft.parts
    if draft.envelope == Envelope() and not any(_tells(part) for part in parts):
        wrong(
            place,
            "nothing distinguishes this frame from other bytes; add `- magic: 0xAA` at the front or a check at the end",
        )
    forms = planning.forms(parts, None)
    constants = max(len(form.constants) for form in forms)
    if constants > plan.MAX_CONSTANTS:
        wrong(
            place,
            f"the frame has {constants} constant bytes, those of bits and of conditions counted; "
            f"at most {plan.MAX_CONSTANTS} are possible",
        )
    _validate_seeds(draft, wrong)
    _validate_unstuffed_constants(draft, wrong)
    _validate_sized(draft, wrong)
    _validate_first(draft, wrong)
    _validate_digit(draft, wrong)
    length = draft.length_part
    if length is None:
        return
    longest = min(form.most_payload for form in forms)  # of each form: its own length must allow an empty payload
    at = draft.places[parts.index(length)]
    shortest = max(form.length_bias for form in forms)  # of the form with the fewest parts beside the payload
    if length.length_unit > 1 and draft.payload.trims_zeros:
        wrong(
            draft.places[draft.payload_index],
            f"with `trim_zeros` a payload may end at any byte, and this length counts by {length.length_unit}; "
            "remove one of the two",
        )
    if longest < 0:
        wrong(at, "the length cannot express its count even for an empty payload; choose a wider type")
    elif shortest > 0:
        wrong(
            at,
            f"with this offset a payload under {shortest} bytes would have a negative length; take a greater one",
        )


def _validate_unstuffed_constants(draft: Draft, wrong: Wrong) -> None:
    envelope = draft.envelope
    marks = [mark for mark in (envelope.opening, envelope.delimiter) if mark is not None]
    for part, place in zip(draft.parts, draft.places, strict=True):
        if envelope.stuffing.hides_delimiters and not part.is_plain:
            continue
        held = next((mark for mark in marks if mark in part.value), None)
        if held is not None:
            wrong(
                place,
                f"this {part.kind} holds the delimiter {bytes_text(held)} and is not stuffed, so that "
                "every frame is cut here; take another delimiter, or stuff this part",
            )


def _validate_sized(draft: Draft, wrong: Wrong) -> None:
    """Validate a stuffed frame that ends by its length: some parts must be known before it is unstuffed."""
    if not draft.is_sized:
        return
    first = [part.is_plain for part in draft.parts].index(False)
    for index, (part, place) in enumerate(zip(draft.parts, draft.places, strict=True)):
        if part.on_wire and index < draft.payload_index and part.last_covered >= first:
            wrong(place, "a check over the stuffed bytes must follow them; move it after the payload")
    length = draft.length_part
    if length is None or not length.is_plain:
        return
    at = draft.parts.index(length)
    if length.length_unit > 1:
        wrong(draft.places[at], "this length counts the bytes on the line, so it cannot count words; remove `unit`")
    for part, place in zip(draft.parts, draft.places, strict=True):
        if (
            part.kind == PartKind.CHECK
            and not part.is_plain
            and any(i == at or draft.parts[i].on_wire for i in part.covered)
        ):
            wrong(
                place,
                "this check is calculated before stuffing and covers the length, which counts the stuffed bytes, or "
                "a check over it; begin its range after them, or move the check out of the stuffed parts",
            )


def _validate_first(draft: Draft, wrong: Wrong) -> None:
    """If a doubled byte alone opens a frame: check that the byte after it shows this."""
    if not draft.envelope.opens_alone:
        return
    first, taken = draft.parts[0], draft.forbidden_first
    if first.kind in _FIXED_BYTES and not any(value[0] in taken for value in (first.value, *first.alternatives)):
        return
    if first.kind == PartKind.ID:
        return  # whose values are compared where the messages are known
    wrong(
        draft.places[0],
        f"a delimiter of one byte opens this frame, so its first byte must never be {bytes_text(taken[:1])} or "
        f"{bytes_text(taken[1:])}; let it begin with its id or a constant that is neither",
    )


def _validate_digit(draft: Draft, wrong: Wrong) -> None:
    """Validate that a byte that is sent as one digit is below 16. The ids are compared later, when the messages are
    known."""
    if draft.one_digit is None:
        return
    first = draft.parts[draft.one_digit]
    is_id = first.kind == PartKind.ID and first.size == 1
    if first.condition is None and (is_id or (first.kind == PartKind.CONSTANT and first.value[0] < 16)):
        return
    wrong(
        draft.places[draft.one_digit],
        "this byte is sent as one digit, so it is below 16 in every frame; let the parts begin with `id: u8`, or "
        "with a constant of 0x00 to 0x0F",
    )


def _validate_seeds(draft: Draft, wrong: Wrong) -> None:
    """Validate seeds: a check of the header alone is compared before the bytes after the payload have arrived."""
    payload_index = draft.payload_index
    id_index = holder(draft.parts, PartKind.ID, BitRole.ID)
    if id_index is None or id_index < payload_index:
        return
    for index, part in enumerate(draft.parts):
        if part.seeded and index < payload_index and part.last_covered < payload_index:
            wrong(
                draft.places[index],
                "this check includes the message's seed, but the id that identifies the message is after the "
                "payload; move the id before it, or this check after the id",
            )


def _tells(part: Part) -> bool:
    """Return whether this part distinguishes a frame from other bytes: eight constant bits do."""
    constant = sum(run.width for run in part.bits if run.role == BitRole.CONSTANT)
    return part.kind in (*_FIXED_BYTES, PartKind.CHECK) or constant >= 8
