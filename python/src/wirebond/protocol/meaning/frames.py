"""The `frame` section: from its parts' syntax to the model, and whether they make a readable frame."""

from __future__ import annotations

from dataclasses import replace

from wirebond.protocol import plan, planning
from wirebond.protocol.apart import alike
from wirebond.protocol.meaning.checks import algorithm_of
from wirebond.protocol.meaning.conditions import read_condition
from wirebond.protocol.meaning.draft import Draft, Envelope
from wirebond.protocol.meaning.envelope import read_envelope, stuffed_parts
from wirebond.protocol.meaning.header import (
    magic_field,
    meaning_given,
    read_header_part,
    read_header_run,
    run_type,
    sequence_field,
)
from wirebond.protocol.meaning.messages import spoken
from wirebond.protocol.model import (
    Address,
    BitRole,
    Bits,
    ByteOrder,
    End,
    FieldKind,
    HeaderField,
    LengthCounts,
    Part,
    PartKind,
    PayloadRule,
    Stuffing,
)
from wirebond.protocol.model.forms import header_fields, header_names, parts_of_forms
from wirebond.protocol.names import meeting, meeting_fault
from wirebond.protocol.problems import Place, Problems, suggestion
from wirebond.protocol.spelling import bytes_text, choices_text
from wirebond.protocol.text.frame_grammar import (
    BitRun,
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
from wirebond.protocol.text.frame_grammar import Check as CheckSyntax
from wirebond.protocol.text.syntax import readable_part
from wirebond.protocol.text.wording import Syntax
from wirebond.protocol.text.yaml_tree import Mapping, Node, Sequence

_ONCE = (PartKind.MAGIC, PartKind.TAIL, PartKind.LENGTH, PartKind.ID, PartKind.PAYLOAD)
MOST_ID_BITS = 32  # of an id or a length
MOST_DECIMAL_BYTES = 4  # of a check in decimal digits
_FIXED_BYTES = (PartKind.MAGIC, PartKind.CONSTANT, PartKind.TAIL)


def read_frame(node: Node | None, order: ByteOrder, problems: Problems) -> Draft | None:
    """The frame's parts; None where something about them was wrong and has been reported."""
    if not isinstance(node, Sequence):
        return None
    outer = [(readable_part(item), item) for item in node.items]
    if any(syntax is None for syntax, _ in outer):
        return None
    reader = _FrameReader(order, problems)
    return reader.read([(syntax, item) for syntax, item in outer if syntax is not None], node.place)


class _FrameReader:
    def __init__(self, order: ByteOrder, problems: Problems) -> None:
        self._order = order
        self._problems = problems
        self._good = True

    def _wrong(self, place: Place, message: str) -> None:
        self._problems.add(place, message)
        self._good = False

    def read(self, outer: list[tuple[Syntax, Node]], place: Place) -> Draft | None:
        envelope = read_envelope(outer, self._wrong)
        if not self._good:
            return None
        inner: list[tuple[PartSyntax, Mapping]] = []
        plain: list[bool] = []
        for syntax, node in outer:
            stuffed = stuffed_parts(syntax, node)
            if stuffed is not None:
                inner += stuffed
                plain += [False] * len(stuffed)
            elif isinstance(syntax, PartSyntax) and isinstance(node, Mapping):
                inner.append((syntax, node))
                plain.append(envelope.stuffing != Stuffing.NONE)
        inner, plain = self._with_checks_in_bits(inner, plain)
        parts = [
            replace(_lower(syntax, self._order), is_plain=is_plain)
            for (syntax, _), is_plain in zip(inner, plain, strict=True)
        ]
        nodes = [node for _, node in inner]
        parts = self._with_header(parts, inner)
        parts = self._with_conditions(parts, inner)
        parts = _with_runs_of_checks(parts)
        names = self._names(parts, inner)
        self._validate_places(parts, nodes, place, envelope)
        self._validate_bits(parts, nodes)
        if not self._good:
            return None
        for index, (syntax, node) in enumerate(inner):
            if isinstance(syntax, CheckPart):
                parts[index] = self._lower_check(index, parts, names, syntax.check, node)
        envelope = self._with_decimal_check(parts, nodes, envelope)
        self._mark_checks_on_wire(parts, nodes, envelope)
        self._validate_order_of_checks(parts, nodes)
        self._validate_checks_in_bits(parts, nodes)
        parts = [replace(part, name=name) for part, name in zip(parts, _unique(names), strict=True)]
        draft = Draft(tuple(parts), tuple(node.place for node in nodes), envelope)
        if self._good:
            self._validate_forms(parts, place)
        if self._good:
            self._validate_whole(draft, place)
        return draft if self._good else None

    def _with_checks_in_bits(
        self, inner: list[tuple[PartSyntax, Mapping]], plain: list[bool]
    ) -> tuple[list[tuple[PartSyntax, Mapping]], list[bool]]:
        """Behind a part whose bits are shared stands its check, as a part without bytes of its own."""
        found: list[tuple[PartSyntax, Mapping]] = []
        marks: list[bool] = []
        for (syntax, node), is_plain in zip(inner, plain, strict=True):
            found.append((syntax, node))
            marks.append(is_plain)
            if not isinstance(syntax, BitsPart):
                continue
            checks = [(name, run.check) for name, run in syntax.fields.items() if run.check is not None]
            for name, check in checks[:1]:
                found.append(
                    (CheckPart.model_construct(name=name, check=check, when=None), self._run_node(node, name)[0])
                )
                marks.append(is_plain)
            for name, _ in checks[1:]:
                self._wrong(
                    self._run_node(node, name)[1],
                    f"`{checks[0][0]}` is a check in these bits already; give this one bits of its own",
                )
        return found, marks

    # ---- header fields ----

    def _with_header(self, parts: list[Part], inner: list[tuple[PartSyntax, Mapping]]) -> list[Part]:
        """The parts with what their header fields mean. Each field has a name of its own."""
        found = []
        names: dict[str, Place] = {}
        for part, (syntax, node) in zip(parts, inner, strict=True):
            whole = self._header_part(part, syntax, node)
            found.append(whole)
            for name in header_names(whole):
                place = self._run_node(node, name)[1] if whole.bits else node.value_place(whole.kind.value)
                if name in names:
                    self._wrong(
                        place,
                        f"another header field is called `{name}` (line {names[name].line}); take another name",
                    )
                names.setdefault(name, place)
        for name, other in meeting(names):
            self._wrong(names[name], meeting_fault(name, other))
        fields = header_fields(tuple(found))
        self._validate_addresses(fields, names)
        for second in [field for field in fields if field.is_sequence][1:]:
            self._wrong(
                names[second.name],
                "a frame has one sequence number, which the link raises; make this one a `field`, which its sender "
                "sets",
            )
        return found

    def _validate_addresses(self, fields: tuple[HeaderField, ...], places: dict[str, Place]) -> None:
        """One address says whose a frame is, and one who sent it."""
        held: dict[Address, HeaderField] = {}
        for field in fields:
            if field.address is None:
                continue
            place = places[field.name]
            if field.value.is_scaled or field.value.flags:
                self._wrong(
                    place, f"`{field.name}` is an address, and those are whole numbers; remove `scale` or `flags`"
                )
            of_mcu = {Address.RECEIVER, Address.SENDER} if field.address == Address.MCU else {Address.MCU}
            other = next((held[kind] for kind in (field.address, *of_mcu) if kind in held), None)
            if other is not None:
                self._wrong(
                    place,
                    f"`{other.name}` says `address: {other.address}` already, and `address: {field.address}` beside it "
                    "would be a second one; a frame has one address of the MCU, or one of its receiver and one of its "
                    "sender",
                )
            held.setdefault(field.address, field)

    def _header_part(self, part: Part, syntax: PartSyntax, node: Mapping) -> Part:
        if isinstance(syntax, FieldPart):
            header, good = read_header_part(syntax.field, syntax, node, self._order, self._problems)
            self._good = self._good and good
            return replace(part, header=header)
        if isinstance(syntax, SequencePart):
            return replace(part, header=sequence_field(part.name, part.size, 0, syntax.per, part.order))
        if not isinstance(syntax, BitsPart):
            return part
        runs = []
        for run in part.bits:
            given, (run_node, place) = syntax.fields[run.name], self._run_node(node, run.name)
            self._validate_run(run, given, run_node, place)
            if run.role == BitRole.FIELD:
                header, good = read_header_run(run.name, given, run_node, self._problems)
                self._good = self._good and good
                runs.append(replace(run, header=header))
            elif run.role == BitRole.SEQUENCE:
                runs.append(replace(run, header=sequence_field(run.name, 0, run.width, given.per)))
            else:
                runs.append(run)
        return replace(part, bits=tuple(runs))

    @staticmethod
    def _run_node(node: Mapping, name: str) -> tuple[Mapping, Place]:
        """What stands behind a run's name, and where the name stands."""
        fields = node.get("fields")
        assert isinstance(fields, Mapping)
        value = fields.get(name)
        return (value if isinstance(value, Mapping) else Mapping(fields.value_place(name))), fields.key_place(name)

    def _validate_run(self, run: Bits, syntax: BitRun, node: Mapping, place: Place) -> None:
        if (syntax.bits is None) == (syntax.type is None):
            self._wrong(place, f"`{run.name}` needs its number of bits; write `bits: 4` or a `type`, not both")
        if syntax.per is not None and run.role != BitRole.SEQUENCE:
            self._wrong(node.key_place("per"), "`per` is for a run `sequence`; remove it")
        if syntax.from_bit is not None and run.role != BitRole.CHECK:
            self._wrong(node.key_place("from_bit"), "`from_bit` is for a run that is a check; remove it")
        if run.role == BitRole.FIELD:
            return
        if run.role == BitRole.CHECK and (syntax.constant is not None or run.name in _RUN_ROLES):
            self._wrong(place, "a run is a check, or something else; write one of the two")
        named = {BitRole.CONSTANT: "a constant", BitRole.CHECK: "a check"}
        what = named.get(run.role, f"a run `{run.role}`")
        for option in meaning_given(syntax):
            self._wrong(node.key_place(option), f"`{option}` is for header fields, and this is {what}; remove it")
        if syntax.type is not None and syntax.type.kind != FieldKind.UNSIGNED:
            self._wrong(node.value_place("type"), f"{what} is unsigned; write `bits: {run.width}`")
        if run.role in (BitRole.ID, BitRole.LENGTH) and run.width > MOST_ID_BITS:
            self._wrong(place, f"{what} has at most {MOST_ID_BITS} bits; take fewer")

    # ---- names and ranges ----

    def _names(self, parts: list[Part], inner: list[tuple[PartSyntax, Mapping]]) -> list[str]:
        names = [part.name or syntax.name or part.kind.value for part, (syntax, _) in zip(parts, inner, strict=True)]
        kinds = {kind.value for kind in PartKind}
        for index, (syntax, node) in enumerate(inner):
            if syntax.name is None:
                continue
            if syntax.name in kinds and syntax.name != parts[index].kind.value:
                self._wrong(
                    node.value_place("name"),
                    f"`{syntax.name}` is the word for another kind of part; take another name",
                )
            elif any(other.name == syntax.name for other, _ in inner[:index]):
                self._wrong(node.value_place("name"), f"another part is named `{syntax.name}`; take another name")
        return names

    def _lower_check(self, index: int, parts: list[Part], names: list[str], check: CheckSyntax, node: Mapping) -> Part:
        part = parts[index]
        options = node.get("check")
        where = options if isinstance(options, Mapping) else Mapping(node.value_place("check"))
        order = ByteOrder(check.byte_order) if check.byte_order else self._order
        algorithm = algorithm_of(check, where, order, self._wrong)
        size, shift = (algorithm.width + 7) // 8, 0
        as_hex, as_decimal = check.text == "hex", check.text == "decimal"
        if part.in_bits is not None:
            return self._lower_run(index, parts, names, replace(part, algorithm=algorithm), check, where, node)
        if check.byte is not None:
            shift = algorithm.width - 8 if check.byte == "high" else 0
            if size == 1:
                self._wrong(where.key_place("byte"), "a check of 8 bits has one byte; remove `byte`")
            size = 1
        ranges: tuple[tuple[int, int], ...] = ((0, index - 1),)
        if check.over is not None:
            ranges = self._lower_ranges(index, parts, names, check.over, where.value_place("over"))
        elif index == 0:
            self._wrong(node.place, "nothing precedes this check; move it behind what it covers, or say `over:`")
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

    def _lower_run(
        self,
        index: int,
        parts: list[Part],
        names: list[str],
        part: Part,
        check: CheckSyntax,
        where: Mapping,
        node: Mapping,
    ) -> Part:
        """A check that has some bits of the part before it."""
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
            ranges = self._lower_ranges(index, parts, names, check.over, where.value_place("over"))
        elif index == 1:
            self._wrong(node.place, "nothing precedes this check; say `over:` what it covers")
        return replace(part, seeded=check.seed is not None, ranges=ranges, shift=run.value)

    def _validate_checks_in_bits(self, parts: list[Part], nodes: list[Mapping]) -> None:
        for part, node in zip(parts, nodes, strict=True):
            if part.in_bits is not None and part.on_wire:
                self._wrong(
                    node.value_place("check"),
                    "a check among shared bits is taken before stuffing; end its range before the stuffed parts, or "
                    "stuff these bits, too",
                )

    def _lower_ranges(
        self, check: int, parts: list[Part], names: list[str], over: tuple[tuple[str, str], ...], place: Place
    ) -> tuple[tuple[int, int], ...]:
        """Those that are right; what is wrong with others has been reported."""
        ranges: list[tuple[int, int]] = []
        is_in_bits = parts[check].in_bits is not None
        for first_name, last_name in over:
            first, last = (self._find(name, names, place) for name in (first_name, last_name))
            if min(first, last) < 0:
                continue
            if last + 1 < len(parts) and parts[last + 1].in_bits is not None:
                last += 1  # the check in the bits of the last part
            if first > last:
                swapped = f"`{last_name}..{first_name}`"
                self._wrong(place, f"the range's first part stands behind its last; write {swapped}")
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

    def _with_decimal_check(self, parts: list[Part], nodes: list[Mapping], envelope: Envelope) -> Envelope:
        """A check in decimal digits has no fixed size: it lies between a constant and the delimiter."""
        index = next((index for index, part in enumerate(parts) if part.as_decimal), None)
        if index is None:
            return envelope
        place = nodes[index].value_place("check")
        before = parts[index - 1]
        digits = b"0123456789"
        if envelope.delimiter is None or envelope.stuffing != Stuffing.NONE or envelope.delimiter[0] in digits:
            self._wrong(
                place,
                "a check in decimal digits is as long as its number, so that its frame is not stuffed and ends with a "
                "delimiter that is no digit; write `- delimiter: 0x0A` last, or `text: hex`",
            )
        elif index != len(parts) - 1 or parts[index].condition is not None:
            self._wrong(place, "a check in decimal digits is the last part of every frame; move it there")
        elif before.kind != PartKind.CONSTANT or before.condition is not None or before.value[-1] in digits:
            self._wrong(
                place,
                "the digits of the check begin behind a constant that is no digit itself; put one before it, such as "
                "`- constant: 0x2A` for *",
            )
        elif parts[index].size > MOST_DECIMAL_BYTES:
            self._wrong(place, f"a check in decimal digits has at most {8 * MOST_DECIMAL_BYTES} bits; take another one")
        return replace(envelope, stuffing=Stuffing.DECIMAL_CHECK)

    def _mark_checks_on_wire(self, parts: list[Part], nodes: list[Mapping], envelope: Envelope) -> None:
        """A check beside the stuffed parts is taken after stuffing, where it covers them, a length that counts their
        bytes, or another such check."""
        stuffed = [index for index, part in enumerate(parts) if not part.is_plain]
        counting = _holder(parts, PartKind.LENGTH, BitRole.LENGTH) if envelope.delimiter is None else None
        for index, part in enumerate(parts):
            if part.kind != PartKind.CHECK or not part.is_plain:
                continue
            if not any(i in stuffed or i == counting or parts[i].on_wire for i in part.covered):
                continue
            parts[index] = replace(part, on_wire=True)
            cut = (stuffed[0] < first <= stuffed[-1] or stuffed[0] <= last < stuffed[-1] for first, last in part.ranges)
            if any(cut):
                self._wrong(
                    nodes[index].value_place("check"),
                    "a check beside the stuffed parts is taken over the bytes on the line, so that its range covers "
                    "all of them or none; widen `over`, or move the check among them to take it before stuffing",
                )

    def _find(self, name: str, names: list[str], place: Place) -> int:
        found = [index for index, other in enumerate(names) if other == name]
        if len(found) == 1:
            return found[0]
        if found:
            self._wrong(place, f"{len(found)} parts are called `{name}`; give the one that is meant a `name:`")
        else:
            self._wrong(place, f"the frame has no part `{name}`; {suggestion(name, dict.fromkeys(names))}")
        return -1

    # ---- which part may stand where ----

    def _validate_bits(self, parts: list[Part], nodes: list[Mapping]) -> None:
        for part, node in zip(parts, nodes, strict=True):
            if part.kind != PartKind.BITS:
                continue
            fields = node.get("fields")
            assert isinstance(fields, Mapping)
            width = sum(run.width for run in part.bits)
            if width != 8 * part.size:
                self._wrong(
                    node.value_place("fields"),
                    f"these runs have {width} bits together, and the part has {8 * part.size}; "
                    "add a `reserved` run, or change a width",
                )
            for run in part.bits:
                if run.role == BitRole.CONSTANT and run.value > run.mask:
                    self._wrong(fields.key_place(run.name), f"{run.value} does not fit {run.width} bits; take less")

    def _with_conditions(self, parts: list[Part], inner: list[tuple[PartSyntax, Mapping]]) -> list[Part]:
        """The parts with the conditions under which they are there."""
        found = []
        for index, (part, (syntax, node)) in enumerate(zip(parts, inner, strict=True)):
            if syntax.when is None:
                found.append(part)
                continue
            at = node.value_place("when")
            if part.kind == PartKind.PAYLOAD:
                self._wrong(at, "the payload is always there; remove `when`")
            condition = read_condition(syntax.when, parts, index, at, self._wrong)
            found.append(replace(part, condition=condition))
        return self._with_magic(found, [node for _, node in inner])

    def _with_magic(self, parts: list[Part], nodes: list[Mapping]) -> list[Part]:
        """Where a frame begins with one of several magics, the magic is a header field."""
        magic = magic_field(tuple(parts))
        if magic is None:
            return parts
        for part, node in zip(parts, nodes, strict=True):
            if magic.name in header_names(part):
                self._wrong(node.place, "the magic is a header field under the name `magic` here; take another name")
        return [replace(part, header=magic) if part.kind == PartKind.MAGIC else part for part in parts]

    def _validate_forms(self, parts: list[Part], place: Place) -> None:
        """Each end has forms, each of them is whole, a receiver can tell them apart, and there are not too many."""
        whole = tuple(parts)
        for form_parts in parts_of_forms(whole, None):
            for kind, role in (
                (PartKind.MAGIC, None),
                (PartKind.ID, BitRole.ID),
                (PartKind.LENGTH, BitRole.LENGTH),
            ):
                held = [p for p in form_parts.parts if p.kind == kind or any(r.role == role for r in p.bits)]
                if len(held) > 1:
                    self._wrong(
                        place,
                        f"two parts with a {kind.value} can stand in one frame; let their `when:` exclude each other",
                    )
        for end in (End.HOST, End.MCU):
            if not parts_of_forms(whole, end):
                self._wrong(
                    place,
                    f"frames of the {spoken(end)} have no magic; give them one, such as "
                    f"`{{magic: 0xAA, when: sender == {end.value}}}`",
                )
        for limit, found, what in (
            (plan.MAX_FORMS, len(parts_of_forms(whole, None)), "forms (by magics and conditions)"),
            (plan.MAX_HEADER_FIELDS, len(header_fields(whole)), "fields in its header"),
        ):
            if found > limit:
                self._wrong(place, f"the frame has {found} {what}; at most {limit} are possible")
        if self._good:
            self._validate_told_apart(whole, place)

    def _validate_told_apart(self, parts: tuple[Part, ...], place: Place) -> None:
        for end in (End.HOST, End.MCU):
            forms = planning.forms(parts, end)
            tested = sum(len(form.exclusions) for form in forms)
            if tested > plan.MAX_EXCLUSIONS:
                self._wrong(
                    place,
                    f"the conditions of this frame need {tested} comparisons of a receiver; at most "
                    f"{plan.MAX_EXCLUSIONS} are possible: write fewer values, or ranges",
                )
                return
            pair = alike(parts, end)
            if pair is not None:
                one, other = (choices_text(tuple(held.choice for held in form.choices)) for form in pair)
                self._wrong(
                    place,
                    f"a receiver cannot tell a frame with `{one}` from one with `{other}`; let them differ in a byte "
                    "before the payload, by a magic or a constant of their own",
                )
                return

    def _validate_places(self, parts: list[Part], nodes: list[Mapping], place: Place, envelope: Envelope) -> None:
        kinds = [part.kind for part in parts]
        for kind in _ONCE:
            found = [i for i, other in enumerate(kinds) if other == kind]
            exclusive = len({parts[i].condition for i in found}) == len(found) and None not in {
                parts[i].condition for i in found
            }
            for index in [] if exclusive else found[1:]:
                self._wrong(
                    nodes[index].place,
                    f"a frame has one `{kind}` part at most; remove this one, or give each its own `when:`",
                )
        if PartKind.PAYLOAD not in kinds:
            self._wrong(place, "the frame has no payload; add a part such as `- payload: by_length`")
            return
        payload_index = kinds.index(PartKind.PAYLOAD)
        magics = [index for index, kind in enumerate(kinds) if kind == PartKind.MAGIC]
        if magics != list(range(len(magics))):
            index = next(index for number, index in enumerate(magics) if index != number)
            self._wrong(nodes[index].place, "a magic begins the frame; put it first, or write `constant` here")
        if PartKind.TAIL in kinds[:-1]:
            index = kinds.index(PartKind.TAIL)
            self._wrong(nodes[index].place, "a tail ends the frame; put it last, or write `constant` here")
        if len({parts[index].size for index in magics}) > 1:
            self._wrong(
                nodes[magics[-1]].place,
                "magics of one frame need the same number of bytes; fill up with a `constant` part",
            )
        self._validate_payload_rule(parts, nodes, payload_index, envelope)
        constants = sum(len(part.value) for part in parts if part.condition is None)
        for limit, number, what in (
            (plan.MAX_CONSTANTS, constants, "bytes of magic, constants and tail"),
            (plan.MAX_CHECKS, kinds.count(PartKind.CHECK), "checks"),
        ):
            if number > limit:
                self._wrong(place, f"the frame has {number} {what}; at most {limit} are possible")

    def _validate_payload_rule(
        self, parts: list[Part], nodes: list[Mapping], payload_index: int, envelope: Envelope
    ) -> None:
        rule, at = parts[payload_index].payload, nodes[payload_index].value_place("payload")
        length = _holder(parts, PartKind.LENGTH, BitRole.LENGTH)
        message_id = _holder(parts, PartKind.ID, BitRole.ID)
        if rule == PayloadRule.BY_LENGTH and length is None:
            self._wrong(at, "`payload: by_length` needs a length; add a part such as `- length: u8` before it")
        if rule != PayloadRule.BY_LENGTH and length is not None:
            self._wrong(nodes[length].place, "this length tells nothing; write `payload: by_length`, or remove it")
        if rule == PayloadRule.BY_LENGTH and length is not None and length > payload_index:
            self._wrong(nodes[length].place, "the length must stand before the payload whose size it tells; move it")
        if rule == PayloadRule.BY_ID and message_id is not None and message_id > payload_index:
            self._wrong(nodes[message_id].place, "the id must stand before the payload whose size it tells; move it")
        if rule == PayloadRule.REST and envelope.delimiter is None and envelope.silence is None:
            self._wrong(
                at, "`payload: rest` needs delimiters or a silence, which say where the frame ends; or write by_length"
            )

    def _validate_order_of_checks(self, parts: list[Part], nodes: list[Mapping]) -> None:
        """A check over another needs its value. Header checks are worked out first, the rest in order."""
        payload_index = next(i for i, part in enumerate(parts) if part.kind == PartKind.PAYLOAD)

        def turn(index: int) -> tuple[bool, int]:
            return not (index < payload_index and parts[index].last_covered < payload_index), index

        for index, part in enumerate(parts):
            if part.kind != PartKind.CHECK:
                continue
            for covered in part.covered:
                if parts[covered].kind == PartKind.CHECK and covered != index and turn(covered) > turn(index):
                    self._wrong(
                        nodes[index].place,
                        f"this check covers a later one (line {nodes[covered].place.line}) whose "
                        "value is not known yet; "
                        "end its range before that",
                    )

    def _validate_whole(self, draft: Draft, place: Place) -> None:
        parts = draft.parts
        if draft.envelope == Envelope() and not any(_tells(part) for part in parts):
            self._wrong(
                place,
                "nothing tells this frame from other bytes; add `- magic: 0xAA` in front or a check behind",
            )
        forms = planning.forms(parts, None)
        constants = max(len(form.constants) for form in forms)
        if constants > plan.MAX_CONSTANTS:
            self._wrong(
                place,
                f"the frame has {constants} constant bytes, those of bits and of conditions counted; "
                f"at most {plan.MAX_CONSTANTS} are possible",
            )
        self._validate_seeds(draft)
        self._validate_unstuffed_constants(draft)
        self._validate_sized(draft)
        self._validate_first(draft)
        self._validate_digit(draft)
        length = draft.length_part
        if length is None:
            return
        longest = min(form.most_payload for form in forms)  # of each form: its own length must tell an empty payload
        at = draft.places[parts.index(length)]
        shortest = max(form.length_bias for form in forms)  # of the form with the fewest parts beside the payload
        if length.length_unit > 1 and draft.payload.trims_zeros:
            self._wrong(
                draft.places[draft.payload_index],
                f"with `trim_zeros` a payload may end at any byte, and this length counts by {length.length_unit}; "
                "remove one of the two",
            )
        if longest < 0:
            self._wrong(at, "the length counts more than it can tell, even for an empty payload; take a wider type")
        elif shortest > 0:
            self._wrong(
                at,
                f"with this offset a payload under {shortest} bytes would have a negative length; take a greater one",
            )

    def _validate_unstuffed_constants(self, draft: Draft) -> None:
        envelope = draft.envelope
        marks = [mark for mark in (envelope.opening, envelope.delimiter) if mark is not None]
        for part, place in zip(draft.parts, draft.places, strict=True):
            if envelope.stuffing.hides_delimiters and not part.is_plain:
                continue
            held = next((mark for mark in marks if mark in part.value), None)
            if held is not None:
                self._wrong(
                    place,
                    f"this {part.kind} holds the delimiter {bytes_text(held)} and is not stuffed, so that "
                    "every frame is cut here; take another delimiter, or stuff this part",
                )

    def _validate_sized(self, draft: Draft) -> None:
        """A stuffed frame that its length ends: what must be known before it is unstuffed."""
        if not draft.is_sized:
            return
        first = [part.is_plain for part in draft.parts].index(False)
        for index, (part, place) in enumerate(zip(draft.parts, draft.places, strict=True)):
            if part.on_wire and index < draft.payload_index and part.last_covered >= first:
                self._wrong(place, "a check over the stuffed bytes stands behind them here; move it behind the payload")
        length = draft.length_part
        if length is None or not length.is_plain:
            return
        at = draft.parts.index(length)
        if length.length_unit > 1:
            self._wrong(
                draft.places[at], "this length counts the bytes on the line, so it cannot count words; remove `unit`"
            )
        for part, place in zip(draft.parts, draft.places, strict=True):
            if (
                part.kind == PartKind.CHECK
                and not part.is_plain
                and any(i == at or draft.parts[i].on_wire for i in part.covered)
            ):
                self._wrong(
                    place,
                    "this check is taken before stuffing and covers the length, which counts the stuffed bytes, or a "
                    "check over it; begin its range behind them, or move the check beside the stuffed parts",
                )

    def _validate_first(self, draft: Draft) -> None:
        """Where a doubled byte alone opens a frame, the first byte behind it tells that it does."""
        if not draft.envelope.opens_alone:
            return
        first, taken = draft.parts[0], draft.forbidden_first
        if first.kind in _FIXED_BYTES and not any(value[0] in taken for value in (first.value, *first.alternatives)):
            return
        if first.kind == PartKind.ID:
            return  # whose values are compared where the messages are known
        self._wrong(
            draft.places[0],
            f"a delimiter of one byte opens this frame, so its first byte must never be {bytes_text(taken[:1])} or "
            f"{bytes_text(taken[1:])}; let it begin with its id or a constant that is neither",
        )

    def _validate_digit(self, draft: Draft) -> None:
        """A byte that is sent as one digit is below 16. The ids are compared where the messages are known."""
        if draft.one_digit is None:
            return
        first = draft.parts[draft.one_digit]
        is_id = first.kind == PartKind.ID and first.size == 1
        if first.condition is None and (is_id or (first.kind == PartKind.CONSTANT and first.value[0] < 16)):
            return
        self._wrong(
            draft.places[draft.one_digit],
            "this byte is sent as one digit, so it is below 16 in every frame; let the parts begin with `id: u8`, or "
            "with a constant of 0x00 to 0x0F",
        )

    def _validate_seeds(self, draft: Draft) -> None:
        """A check of the header alone is compared before the bytes behind the payload are there."""
        payload_index = draft.payload_index
        id_index = _holder(list(draft.parts), PartKind.ID, BitRole.ID)
        if id_index is None or id_index < payload_index:
            return
        for index, part in enumerate(draft.parts):
            if part.seeded and index < payload_index and part.last_covered < payload_index:
                self._wrong(
                    draft.places[index],
                    "this check counts the message's seed, and the id that tells the message stands behind the "
                    "payload; move the id before it, or this check behind it",
                )


def _holder(parts: list[Part], kind: PartKind, role: BitRole) -> int | None:
    """The part that holds the id or the length."""
    for index, part in enumerate(parts):
        if part.kind == kind or any(run.role == role for run in part.bits):
            return index
    return None


def _lower(syntax: PartSyntax, order: ByteOrder) -> Part:
    """A part by itself; its condition, and a check's algorithm and range, come later."""
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


def _tells(part: Part) -> bool:
    """Does this part tell a frame from other bytes? A byte's worth of constant bits does."""
    constant = sum(run.width for run in part.bits if run.role == BitRole.CONSTANT)
    return part.kind in (*_FIXED_BYTES, PartKind.CHECK) or constant >= 8


_RUN_ROLES = {"id": BitRole.ID, "length": BitRole.LENGTH, "sequence": BitRole.SEQUENCE}


def _lower_bits(syntax: BitsPart, order: ByteOrder) -> Part:
    runs = []
    shift = 0
    listed = list(syntax.fields.items())
    for name, run in listed if syntax.first == "low" else reversed(listed):
        role = BitRole.CONSTANT if run.constant is not None else _RUN_ROLES.get(name, BitRole.FIELD)
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


def _with_runs_of_checks(parts: list[Part]) -> list[Part]:
    """Each check that has bits of the part before it with its run, and there where that part is there."""
    found: list[Part] = []
    for part in parts:
        before = found[-1] if found else part
        run = next((run for run in before.bits if run.role == BitRole.CHECK), None)
        is_run = part.kind == PartKind.CHECK and run is not None
        found.append(replace(part, in_bits=run, condition=before.condition) if is_run else part)
    return found


def _unique(names: list[str]) -> list[str]:
    """`constant`, `constant_2`, … where parts without a name share a kind."""
    given: list[str] = []
    for name in names:
        number, candidate = 2, name
        while candidate in given or (candidate != name and candidate in names):
            candidate, number = f"{name}_{number}", number + 1
        given.append(candidate)
    return given
