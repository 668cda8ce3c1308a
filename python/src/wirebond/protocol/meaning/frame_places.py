"""Checks the order of parts in a frame, and whether a receiver can distinguish its forms."""

from __future__ import annotations

from wirebond.protocol import plan, planning
from wirebond.protocol.apart import alike
from wirebond.protocol.meaning.draft import Envelope
from wirebond.protocol.meaning.envelope import Wrong
from wirebond.protocol.meaning.messages import spoken
from wirebond.protocol.meaning.parts import holder
from wirebond.protocol.model import BitRole, End, Part, PartKind, PayloadRule
from wirebond.protocol.model.forms import header_fields, parts_of_forms
from wirebond.protocol.problems import Place
from wirebond.protocol.spelling import choices_text
from wirebond.protocol.text.yaml_tree import Mapping

_ONCE = (PartKind.MAGIC, PartKind.TAIL, PartKind.LENGTH, PartKind.ID, PartKind.PAYLOAD)


def validate_bits(parts: list[Part], nodes: list[Mapping], wrong: Wrong) -> None:
    for part, node in zip(parts, nodes, strict=True):
        if part.kind != PartKind.BITS:
            continue
        fields = node.get("fields")
        assert isinstance(fields, Mapping)
        width = sum(run.width for run in part.bits)
        if width != 8 * part.size:
            wrong(
                node.value_place("fields"),
                f"these runs have {width} bits together, and the part has {8 * part.size}; "
                "add a `reserved` run, or change a width",
            )
        for run in part.bits:
            if run.role == BitRole.CONSTANT and run.value > run.mask:
                wrong(fields.key_place(run.name), f"{run.value} does not fit {run.width} bits; take less")


def validate_places(parts: list[Part], nodes: list[Mapping], place: Place, envelope: Envelope, wrong: Wrong) -> None:
    kinds = [part.kind for part in parts]
    for kind in _ONCE:
        found = [i for i, other in enumerate(kinds) if other == kind]
        exclusive = len({parts[i].condition for i in found}) == len(found) and None not in {
            parts[i].condition for i in found
        }
        for index in [] if exclusive else found[1:]:
            wrong(
                nodes[index].place,
                f"a frame has one `{kind}` part at most; remove this one, or give each its own `when:`",
            )
    if PartKind.PAYLOAD not in kinds:
        wrong(place, "the frame has no payload; add a part such as `- payload: by_length`")
        return
    payload_index = kinds.index(PartKind.PAYLOAD)
    magics = [index for index, kind in enumerate(kinds) if kind == PartKind.MAGIC]
    if magics != list(range(len(magics))):
        index = next(index for number, index in enumerate(magics) if index != number)
        wrong(nodes[index].place, "a magic begins the frame; put it first, or write `constant` here")
    if PartKind.TAIL in kinds[:-1]:
        index = kinds.index(PartKind.TAIL)
        wrong(nodes[index].place, "a tail ends the frame; put it last, or write `constant` here")
    if len({parts[index].size for index in magics}) > 1:
        wrong(
            nodes[magics[-1]].place,
            "magics of one frame need the same number of bytes; pad with a `constant` part",
        )
    _validate_payload_rule(parts, nodes, payload_index, envelope, wrong)
    constants = sum(len(part.value) for part in parts if part.condition is None)
    for limit, number, what in (
        (plan.MAX_CONSTANTS, constants, "bytes of magic, constants and tail"),
        (plan.MAX_CHECKS, kinds.count(PartKind.CHECK), "checks"),
    ):
        if number > limit:
            wrong(place, f"the frame has {number} {what}; at most {limit} are possible")


def _validate_payload_rule(
    parts: list[Part], nodes: list[Mapping], payload_index: int, envelope: Envelope, wrong: Wrong
) -> None:
    rule, at = parts[payload_index].payload, nodes[payload_index].value_place("payload")
    length = holder(parts, PartKind.LENGTH, BitRole.LENGTH)
    message_id = holder(parts, PartKind.ID, BitRole.ID)
    if rule == PayloadRule.BY_LENGTH and length is None:
        wrong(at, "`payload: by_length` needs a length; add a part such as `- length: u8` before it")
    if rule != PayloadRule.BY_LENGTH and length is not None:
        wrong(nodes[length].place, "this length is not used; write `payload: by_length`, or remove it")
    if rule == PayloadRule.BY_LENGTH and length is not None and length > payload_index:
        wrong(nodes[length].place, "the length must precede the payload, because it gives its size; move it")
    if rule == PayloadRule.BY_ID and message_id is not None and message_id > payload_index:
        wrong(nodes[message_id].place, "the id must precede the payload, because it determines its size; move it")
    if rule == PayloadRule.REST and envelope.delimiter is None and envelope.silence is None:
        wrong(at, "`payload: rest` needs delimiters or a silence, which say where the frame ends; or write by_length")


def validate_forms(parts: list[Part], place: Place, wrong: Wrong) -> None:
    """Check that each end has forms, that each of them is complete, and that there are not too many."""
    whole = tuple(parts)
    for form_parts in parts_of_forms(whole, None):
        for kind, role in (
            (PartKind.MAGIC, None),
            (PartKind.ID, BitRole.ID),
            (PartKind.LENGTH, BitRole.LENGTH),
        ):
            held = [p for p in form_parts.parts if p.kind == kind or any(r.role == role for r in p.bits)]
            if len(held) > 1:
                wrong(
                    place,
                    f"one frame can contain two parts with a {kind.value}; make their `when:` exclude each other",
                )
    for end in (End.HOST, End.MCU):
        if not parts_of_forms(whole, end):
            wrong(
                place,
                f"frames of the {spoken(end)} have no magic; give them one, such as "
                f"`{{magic: 0xAA, when: sender == {end.value}}}`",
            )
    for limit, found, what in (
        (plan.MAX_FORMS, len(parts_of_forms(whole, None)), "forms (by magics and conditions)"),
        (plan.MAX_HEADER_FIELDS, len(header_fields(whole)), "fields in its header"),
    ):
        if found > limit:
            wrong(place, f"the frame has {found} {what}; at most {limit} are possible")


def validate_told_apart(parts: tuple[Part, ...], place: Place, wrong: Wrong) -> None:
    """Validate that a receiver can distinguish the forms of each end, with few comparisons."""
    for end in (End.HOST, End.MCU, None):  # None: a receiver that hears both
        forms = planning.forms(parts, end)
        tested = sum(len(form.exclusions) for form in forms)
        if tested > plan.MAX_EXCLUSIONS:
            wrong(
                place,
                f"the conditions of this frame need {tested} comparisons of a receiver; at most "
                f"{plan.MAX_EXCLUSIONS} are possible: write fewer values, or ranges",
            )
            return
        pair = None if end is None else alike(parts, end)
        if pair is not None:
            one, other = (choices_text(tuple(held.choice for held in form.choices)) for form in pair)
            wrong(
                place,
                f"a receiver cannot distinguish a frame with `{one}` from one with `{other}`; make them differ in a "
                "byte before the payload, by a magic or a constant of their own",
            )
            return
