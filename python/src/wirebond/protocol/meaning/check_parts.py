"""The checks of a frame among its other parts: what they cover, where they are, and in which order they are known."""

from __future__ import annotations

from dataclasses import replace

from wirebond.protocol.meaning.checks import algorithm_of
from wirebond.protocol.meaning.draft import Envelope
from wirebond.protocol.meaning.envelope import Wrong
from wirebond.protocol.meaning.parts import holder
from wirebond.protocol.model import BitRole, ByteOrder, Part, PartKind, Stuffing
from wirebond.protocol.problems import Place, suggestion
from wirebond.protocol.text.check_grammar import Check as CheckSyntax
from wirebond.protocol.text.yaml_tree import Mapping

MOST_DECIMAL_BYTES = 4  # of a check in decimal digits


class ChecksAmongParts:
    """Lowers the checks of a frame whose other parts are known.

    :param parts: all of the frame; the caller puts each lowered check in its place.
    :param names: of the parts, as `over` says them.
    :param order: byte order of the file.
    """

    def __init__(self, parts: list[Part], names: list[str], order: ByteOrder, wrong: Wrong) -> None:
        self._parts, self._names, self._order, self._wrong = parts, names, order, wrong

    def lower(self, index: int, check: CheckSyntax, node: Mapping) -> Part:
        """Return the check at this place of the frame, with its algorithm and what it covers."""
        part = self._parts[index]
        options = node.get("check")
        where = options if isinstance(options, Mapping) else Mapping(node.value_place("check"))
        order = ByteOrder(check.byte_order) if check.byte_order else self._order
        algorithm = algorithm_of(check, where, order, self._wrong)
        size, shift = (algorithm.width + 7) // 8, 0
        as_hex, as_decimal = check.text == "hex", check.text == "decimal"
        if part.in_bits is not None:
            return self._lower_run(index, replace(part, algorithm=algorithm), check, where, node)
        if check.byte is not None:
            shift = algorithm.width - 8 if check.byte == "high" else 0
            if size == 1:
                self._wrong(where.key_place("byte"), "a check of 8 bits has one byte; remove `byte`")
            size = 1
        ranges: tuple[tuple[int, int], ...] = ((0, index - 1),)
        if check.over is not None:
            ranges = self._lower_ranges(index, check.over, where.value_place("over"))
        elif index == 0:
            self._wrong(
                node.place, "nothing precedes this check; move it after the parts that it covers, or write `over:`"
            )
        return replace(
            part,
            size=2 * size if as_hex else size,
            order=ByteOrder.BIG if as_decimal else order,
            as_hex=as_hex,
            as_decimal=as_decimal,
            seeded=check.seed is not None,
            algorithm=algorithm,
            ranges=ranges,
            shift=shift,
        )

    def _lower_run(self, index: int, part: Part, check: CheckSyntax, where: Mapping, node: Mapping) -> Part:
        """Return a check that has some bits of the part before it."""
        run, algorithm = part.in_bits, part.algorithm
        assert run is not None
        assert algorithm is not None
        for key in ("byte", "byte_order", "text"):
            if getattr(check, key) is not None:
                instead = "write `from_bit` beside `bits`" if key == "byte" else "remove it"
                self._wrong(where.key_place(key), f"`{key}` is for a check with bytes of its own; {instead}")
        if run.value + run.width > algorithm.width:
            self._wrong(
                node.place,
                f"the check has {algorithm.width} bits, and this run would be bits {run.value} to "
                f"{run.value + run.width - 1} of them; take fewer",
            )
        ranges: tuple[tuple[int, int], ...] = ((0, index - 2),)
        if check.over is not None:
            ranges = self._lower_ranges(index, check.over, where.value_place("over"))
        elif index == 1:
            self._wrong(node.place, "nothing precedes this check; write the parts that it covers under `over:`")
        return replace(part, seeded=check.seed is not None, ranges=ranges, shift=run.value)

    def _lower_ranges(self, check: int, over: tuple[tuple[str, str], ...], place: Place) -> tuple[tuple[int, int], ...]:
        """Return the correct ones; faults of others have been reported."""
        parts, names = self._parts, self._names
        ranges: list[tuple[int, int]] = []
        is_in_bits = parts[check].in_bits is not None
        for first_name, last_name in over:
            first, last = (self._find(name, place) for name in (first_name, last_name))
            if min(first, last) < 0:
                continue
            if last + 1 < len(parts) and parts[last + 1].in_bits is not None:
                last += 1  # the check in the bits of the last part
            if first > last:
                swapped = f"`{last_name}..{first_name}`"
                self._wrong(place, f"the range's first part comes after its last; write {swapped}")
            elif first <= check <= last and not (is_in_bits and first < check):
                before, behind = f"{first_name}..{names[check - 1]}", f"{names[min(check + 1, last)]}..{last_name}"
                left = [text for text, is_there in ((before, first < check), (behind, check < last)) if is_there]
                self._wrong(
                    place, f"a check cannot cover itself; write `over: [{', '.join(left)}]`, which leaves it out"
                )
            elif any(one[0] <= last and first <= one[1] for one in ranges):
                self._wrong(place, f"`{first_name}` to `{last_name}` overlaps another range; name each part once")
            else:
                ranges.append((first, last))
        return tuple(ranges) or ((0, 0),)

    def _find(self, name: str, place: Place) -> int:
        found = [index for index, other in enumerate(self._names) if other == name]
        if len(found) == 1:
            return found[0]
        if found:
            self._wrong(place, f"{len(found)} parts are called `{name}`; give the one that is meant a `name:`")
        else:
            self._wrong(place, f"the frame has no part `{name}`; {suggestion(name, dict.fromkeys(self._names))}")
        return -1


def with_decimal_check(parts: list[Part], nodes: list[Mapping], envelope: Envelope, wrong: Wrong) -> Envelope:
    """Return the envelope with a check in decimal digits. It has no fixed size: it is between a constant and the
    delimiter."""
    index = next((index for index, part in enumerate(parts) if part.as_decimal), None)
    if index is None:
        return envelope
    place = nodes[index].value_place("check")
    before = parts[index - 1]
    digits = b"0123456789"
    if envelope.delimiter is None or envelope.stuffing != Stuffing.NONE or envelope.delimiter[0] in digits:
        wrong(
            place,
            "a check in decimal digits is as long as its number, so that its frame is not stuffed and ends with a "
            "delimiter that is not a digit; write `- delimiter: 0x0A` last, or `text: hex`",
        )
    elif index != len(parts) - 1 or parts[index].condition is not None:
        wrong(place, "a check in decimal digits is the last part of every frame; move it there")
    elif before.kind != PartKind.CONSTANT or before.condition is not None or before.value[-1] in digits:
        wrong(
            place,
            "the digits of the check must follow a constant that is not a digit; put one before it, such as `- "
            "constant: 0x2A` for *",
        )
    elif parts[index].size > MOST_DECIMAL_BYTES:
        wrong(place, f"a check in decimal digits has at most {8 * MOST_DECIMAL_BYTES} bits; take another one")
    return replace(envelope, stuffing=Stuffing.DECIMAL_CHECK)


def mark_checks_on_wire(parts: list[Part], nodes: list[Mapping], envelope: Envelope, wrong: Wrong) -> None:
    """Mark the checks that are calculated after stuffing: those beside the stuffed parts that cover them, a length that
    counts their bytes, or another such check."""
    stuffed = [index for index, part in enumerate(parts) if not part.is_plain]
    counting = holder(parts, PartKind.LENGTH, BitRole.LENGTH) if envelope.delimiter is None else None
    for index, part in enumerate(parts):
        if part.kind != PartKind.CHECK or not part.is_plain:
            continue
        if not any(i in stuffed or i == counting or parts[i].on_wire for i in part.covered):
            continue
        parts[index] = replace(part, on_wire=True)
        cut = (stuffed[0] < first <= stuffed[-1] or stuffed[0] <= last < stuffed[-1] for first, last in part.ranges)
        if any(cut):
            wrong(
                nodes[index].value_place("check"),
                "a check beside the stuffed parts is taken over the bytes on the line, so that its range covers "
                "all of them or none; widen `over`, or move the check among them to take it before stuffing",
            )


def validate_order_of_checks(parts: list[Part], nodes: list[Mapping], wrong: Wrong) -> None:
    """Refuse a check over a later one: it needs the value. Header checks are calculated first, the rest in order."""
    payload_index = next(i for i, part in enumerate(parts) if part.kind == PartKind.PAYLOAD)

    def turn(index: int) -> tuple[bool, int]:
        return not (index < payload_index and parts[index].last_covered < payload_index), index

    for index, part in enumerate(parts):
        if part.kind != PartKind.CHECK:
            continue
        for covered in part.covered:
            if parts[covered].kind == PartKind.CHECK and covered != index and turn(covered) > turn(index):
                wrong(
                    nodes[index].place,
                    f"this check covers a later one (line {nodes[covered].place.line}) whose value is not known yet; "
                    "end its range before that",
                )


def validate_checks_in_bits(parts: list[Part], nodes: list[Mapping], wrong: Wrong) -> None:
    for part, node in zip(parts, nodes, strict=True):
        if part.in_bits is not None and part.on_wire:
            wrong(
                node.value_place("check"),
                "a check among shared bits is taken before stuffing; end its range before the stuffed parts, or "
                "stuff these bits, too",
            )
