"""Two layouts of the same message, field by field: moved fields, and fields that are read as something else."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from difflib import SequenceMatcher
from fractions import Fraction

from wirebond.analysis.diff.change import Change, Effect, Sides, changed, harmless
from wirebond.analysis.diff.values import value_changes
from wirebond.analysis.diff.where import Fields, Where
from wirebond.protocol.meaning.field_values import wire_limits
from wirebond.protocol.model import Field, FieldKind
from wirebond.protocol.model.layout import BitMember, members_of
from wirebond.protocol.spelling import field_type, how_counted


def field_changes(old: Fields, new: Fields, where: Where) -> Iterator[Change]:
    """Yield all changes from ``old`` to ``new``, in wire order."""
    matcher = SequenceMatcher(None, [_key(f) for f in old], [_key(f) for f in new], autojunk=False)
    moved = _moved(old, new, matcher)
    for name in moved:
        at = where.at(name, is_last=False)
        yield changed(
            at.path,
            "is at another place among the fields",
            where.everywhere("its bytes are read as another field"),
            place=at.place,
        )
    for tag, a, b, c, d in matcher.get_opcodes():
        before = tuple(f for f in old[a:b] if f.name not in moved)
        after = tuple(f for f in new[c:d] if f.name not in moved)
        is_last = b == len(old) and d == len(new)
        if tag == "equal" or _same_places(before, after):
            for index, (one, other) in enumerate(zip(before, after, strict=True)):
                last = is_last and index == len(before) - 1
                yield from _pair_changes(one, other, old, new, where.at(other.name, is_last=last))
        elif before or after:
            yield from _other_fields(before, after, where if is_last and not moved else replace(where, tail=None))


def _key(field: Field) -> str:
    return field.name if field.has_value else ""


def _moved(old: Fields, new: Fields, matcher: SequenceMatcher[str]) -> list[str]:
    kept = {old[i].name for block in matcher.get_matching_blocks() for i in range(block.a, block.a + block.size)}
    there = {f.name for f in new if f.has_value}
    return [f.name for f in old if f.has_value and f.name in there and f.name not in kept]


def _bytes(fields: Sequence[Field]) -> int | None:
    """Return the wire bytes of fields of fixed size; None if one varies."""
    return None if any(f.is_variable for f in fields) else sum(f.min_wire_bytes for f in fields)


def _same_places(before: Fields, after: Fields) -> bool:
    """Check whether as many values are at the same places, under other names."""
    if len(before) != len(after):
        return False
    return all(
        _bytes([a]) == _bytes([b]) is not None and a.has_value and b.has_value
        for a, b in zip(before, after, strict=True)
    )


def _listed(fields: Sequence[Field]) -> str:
    return ", ".join(f.name for f in fields if f.has_value) or "padding"


def _other_fields(before: Fields, after: Fields, where: Where) -> Iterator[Change]:
    """Compare fields that were added, were removed, or replaced others."""
    size, new_size = _bytes(before), _bytes(after)
    keeps_size = before and after and size is not None and size == new_size
    if keeps_size and all(not f.has_value and f.constant is None for f in before):
        yield from _in_place_of_zeros(after, where, is_new=True)
        return
    if keeps_size and all(not f.has_value and f.constant is None for f in after):
        yield from _in_place_of_zeros(before, where, is_new=False)
        return
    names = _listed(after or before)
    path, place = f"{where.path}.{names}", (*where.place, "fields", (after or before)[0].name)
    if where.tail is not None and not (before and after):
        tail = where.tail
        sentence = "is new at the end" if after else "is gone from the end"
        effects = [tail(sides, names) for sides in where.routes]
        yield changed(path, sentence, effects, place=place, gone=not after)
        return
    if before and after:
        sentence = f"stands where {_listed(before)} stood"
        effect = "the same bytes are read as other fields"
    else:
        sentence = "is new among the fields" if after else "is gone from among the fields"
        by = new_size if after else size
        effect = "everything after it moves" if by is None else f"everything after it moves by {_bytes_text(by)}"
    yield changed(path, sentence, where.everywhere(effect), place=place, gone=not after)


def _bytes_text(number: int) -> str:
    return "1 byte" if number == 1 else f"{number} bytes"


def _in_place_of_zeros(fields: Fields, where: Where, *, is_new: bool) -> Iterator[Change]:
    """Compare values that replaced padding, or padding that replaced values: nothing moves, and zeros are read for
    them."""
    named = [f for f in fields if f.has_value]
    for field in named:
        at = where.at(field.name, is_last=False)
        sentence = "is new where padding was" if is_new else "became padding"
        effects = [zeros_or_ignored(sides, field.name, is_new=is_new) for sides in where.routes]
        yield changed(at.path, sentence, effects, place=at.place, gone=not is_new)


def zeros_or_ignored(sides: Sides, name: str, *, is_new: bool) -> Effect:
    """Return the effect for a value that only one of the files has, at a place that both have.

    Zeros that are read break what was there before, and not what is new.
    """
    if sides.flow.from_new == is_new:  # the sender knows it
        return Effect(sides.flow, False, f"the {sides.receiving} ignores {name}")
    return Effect(sides.flow, not is_new, f"the {sides.receiving} always reads {name} as 0")


# ---- one field and its successor


def _pair_changes(a: Field, b: Field, old: Fields, new: Fields, where: Where) -> Iterator[Change]:
    if a == b:
        return
    if a.name != b.name and b.has_value:
        yield changed(
            where.path, f"was called {a.name}", place=where.place
        )  # the bytes stay: programs need the new name
    if not a.has_value and not b.has_value:
        if a.min_wire_bytes != b.min_wire_bytes:
            sentence = f"padding of {_bytes_text(a.size)} became {_bytes_text(b.size)}"
            yield _resized(where, sentence)
        elif (a.constant is None, a.constant_bytes) != (b.constant is None, b.constant_bytes):
            yield _other_constant(a, b, where)
        return
    layouts = [(field_type(f) if f.kind != FieldKind.STRUCT else "struct", f.packed, f.first) for f in (a, b)]
    if layouts[0] != layouts[1]:
        yield _other_type(a, b, where)
        return
    yield from _amount_changes(a, b, old, new, where)
    if a.fields or b.fields:
        inner = Where(where.path, where.place, where.routes, where.tail if a.count is None else None)
        if a.kind == FieldKind.BITS:
            yield from _bit_field_changes(a, b, where)
        else:
            yield from field_changes(a.fields, b.fields, inner)
        if a.description != b.description:
            yield harmless(where.path, "has another description", place=where.place)
        return
    yield from value_changes(a, b, where)


def _other_constant(a: Field, b: Field, where: Where) -> Change:
    effects = []
    for sides in where.routes:
        sent, read = (b, a) if sides.flow.from_new else (a, b)
        breaks = read.constant is not None and read.constant_bytes != sent.constant_bytes
        refuses = f"the {sides.receiving} takes no frame that has another value there"
        effects.append(Effect(sides.flow, breaks, refuses if breaks else "it accepts the values that are sent there"))
    return changed(where.path, "another constant, or none, is at that place", effects, place=where.place)


def _resized(where: Where, sentence: str) -> Change:
    if where.tail is not None:
        name = where.path.rpartition(".")[2]
        return changed(where.path, sentence, [where.tail(sides, name) for sides in where.routes], place=where.place)
    return changed(where.path, sentence, where.everywhere("everything after it moves"), place=where.place)


def _spelled(field: Field) -> str:
    if field.kind == FieldKind.BITS:
        return f"{field_type(field)}, from the {'lowest' if field.first == 'low' else 'highest'} on"
    return f"{field_type(field)} packed {field.packed} first" if field.packed else field_type(field)


def _other_type(a: Field, b: Field, where: Where) -> Change:
    effects = []
    for sides in where.routes:
        sent, read = (b, a) if sides.flow.from_new else (a, b)
        effects.append(_misread(sent, read, sides))
    return changed(where.path, f"{_spelled(a)} became {_spelled(b)}", effects, place=where.place)


def _misread(sent: Field, read: Field, sides: Sides) -> Effect:
    """Return the effect of another type: only integers of one size can agree, within the range of both types."""
    if sent.digits is not None and sent.digits == read.digits:
        return _misspelled(sent, read, sides)
    binary = all(one.is_integer and one.coding.is_binary for one in (sent, read))
    same_bytes = (sent.size, sent.bits, sent.packed, sent.digits) == (read.size, read.bits, read.packed, read.digits)
    same_order = sent.order == read.order or sent.size <= 1
    if not (binary and same_bytes and same_order):
        moved = _bytes([sent]) != _bytes([read])
        return Effect(
            sides.flow, True, "it is read as other values" + (", and everything after it moves" if moved else "")
        )
    least, greatest = 0, int(min(wire_limits(sent)[1], wire_limits(read)[1]))
    low, high = _sent_numbers(sent)
    if least <= low and high <= greatest:
        return Effect(sides.flow, False, "every value in its range is read as it was sent")
    return Effect(sides.flow, True, f"numbers outside {least} to {greatest} on the wire are read as others")


def _misspelled(sent: Field, read: Field, sides: Sides) -> Effect:
    """Return the effect of other digits for the same number, within the range of the reader's type."""
    least, greatest = read.whole_limits
    low, high = _sent_numbers(sent)
    if least <= low and high <= greatest:
        return Effect(sides.flow, False, "every value in its range is read as it was sent")
    return Effect(sides.flow, True, f"numbers outside {least} to {greatest} on the wire are refused")


def _sent_numbers(field: Field) -> tuple[int, int]:
    """Return the least and the greatest number that a sender may put on the wire."""
    lowest, highest = wire_limits(field)
    if field.enum:
        return min(value for _, value in field.enum), max(value for _, value in field.enum)
    if field.minimum is None or field.maximum is None:
        return int(lowest), int(highest)
    ends = sorted((Fraction(bound) - field.offset) / field.scale for bound in (field.minimum, field.maximum))
    return int(ends[0]), int(ends[1])


def _amount_changes(a: Field, b: Field, old: Fields, new: Fields, where: Where) -> Iterator[Change]:
    """Yield the changes in the number of elements or bytes, and in how they are counted."""
    if (a.count or 1, a.size) != (b.count or 1, b.size) and not (a.is_list or b.is_list):
        if a.is_characters and (a.size == 0) != (b.size == 0):
            yield _other_amount(where, "always as many bytes" if b.size else "a varying number of bytes")
        elif a.is_characters:
            yield _resized(where, f"{_bytes_text(a.size)} became {_bytes_text(b.size)}")
        else:
            yield _resized(where, f"{a.count or 1} elements became {b.count or 1}")
        return
    if (a.count is None) != (b.count is None) and not (a.is_list or b.is_list):
        yield changed(where.path, "is an array of one element in one file, and a single value in the other",
                      place=where.place)  # fmt: skip
    if a.is_list != b.is_list:
        yield _other_amount(where, "a varying number of elements" if b.is_list else "always as many elements")
        return
    if _counter(a, old) != _counter(b, new):
        yield _other_amount(where, how_counted(b) or "as many as the payload has")
        return
    if a.ends_with != b.ends_with:
        ends = ["nothing" if f.ends_with is None else f"0x{f.ends_with:02X}" for f in (a, b)]
        effects = where.everywhere("it is read at another size")
        yield changed(where.path, f"ends with {ends[1]}, and ended with {ends[0]}", effects, place=where.place)
        return
    for most, next_most, noun in ((a.max_count, b.max_count, "elements"), (a.max_size, b.max_size, "bytes")):
        if most != next_most:
            yield _other_bound(most, next_most, noun, where)


def _counter(field: Field, beside: Fields) -> list[tuple[int | None, int | None, bool]]:
    """Return the places among its fellows of the fields that count this one, of a run also that among the bits, and
    whether each counts bytes."""
    found = []
    for name, _ in field.counters:
        outer, _, run = name.partition(".")
        index = next((i for i, other in enumerate(beside) if other.name == outer), None)
        members = beside[index].fields if index is not None and run else ()
        inner = next((i for i, member in enumerate(members) if member.name == run), None)
        found.append((index, inner, field.counted_in_bytes or name == field.bytes_counted_by))
    return found


def _other_amount(where: Where, what: str) -> Change:
    sentence = f"has {what} now"
    return changed(where.path, sentence, where.everywhere("it is read at another size"), place=where.place)


def _other_bound(most: int, next_most: int, noun: str, where: Where) -> Change:
    effects = []
    for sides in where.routes:
        sent, read = (next_most, most) if sides.flow.from_new else (most, next_most)
        if sent > read:
            effects.append(
                Effect(
                    sides.flow,
                    not sides.flow.from_new,  # additions can wait
                    f"the {sides.receiving} does not act on a message with more than {read} {noun}",
                )
            )
    return changed(where.path, f"at most {most} {noun} became at most {next_most}", effects, place=where.place)


def _bit_field_changes(a: Field, b: Field, where: Where) -> Iterator[Change]:
    """Compare values that share one number: each has its own place, and unused bits are zeros."""
    before, after = _runs(a), _runs(b)
    for name, run in after.items():
        field = run.field
        at = Where(f"{where.path}.{name}", (*where.place, "bits", "fields", name), where.routes, None)
        if name not in before:
            overlaps = [other for other, earlier in before.items() if _meet(run, earlier)]
            if overlaps:
                sentence = f"stands where {', '.join(overlaps)} stood"
                yield changed(at.path, sentence, where.everywhere("the same bits are read as other fields"),
                              place=at.place)  # fmt: skip
            else:
                effects = [zeros_or_ignored(sides, name, is_new=True) for sides in where.routes]
                yield changed(at.path, "is new in free bits", effects, place=at.place)
            continue
        earlier_run = before[name]
        earlier = earlier_run.field
        unsigned = earlier.is_unsigned and field.is_unsigned
        is_whole = len(run.pieces) == len(earlier_run.pieces) == 1
        if unsigned and is_whole and earlier_run.low == run.low and earlier.width != field.width:
            yield _other_width(earlier, field, at)
            yield from value_changes(earlier, field, at)
        elif run.pieces != earlier_run.pieces:
            sentence = f"{earlier_run.text} became {run.text}"
            yield changed(at.path, sentence, where.everywhere("it is read as another value"), place=at.place)
        elif field_type(earlier) != field_type(field):
            yield _other_type(earlier, field, at)
        else:
            yield from value_changes(earlier, field, at)
    for name, run in before.items():
        if name in after:
            continue
        if any(_meet(run, later) for later in after.values()):
            continue  # reported for the field that is there now
        effects = [zeros_or_ignored(sides, name, is_new=False) for sides in where.routes]
        place = (*where.place, "bits", "fields", name)
        yield changed(f"{where.path}.{name}", "is gone; its bits are free", effects, place=place, gone=True)


def _other_width(a: Field, b: Field, where: Where) -> Change:
    """Describe more or fewer bits from the same lowest one on: small numbers are the same."""
    effects = []
    for sides in where.routes:
        sent, read = (b, a) if sides.flow.from_new else (a, b)
        if sent.width > read.width:
            sentence = f"the {sides.receiving} reads only {read.width} bits of it"
            effects.append(Effect(sides.flow, not sides.flow.from_new, sentence))  # additions can wait
    return changed(where.path, f"{a.width} bits became {b.width}", effects, place=where.place)


def _runs(field: Field) -> dict[str, BitMember]:
    return {member.field.name: member for member in members_of(field) if member.field.has_value}


def _meet(one: BitMember, other: BitMember) -> bool:
    """Check whether two values have bits in common."""
    return any(a < b + size and b < a + width for a, width in one.pieces for b, size in other.pieces)


def number_changes(a: Field, b: Field, where: Where) -> Iterator[Change]:
    """Yield the changes between two numbers with the same bits at the same place."""
    if field_type(a) != field_type(b):
        yield _other_type(a, b, where)
    else:
        yield from value_changes(a, b, where)
