"""The `frame` section: from its parts' syntax to the model, and whether they make a readable frame."""

from __future__ import annotations

from dataclasses import replace

from wirebond.protocol.meaning.check_parts import (
    ChecksAmongParts,
    mark_checks_on_wire,
    validate_checks_in_bits,
    validate_order_of_checks,
    with_decimal_check,
)
from wirebond.protocol.meaning.conditions import read_condition
from wirebond.protocol.meaning.draft import Draft
from wirebond.protocol.meaning.envelope import read_envelope, stuffed_parts
from wirebond.protocol.meaning.frame_places import validate_bits, validate_forms, validate_places, validate_told_apart
from wirebond.protocol.meaning.frame_rules import validate_whole
from wirebond.protocol.meaning.header import (
    magic_field,
    meaning_given,
    read_header_part,
    read_header_run,
    sequence_field,
)
from wirebond.protocol.meaning.parts import RUN_ROLES, lower, unique, with_runs_of_checks
from wirebond.protocol.model import (
    Address,
    BitRole,
    Bits,
    ByteOrder,
    HeaderField,
    Part,
    PartKind,
    Stuffing,
)
from wirebond.protocol.model.forms import header_fields, header_names
from wirebond.protocol.names import meeting, meeting_fault
from wirebond.protocol.problems import Place, Problems
from wirebond.protocol.text.frame_grammar import (
    BitRun,
    BitsPart,
    CheckPart,
    FieldPart,
    PartSyntax,
    SequencePart,
)
from wirebond.protocol.text.syntax import readable_part
from wirebond.protocol.text.wording import Syntax
from wirebond.protocol.text.yaml_tree import Mapping, Node, Sequence

MOST_ID_BITS = 32  # of an id or a length


def read_frame(node: Node | None, order: ByteOrder, problems: Problems) -> Draft | None:
    """Return the frame's parts; None where something about them was wrong and has been reported."""
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
            replace(lower(syntax, self._order), is_plain=is_plain)
            for (syntax, _), is_plain in zip(inner, plain, strict=True)
        ]
        nodes = [node for _, node in inner]
        parts = self._with_header(parts, inner)
        parts = self._with_conditions(parts, inner)
        parts = with_runs_of_checks(parts)
        names = self._names(parts, inner)
        validate_places(parts, nodes, place, envelope, self._wrong)
        validate_bits(parts, nodes, self._wrong)
        if not self._good:
            return None
        checks = ChecksAmongParts(parts, names, self._order, self._wrong)
        for index, (syntax, node) in enumerate(inner):
            if isinstance(syntax, CheckPart):
                parts[index] = checks.lower(index, syntax.check, node)
        envelope = with_decimal_check(parts, nodes, envelope, self._wrong)
        mark_checks_on_wire(parts, nodes, envelope, self._wrong)
        validate_order_of_checks(parts, nodes, self._wrong)
        validate_checks_in_bits(parts, nodes, self._wrong)
        parts = [replace(part, name=name) for part, name in zip(parts, unique(names), strict=True)]
        draft = Draft(tuple(parts), tuple(node.place for node in nodes), envelope)
        if self._good:
            validate_forms(parts, place, self._wrong)
        if self._good:
            validate_told_apart(draft.parts, place, self._wrong)
        if self._good:
            validate_whole(draft, place, self._wrong)
        return draft if self._good else None

    def _with_checks_in_bits(
        self, inner: list[tuple[PartSyntax, Mapping]], plain: list[bool]
    ) -> tuple[list[tuple[PartSyntax, Mapping]], list[bool]]:
        """Insert the checks among shared bits as parts without bytes of their own, after the part with these bits."""
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
        """Return the parts with what their header fields mean. Each field has a name of its own."""
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
        """Check that there is one address for the receiver at most, and one for the sender."""
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
        """Return the value of a run's name, and the place of the name."""
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
        if run.role == BitRole.CHECK and (syntax.constant is not None or run.name in RUN_ROLES):
            self._wrong(place, "a run is a check, or something else; write one of the two")
        named = {BitRole.CONSTANT: "a constant", BitRole.CHECK: "a check"}
        what = named.get(run.role, f"a run `{run.role}`")
        for option in meaning_given(syntax):
            self._wrong(node.key_place(option), f"`{option}` is for header fields, and this is {what}; remove it")
        if syntax.type is not None and not syntax.type.is_unsigned:
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

    # ---- places of the parts ----

    def _with_conditions(self, parts: list[Part], inner: list[tuple[PartSyntax, Mapping]]) -> list[Part]:
        """Return the parts with the conditions under which they are there."""
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
        """Make the magic a header field if a frame can begin with one of several magics."""
        magic = magic_field(tuple(parts))
        if magic is None:
            return parts
        for part, node in zip(parts, nodes, strict=True):
            if magic.name in header_names(part):
                self._wrong(node.place, "the magic is a header field under the name `magic` here; take another name")
        return [replace(part, header=magic) if part.kind == PartKind.MAGIC else part for part in parts]
