"""The `frame` section: from its parts' syntax to the model, and whether they make a readable frame."""

from __future__ import annotations

from dataclasses import replace

from wirebond.protocol import algorithms, plan
from wirebond.protocol.document import Mapping, Node, Sequence
from wirebond.protocol.draft import Draft
from wirebond.protocol.frame_grammar import Check as CheckSyntax
from wirebond.protocol.frame_grammar import (
    CheckPart,
    CobsPart,
    ConstantPart,
    DelimiterPart,
    IdPart,
    LengthPart,
    MagicPart,
    PartSyntax,
    PayloadPart,
    ReservedPart,
    TailPart,
)
from wirebond.protocol.model import (
    Algorithm,
    ByteOrder,
    LengthCounts,
    Part,
    PartKind,
    PayloadRule,
)
from wirebond.protocol.problems import Place, Problems, suggestion
from wirebond.protocol.scalars import OWN_CRC
from wirebond.protocol.syntax import readable_part
from wirebond.protocol.wording import Syntax

_ONCE = (PartKind.MAGIC, PartKind.TAIL, PartKind.LENGTH, PartKind.ID, PartKind.PAYLOAD)
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
        delimiter = self._delimiters(outer)
        if not self._good:
            return None
        inner: list[tuple[PartSyntax, Mapping]] = []
        for syntax, node in outer:
            if isinstance(syntax, CobsPart) and isinstance(node, Mapping):
                items = node.get("cobs")
                assert isinstance(items, Sequence)
                for item, item_node in zip(syntax.cobs, items.items, strict=True):
                    assert isinstance(item_node, Mapping)
                    inner.append((item, item_node))
            elif isinstance(syntax, PartSyntax) and isinstance(node, Mapping):
                inner.append((syntax, node))
        parts = [_lower(syntax, self._order) for syntax, _ in inner]
        nodes = [node for _, node in inner]
        names = self._names(parts, inner)
        self._check_places(parts, nodes, place, delimiter is not None)
        if not self._good:
            return None
        for index, (syntax, node) in enumerate(inner):
            if isinstance(syntax, CheckPart):
                parts[index] = self._lower_check(index, parts, names, syntax.check, node)
        self._check_order_of_checks(parts, nodes)
        parts = [replace(part, name=name) for part, name in zip(parts, _unique(names), strict=True)]
        draft = Draft(tuple(parts), tuple(node.place for node in nodes), delimiter)
        if self._good:
            self._check_whole(draft, place)
        return draft if self._good else None

    # ---- delimiters and stuffing ----

    def _delimiters(self, outer: list[tuple[Syntax, Node]]) -> int | None:
        cobs = [node for syntax, node in outer if isinstance(syntax, CobsPart)]
        marks = [
            (index, syntax, node)
            for index, (syntax, node) in enumerate(outer)
            if isinstance(syntax, DelimiterPart)
        ]
        if not cobs and not marks:
            return None
        advice = "write `- delimiter: 0x00`, `- cobs: [...]`, `- delimiter: 0x00`"
        if not marks:
            self._wrong(cobs[0].place, f"`cobs` needs a delimiter before and behind it; {advice}")
            return None
        if [index for index, _, _ in marks] != [0, len(outer) - 1] or len(outer) < 2:
            self._wrong(
                marks[0][2].place,
                f"delimiters are the frame's first and its last part, and stand nowhere else; {advice}",
            )
        for _, mark, node in marks:
            if mark.delimiter != b"\0" and isinstance(node, Mapping):
                self._wrong(
                    node.value_place("delimiter"),
                    "COBS frees a frame of 0x00 and of no other byte; write 0x00",
                )
        if len(cobs) > 1:
            self._wrong(cobs[1].place, "a frame has one `cobs`; put all its parts into the first")
        for syntax, node in outer:
            if isinstance(syntax, PartSyntax):
                self._wrong(
                    node.place,
                    f"between delimiters every part stands within `cobs`, lest it contain one; {advice}",
                )
                break
        return 0

    # ---- names and ranges ----

    def _names(self, parts: list[Part], inner: list[tuple[PartSyntax, Mapping]]) -> list[str]:
        names = [syntax.name or part.kind.value for part, (syntax, _) in zip(parts, inner, strict=True)]
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
                self._wrong(
                    node.value_place("name"), f"another part is named `{syntax.name}`; take another name"
                )
        return names

    def _lower_check(
        self, index: int, parts: list[Part], names: list[str], check: CheckSyntax, node: Mapping
    ) -> Part:
        part = parts[index]
        options = node.get("check")
        where = options if isinstance(options, Mapping) else Mapping(node.value_place("check"))
        algorithm = self._algorithm(check, where)
        size, shift = algorithm.width // 8, 0
        if check.byte is not None:
            shift = algorithm.width - 8 if check.byte == "high" else 0
            if size == 1:
                self._wrong(where.key_place("byte"), "a check of 8 bits has one byte; remove `byte`")
            size = 1
        first, last = 0, index - 1
        if check.over is not None:
            first, last = (self._find(name, names, where.value_place("over")) for name in check.over)
            if first > last >= 0:
                over = f"`{check.over[1]}..{check.over[0]}`"
                self._wrong(
                    where.value_place("over"), f"the range's first part stands behind its last; write {over}"
                )
            elif 0 <= first <= index <= last:
                self._wrong(where.value_place("over"), "a check cannot cover itself; end the range before it")
        elif index == 0:
            self._wrong(
                node.place, "nothing precedes this check; move it behind what it covers, or say `over:`"
            )
        return replace(
            part,
            size=size,
            order=ByteOrder(check.byte_order) if check.byte_order else self._order,
            algorithm=algorithm,
            first=first,
            last=last,
            shift=shift,
        )

    def _find(self, name: str, names: list[str], place: Place) -> int:
        found = [index for index, other in enumerate(names) if other == name]
        if len(found) == 1:
            return found[0]
        if found:
            self._wrong(
                place, f"{len(found)} parts are called `{name}`; give the one that is meant a `name:`"
            )
        else:
            self._wrong(place, f"the frame has no part `{name}`; {suggestion(name, dict.fromkeys(names))}")
        return -1

    def _algorithm(self, check: CheckSyntax, node: Mapping) -> Algorithm:
        parameters = {
            key: getattr(check, key) for key in ("width", "poly", "init", "refin", "refout", "xorout")
        }
        given = [key for key, value in parameters.items() if value is not None]
        known = algorithms.find(check.type)
        if known is not None:
            for key in given:
                self._wrong(
                    node.key_place(key),
                    f"`{check.type}` has its own `{key}`; remove this, or write `type: crc` for your own",
                )
            return known
        for key in ("width", "poly"):
            if key not in given:
                self._wrong(
                    node.key_place("type"), f"a CRC of your own needs `{key}`; or name one of the catalogue"
                )
        width = int(check.width or 16)
        for key in ("poly", "init", "xorout"):
            value = parameters[key]
            if value is not None and value >= 2**width:
                self._wrong(
                    node.value_place(key),
                    f"{value:#x} has more than {width} bits; write at most {2**width - 1:#x}",
                )
        if check.poly is not None and check.poly % 2 == 0:
            self._wrong(
                node.value_place("poly"),
                "a CRC's polynomial is odd; write it highest power first (0x1021), without its "
                "leading one, not reflected",
            )
        return Algorithm(
            OWN_CRC,
            "crc",
            width,
            check.poly or 0,
            check.init or 0,
            bool(check.refin),
            bool(check.refout),
            check.xorout or 0,
        )

    # ---- which part may stand where ----

    def _check_places(self, parts: list[Part], nodes: list[Mapping], place: Place, delimited: bool) -> None:
        kinds = [part.kind for part in parts]
        for kind in _ONCE:
            for index in [i for i, other in enumerate(kinds) if other == kind][1:]:
                self._wrong(nodes[index].place, f"a frame has one `{kind}` part at most; remove this one")
        if PartKind.PAYLOAD not in kinds:
            self._wrong(place, "the frame has no payload; add a part such as `- payload: by_length`")
            return
        payload_index = kinds.index(PartKind.PAYLOAD)
        if PartKind.MAGIC in kinds[1:]:
            index = kinds.index(PartKind.MAGIC, 1)
            self._wrong(
                nodes[index].place, "a magic begins the frame; put it first, or write `constant` here"
            )
        if PartKind.TAIL in kinds[:-1]:
            index = kinds.index(PartKind.TAIL)
            self._wrong(nodes[index].place, "a tail ends the frame; put it last, or write `constant` here")
        self._check_payload_rule(parts, nodes, payload_index, delimited)
        constants = sum(len(part.value) for part in parts)
        for limit, found, what in (
            (plan.MAX_CONSTANTS, constants, "bytes of magic, constants and tail"),
            (plan.MAX_CHECKS, kinds.count(PartKind.CHECK), "checks"),
        ):
            if found > limit:
                self._wrong(place, f"the frame has {found} {what}; at most {limit} are possible")

    def _check_payload_rule(
        self, parts: list[Part], nodes: list[Mapping], payload_index: int, delimited: bool
    ) -> None:
        kinds = [part.kind for part in parts]
        rule, at = parts[payload_index].payload, nodes[payload_index].value_place("payload")
        length = kinds.index(PartKind.LENGTH) if PartKind.LENGTH in kinds else None
        message_id = kinds.index(PartKind.ID) if PartKind.ID in kinds else None
        if rule == PayloadRule.BY_LENGTH and length is None:
            self._wrong(
                at, "`payload: by_length` needs a length; add a part such as `- length: u8` before it"
            )
        if rule != PayloadRule.BY_LENGTH and length is not None:
            self._wrong(
                nodes[length].place, "this length tells nothing; write `payload: by_length`, or remove it"
            )
        if rule == PayloadRule.BY_LENGTH and length is not None and length > payload_index:
            self._wrong(
                nodes[length].place, "the length must stand before the payload whose size it tells; move it"
            )
        if rule == PayloadRule.BY_ID and message_id is None:
            self._wrong(at, "`payload: by_id` needs an id; add a part such as `- id: u8` before it")
        if rule == PayloadRule.BY_ID and message_id is not None and message_id > payload_index:
            self._wrong(
                nodes[message_id].place, "the id must stand before the payload whose size it tells; move it"
            )
        if rule == PayloadRule.REST and not delimited:
            self._wrong(
                at, "`payload: rest` needs delimiters, which say where the frame ends; or write by_length"
            )

    def _check_order_of_checks(self, parts: list[Part], nodes: list[Mapping]) -> None:
        """A check over another needs its value. Header checks are worked out first, the rest in order."""
        payload_index = next(i for i, part in enumerate(parts) if part.kind == PartKind.PAYLOAD)

        def turn(index: int) -> tuple[bool, int]:
            return not (index < payload_index and parts[index].last < payload_index), index

        for index, part in enumerate(parts):
            if part.kind != PartKind.CHECK:
                continue
            for covered in range(max(part.first, 0), part.last + 1):
                if parts[covered].kind == PartKind.CHECK and covered != index and turn(covered) > turn(index):
                    self._wrong(
                        nodes[index].place,
                        f"this check covers a later one (line {nodes[covered].place.line}) whose "
                        "value is not known yet; "
                        "end its range before that",
                    )

    def _check_whole(self, draft: Draft, place: Place) -> None:
        parts = draft.parts
        if draft.delimiter is None and not any(
            part.kind in (*_FIXED_BYTES, PartKind.CHECK) for part in parts
        ):
            self._wrong(
                place,
                "nothing tells this frame from other bytes; add `- magic: 0xAA` in front or a check behind",
            )
        longest, shortest = draft.longest_by_length, draft.shortest_by_length
        if longest is None or shortest is None:
            return
        at = draft.places[next(i for i, part in enumerate(parts) if part.kind == PartKind.LENGTH)]
        if longest < 0:
            self._wrong(
                at, "the length counts more than it can tell, even for an empty payload; take a wider type"
            )
        elif shortest > 0:
            self._wrong(
                at,
                f"with this offset a payload under {shortest} bytes would have a negative length; "
                "take a greater one",
            )


def _lower(syntax: PartSyntax, order: ByteOrder) -> Part:
    """A part by itself; a check's algorithm and range come later."""
    if isinstance(syntax, MagicPart):
        return Part(PartKind.MAGIC, "", len(syntax.magic), value=syntax.magic)
    if isinstance(syntax, ConstantPart):
        return Part(PartKind.CONSTANT, "", len(syntax.constant), value=syntax.constant)
    if isinstance(syntax, TailPart):
        return Part(PartKind.TAIL, "", len(syntax.tail), value=syntax.tail)
    if isinstance(syntax, LengthPart):
        wire = syntax.length.type
        counts = LengthCounts(syntax.length.counts)
        return Part(
            PartKind.LENGTH,
            "",
            wire.size,
            wire.order or order,
            counts=counts,
            length_offset=syntax.length.offset,
        )
    if isinstance(syntax, IdPart):
        return Part(PartKind.ID, "", syntax.id.size, syntax.id.order or order)
    if isinstance(syntax, ReservedPart):
        return Part(PartKind.RESERVED, "", syntax.reserved)
    if isinstance(syntax, PayloadPart):
        if isinstance(syntax.payload, int):
            return Part(PartKind.PAYLOAD, "", 0, payload=PayloadRule.FIXED, fixed_payload=syntax.payload)
        return Part(PartKind.PAYLOAD, "", 0, payload=PayloadRule(syntax.payload))
    assert isinstance(syntax, CheckPart)
    return Part(PartKind.CHECK, "", 0)


def _unique(names: list[str]) -> list[str]:
    """`constant`, `constant_2`, … where parts without a name share a kind."""
    given: list[str] = []
    for name in names:
        number, candidate = 2, name
        while candidate in given or (candidate != name and candidate in names):
            candidate, number = f"{name}_{number}", number + 1
        given.append(candidate)
    return given
