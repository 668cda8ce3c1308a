"""Two fields with the same bytes: what they mean, and what is refused."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

from wirebond.analysis.diff.change import Change, Effect, changed, harmless
from wirebond.analysis.diff.where import Where
from wirebond.protocol.meaning.field_values import number_text, wire_limits
from wirebond.protocol.model import Field, OnRange


def value_changes(a: Field, b: Field, where: Where) -> Iterator[Change]:
    """Yield the changes between two fields with the same bytes: their meaning, and which values are refused."""
    if (a.scale, a.offset) != (b.scale, b.offset):
        yield _other_scale(a, b, where)
    if a.unit != b.unit:
        told = "the same number means another quantity there; if only the spelling was corrected, nothing breaks"
        effects = [Effect(s.flow, bool(a.unit and b.unit), told) for s in where.routes]
        sentence = f"unit {a.unit or 'none'} became {b.unit or 'none'}"
        yield changed(where.path, sentence, effects, place=where.place)
    if a.clock != b.clock:
        sentence = "is now read as a time of the MCU's clock" if b.clock else "is not read as a time any more"
        yield harmless(where.path, sentence, place=where.place)
    if a.enum != b.enum:
        yield from _enum_changes(a, b, where)
    if a.flags != b.flags:
        yield from _flag_changes(a, b, where)
    if (a.minimum, a.maximum, a.on_range) != (b.minimum, b.maximum, b.on_range):
        yield _other_range(a, b, where)
    if a.default != b.default:
        sentence = f"default {_default_text(a)} became {_default_text(b)}"
        yield harmless(where.path, sentence, place=where.place)
    if a.description != b.description:
        yield harmless(where.path, "has another description", place=where.place)


def _default_text(field: Field) -> str:
    return "none" if field.default is None else str(field.default)


def _other_scale(a: Field, b: Field, where: Where) -> Change:
    said = []
    if a.scale != b.scale:
        said.append(f"scale {number_text(a.scale)} became {number_text(b.scale)}")
    if a.offset != b.offset:
        said.append(f"offset {number_text(a.offset)} became {number_text(b.offset)}")
    effects = []
    for sides in where.routes:
        sent, read = (b, a) if sides.flow.from_new else (a, b)
        wire = _telling_number(sent)
        values = [number_text(wire * f.scale + f.offset) + (f" {f.unit}" if f.unit else "") for f in (sent, read)]
        effects.append(Effect(sides.flow, True, f"{values[0]} arrives as {values[1]}"))
    return changed(where.path, ", ".join(said), effects, place=where.place)


def _telling_number(field: Field) -> Fraction:
    """Return a number on the wire that makes a good example: the one of the value 1, if it has one."""
    wire = (1 - field.offset) / field.scale
    if field.is_float:
        return wire
    lowest, highest = wire_limits(field)
    return wire if wire.denominator == 1 and wire != 0 and lowest <= wire <= highest else Fraction(1)


def _enum_changes(a: Field, b: Field, where: Where) -> Iterator[Change]:
    before, after = dict(a.enum), dict(b.enum)
    if not before or not after:
        sentence = "has names for its numbers now" if after else "has no names for its numbers any more"
        effects = [
            Effect(s.flow, False, f"the {s.receiving} does not act on a message with a number that has no name")
            for s in where.routes
            if s.flow.from_new == bool(before)
        ]
        yield changed(where.path, sentence, effects, place=where.place)
        return
    names, new_names = ({value: name for name, value in reversed(pairs)} for pairs in (a.enum, b.enum))
    for name, value in after.items():
        at = f"{where.path} = {name}"
        place = (*where.place, "enum", name)
        if name in before and before[name] != value:
            effects = []
            for s in where.routes:
                sent = value if s.flow.from_new else before[name]
                read = (names if s.flow.from_new else new_names).get(sent, f"{sent}, which has no name there")
                effects.append(Effect(s.flow, True, f"{name} arrives as {read}"))
            yield changed(at, f"was {before[name]}, is {value}", effects, place=place)
        elif name not in before and value in names:
            if names[value] not in after:
                yield changed(at, f"was called {names[value]}", place=place)
        elif name not in before:
            effects = [
                Effect(s.flow, False, f"the {s.receiving} does not act on a message with it")
                for s in where.routes
                if s.flow.from_new
            ]
            yield changed(at, f"is new, {value}", effects, place=place)
    for name, value in before.items():
        if name not in after and value not in new_names:
            effects = [
                Effect(s.flow, True, f"the {s.receiving} does not act on a message with it")
                for s in where.routes
                if not s.flow.from_new
            ]
            place = (*where.place, "enum", name)
            yield changed(f"{where.path} = {name}", f"is gone; it was {value}", effects, place=place, gone=True)


def _flag_changes(a: Field, b: Field, where: Where) -> Iterator[Change]:
    before, after = dict(a.flags), dict(b.flags)
    names, new_names = ({bit: name for name, bit in pairs} for pairs in (a.flags, b.flags))
    for name, bit in after.items():
        at, place = f"{where.path} = {name}", (*where.place, "flags", name)
        if name in before and before[name] != bit:
            effects = []
            for s in where.routes:
                sent = bit if s.flow.from_new else before[name]
                read = (names if s.flow.from_new else new_names).get(sent, f"bit {sent}, which has no name there")
                effects.append(Effect(s.flow, True, f"{name} arrives as {read}"))
            yield changed(at, f"was bit {before[name]}, is bit {bit}", effects, place=place)
        elif name not in before and bit in names and names[bit] not in after:
            yield changed(at, f"was called {names[bit]}", place=place)
        elif name not in before:
            effects = [
                Effect(s.flow, False, f"the {s.receiving} has no name for it") for s in where.routes if s.flow.from_new
            ]
            yield changed(at, f"is new, bit {bit}", effects, place=place)
    for name, bit in before.items():
        if name in after or bit in new_names:
            continue
        effects = [
            Effect(s.flow, s.flow.from_new, f"the {s.receiving} never sees it set")
            if s.flow.from_new
            else Effect(s.flow, False, f"the {s.receiving} has no name for it")
            for s in where.routes
        ]
        place = (*where.place, "flags", name)
        yield changed(f"{where.path} = {name}", f"is gone; it was bit {bit}", effects, place=place, gone=True)


def _other_range(a: Field, b: Field, where: Where) -> Change:
    sentence = f"range {_range_text(a)} became {_range_text(b)}"
    effects = []
    for s in where.routes:
        sent, read = (b, a) if s.flow.from_new else (a, b)
        if read.minimum is None or read.maximum is None:
            continue
        wider = sent.minimum is None or sent.maximum is None
        if wider or (sent.minimum or 0) < read.minimum or (sent.maximum or 0) > read.maximum:
            act = "does not act on" if read.on_range == OnRange.REJECT else "clamps"
            effects.append(Effect(s.flow, False, f"the {s.receiving} {act} values outside {_range_text(read)}"))
    if not effects:
        return harmless(where.path, sentence, place=where.place)
    return changed(where.path, sentence, effects, place=where.place)


def _range_text(field: Field) -> str:
    if field.minimum is None or field.maximum is None:
        return "none"
    unit = f" {field.unit}" if field.unit else ""
    on_range = ", clamp" if field.on_range == OnRange.CLAMP else ""
    return f"{number_text(Fraction(field.minimum))} to {number_text(Fraction(field.maximum))}{unit}{on_range}"
