"""A part of a frame by itself: from its syntax to the model. What it means among the others comes later."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from wirebond.protocol.meaning.header import run_type
from wirebond.protocol.model import BitRole, Bits, ByteOrder, End, LengthCounts, Part, PartKind, PayloadRule
from wirebond.protocol.text.frame_grammar import (
    BitsPart,
    CheckPart,
    ConstantPart,
    FieldPart,
    IdPart,
    LengthPart,
    MagicPart,
    PartSyntax,
    PayloadPart,
    ReservedPart,
    SequencePart,
    TailPart,
)

RUN_ROLES = {"id": BitRole.ID, "length": BitRole.LENGTH, "sequence": BitRole.SEQUENCE}


def lower(syntax: PartSyntax, order: ByteOrder) -> Part:
    """Return a part by itself; its condition, and a check's algorithm and range, come later."""
    if isinstance(syntax, MagicPart):
        magic = syntax.magic
        if magic.by_end:
            by_sender = tuple((End(end), value) for end, value in magic.by_end)
            return Part(PartKind.MAGIC, "", len(by_sender[0][1]), value=by_sender[0][1], by_sender=by_sender)
        alternatives = magic.values if len(magic.values) > 1 else ()
        return Part(PartKind.MAGIC, "", len(magic.values[0]), value=magic.values[0], alternatives=alternatives)
    if isinstance(syntax, ConstantPart):
        return Part(PartKind.CONSTANT, "", len(syntax.constant), value=syntax.constant)
    if isinstance(syntax, TailPart):
        return Part(PartKind.TAIL, "", len(syntax.tail), value=syntax.tail)
    if isinstance(syntax, LengthPart):
        wire = syntax.length.type
        return Part(
            PartKind.LENGTH,
            "",
            wire.size,
            wire.order or order,
            counts=LengthCounts(syntax.length.counts),
            length_offset=syntax.length.offset,
            length_unit=int(syntax.length.unit),
        )
    if isinstance(syntax, IdPart):
        return Part(PartKind.ID, "", syntax.id.size, syntax.id.order or order)
    if isinstance(syntax, ReservedPart):
        return Part(PartKind.RESERVED, "", syntax.reserved)
    if isinstance(syntax, FieldPart):
        wire = syntax.type
        return Part(PartKind.FIELD, syntax.field, wire.size, wire.order or order)
    if isinstance(syntax, SequencePart):
        return Part(PartKind.SEQUENCE, syntax.name or "sequence", syntax.sequence.size, syntax.sequence.order or order)
    if isinstance(syntax, BitsPart):
        return _lower_bits(syntax, order)
    if isinstance(syntax, PayloadPart):
        trims = syntax.trim_zeros
        if isinstance(syntax.payload, int):
            fixed = syntax.payload
            return Part(PartKind.PAYLOAD, "", 0, payload=PayloadRule.FIXED, fixed_payload=fixed, trims_zeros=trims)
        return Part(PartKind.PAYLOAD, "", 0, payload=PayloadRule(syntax.payload), trims_zeros=trims)
    assert isinstance(syntax, CheckPart)
    return Part(PartKind.CHECK, "", 0)


def _lower_bits(syntax: BitsPart, order: ByteOrder) -> Part:
    runs = []
    shift = 0
    listed = list(syntax.fields.items())
    for name, run in listed if syntax.first == "low" else reversed(listed):
        role = BitRole.CONSTANT if run.constant is not None else RUN_ROLES.get(name, BitRole.FIELD)
        role = role if run.check is None else BitRole.CHECK
        width = run_type(run).width
        runs.append(Bits(name, role, shift, width, run.constant or run.from_bit or 0))
        shift += width
    return Part(
        PartKind.BITS,
        "",
        syntax.bits.size,
        syntax.bits.order or order,
        counts=LengthCounts(syntax.counts),
        length_offset=syntax.offset,
        length_unit=int(syntax.unit),
        bits=tuple(runs),
    )


def with_runs_of_checks(parts: list[Part]) -> list[Part]:
    """Give each check among the bits of the part before it its run. It is present if that part is."""
    found: list[Part] = []
    for part in parts:
        before = found[-1] if found else part
        run = next((run for run in before.bits if run.role == BitRole.CHECK), None)
        is_run = part.kind == PartKind.CHECK and run is not None
        found.append(replace(part, in_bits=run, condition=before.condition) if is_run else part)
    return found


def holder(parts: Sequence[Part], kind: PartKind, role: BitRole) -> int | None:
    """Return the part that holds the id or the length."""
    for index, part in enumerate(parts):
        if part.kind == kind or any(run.role == role for run in part.bits):
            return index
    return None


def unique(names: list[str]) -> list[str]:
    """Give parts of one kind numbered names: `constant`, `constant_2`, …"""
    given: list[str] = []
    for name in names:
        number, candidate = 2, name
        while candidate in given or (candidate != name and candidate in names):
            candidate, number = f"{name}_{number}", number + 1
        given.append(candidate)
    return given
