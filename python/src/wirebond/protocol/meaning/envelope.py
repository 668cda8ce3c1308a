"""Reads the envelope around a frame's parts: delimiters, stuffing, silence. The parts themselves are not examined."""

from __future__ import annotations

from collections.abc import Callable

from wirebond.protocol import plan
from wirebond.protocol.meaning.draft import Envelope
from wirebond.protocol.model import Escapes, Insertion, Stuffing
from wirebond.protocol.problems import Place
from wirebond.protocol.spelling import bytes_text
from wirebond.protocol.text.envelope_grammar import (
    CobsPart,
    DelimiterPart,
    DoubledPart,
    EscapedPart,
    HdlcPart,
    HexPart,
    InsertedPart,
    SilencePart,
    SlipPart,
)
from wirebond.protocol.text.frame_grammar import MagicPart, PartSyntax, PayloadPart
from wirebond.protocol.text.wording import Syntax
from wirebond.protocol.text.yaml_tree import Mapping, Node, Sequence

Outer = list[tuple[Syntax, Node]]  # the entries of the `frame` section
Wrong = Callable[[Place, str], None]


def read_envelope(outer: Outer, wrong: Wrong) -> Envelope:
    """Read the envelope. ``wrong`` is called with a place and a sentence for each mistake; the result means nothing
    then."""
    stuffed = [(syntax, node) for syntax, node in outer if stuffed_parts(syntax, node) is not None]
    marks = [(i, syntax, node) for i, (syntax, node) in enumerate(outer) if isinstance(syntax, DelimiterPart)]
    silences = [(i, syntax, node) for i, (syntax, node) in enumerate(outer) if isinstance(syntax, SilencePart)]
    if silences:
        return _silence(outer, silences, bool(marks or stuffed), wrong)
    if not marks:
        return _sized(outer, stuffed, wrong) if stuffed else Envelope()
    places = [i for i, _, _ in marks]
    if places not in ([0, len(outer) - 1], [len(outer) - 1]) or len(outer) < 2:
        wrong(
            marks[0][2].place,
            "delimiters are the first and the last part of a frame, or only the last, and nowhere else; "
            + _advice(stuffed),
        )
        return Envelope()
    if len(stuffed) > 1:
        wrong(stuffed[1][1].place, "a frame has one group of stuffed parts; put all parts into the first")
    elif stuffed:
        _validate_plain_parts(outer, wrong)
    reader = _Delimited(marks, bool(stuffed) and isinstance(stuffed[0][0], DoubledPart), wrong)
    kind, escapes = reader.stuffing(stuffed[0][0]) if stuffed else (Stuffing.NONE, None)
    return Envelope(reader.closing, reader.opening, kind, escapes)


def _sized(outer: Outer, stuffed: Outer, wrong: Wrong) -> Envelope:
    """Read an envelope without delimiter: the frame begins with its magic, and its length gives its end."""
    syntax, node = stuffed[0]
    if not isinstance(syntax, EscapedPart | InsertedPart):
        wrong(node.place, f"stuffing needs a delimiter before and after it; {_advice(stuffed)}")
        return Envelope()
    if len(stuffed) > 1:
        wrong(stuffed[1][1].place, "a frame has one group of stuffed parts; put all parts into the first")
    first, first_node = outer[0]
    if not isinstance(first, MagicPart):
        wrong(
            first_node.place,
            "without delimiters a stuffed frame begins with its magic, which is not stuffed; put `- magic: 0x7E` "
            f"first, or {_advice(stuffed)}",
        )
        return Envelope()
    _validate_plain_parts(outer, wrong)
    for part, part_node in stuffed_parts(syntax, node) or []:
        if part.when is not None:
            wrong(
                part_node.value_place("when"), "in a stuffed frame that its length ends every part is there; remove it"
            )
        if isinstance(part, MagicPart):
            wrong(part_node.place, "a magic begins the frame; write `constant` here")
    if isinstance(syntax, InsertedPart):
        rule = syntax.inserted
        return Envelope(stuffing=Stuffing.INSERTION, insertion=Insertion(rule.after, rule.byte[0]))
    values = [value for _, value in first.magic.by_end] if first.magic.by_end else list(first.magic.values)
    if len(values[0]) != 1:
        wrong(
            first_node.place,
            "`escaped` keeps the first byte of a frame out of its content; write a magic of one byte, and the bytes "
            "after it as a `constant`",
        )
    escapes = own_rule(syntax, [value[0] for value in values], node.place, wrong)
    return Envelope(stuffing=Stuffing.ESCAPE, escapes=escapes)


def _validate_plain_parts(outer: Outer, wrong: Wrong) -> None:
    """Check that parts beside the stuffed ones have the same place in every frame."""
    for syntax, node in outer:
        if isinstance(syntax, PayloadPart):
            wrong(node.place, "the payload must be among the stuffed parts; move it there")
        elif isinstance(syntax, PartSyntax) and syntax.when is not None and isinstance(node, Mapping):
            wrong(node.value_place("when"), "beside stuffed parts a part is always there; remove `when`")


def _silence(outer: Outer, silences: list[tuple[int, SilencePart, Node]], others: bool, wrong: Wrong) -> Envelope:
    index, syntax, node = silences[0]
    if index != len(outer) - 1 or len(silences) > 1:
        wrong(node.place, "the silence ends the frame; make it the one last part")
    if others:
        wrong(node.place, "a frame ends by silence or by a delimiter; remove one of the two")
    return Envelope(silence=syntax.silence)


class _Delimited:
    """The delimiters, and whether a stuffing keeps them out of the frame."""

    def __init__(self, marks: list[tuple[int, DelimiterPart, Node]], doubles: bool, wrong: Wrong) -> None:
        self._marks = marks
        self._wrong = wrong
        self._place = marks[0][2].place
        self.closing = marks[-1][1].delimiter
        self.opening = marks[0][1].delimiter if len(marks) == 2 else None
        self._opens_alone = doubles and self.opening == self.closing[:1] and len(self.closing) == 2
        self._validate_marks()

    def _validate_marks(self) -> None:
        for _, mark, node in self._marks:
            if len(mark.delimiter) == 2 and len(set(mark.delimiter)) == 1 and isinstance(node, Mapping):
                self._wrong(
                    node.value_place("delimiter"),
                    "in a row of equal bytes a receiver cannot know which two are the delimiter; write one byte, or "
                    "two that differ",
                )
        opening, closing = self.opening, self.closing
        if opening is None or opening == closing or self._opens_alone:
            return
        if opening.startswith(closing) or closing.startswith(opening):
            self._wrong(
                self._place, "one of these delimiters begins with the other; choose two that a receiver can distinguish"
            )

    def stuffing(self, syntax: Syntax) -> tuple[Stuffing, Escapes | None]:
        if isinstance(syntax, DoubledPart):
            return Stuffing.ESCAPE, self._doubled()
        if isinstance(syntax, HexPart):
            self._validate_digits()
            return Stuffing.HEX if syntax.first is None else Stuffing.HEX_AFTER_DIGIT, None
        if isinstance(syntax, InsertedPart):
            self._wrong(
                self._place,
                "`inserted` is for frames that begin with a magic and end by their length; remove the delimiters",
            )
            return Stuffing.NONE, None
        self._validate_sizes(syntax)
        if isinstance(syntax, CobsPart):
            return Stuffing.COBS, None
        if isinstance(syntax, SlipPart):
            return Stuffing.ESCAPE, Escapes(0xDB, 0, ((0xC0, 0xDC), (0xDB, 0xDD)))
        if isinstance(syntax, HdlcPart):
            return Stuffing.ESCAPE, Escapes(0x7D, 0x20, ((0x7E, 0x5E), (0x7D, 0x5D)))
        assert isinstance(syntax, EscapedPart)
        delimiters = [mark.delimiter[0] for _, mark, _ in reversed(self._marks)]
        return Stuffing.ESCAPE, own_rule(syntax, delimiters, self._place, self._wrong)

    def _validate_digits(self) -> None:
        for _, mark, node in self._marks:
            if isinstance(node, Mapping) and any(byte in b"0123456789ABCDEFabcdef" for byte in mark.delimiter):
                self._wrong(
                    node.value_place("delimiter"),
                    "this delimiter is a hex digit, and would cut the frame; take another, such as 0x3A and 0x0D 0x0A",
                )

    def _validate_sizes(self, syntax: Syntax) -> None:
        """Validate the stuffings that keep single bytes out of a frame; some of them only one byte."""
        wanted = _DELIMITERS.get(type(syntax))
        for _, mark, node in self._marks:
            if not isinstance(node, Mapping):
                continue
            if wanted is not None and mark.delimiter != wanted[0]:
                self._wrong(
                    node.value_place("delimiter"),
                    f"{wanted[1]} frees a frame of {bytes_text(wanted[0])} and of no other delimiter; "
                    f"write {bytes_text(wanted[0])}",
                )
            elif len(mark.delimiter) == 2:
                self._wrong(
                    node.value_place("delimiter"),
                    "`escaped` frees a frame of single bytes; write one byte, or `doubled` for `escaped`",
                )

    def _doubled(self) -> Escapes:
        opening = self.opening or b""
        starts_alike = len(self.closing) == 2 and opening[:1] == self.closing[:1] and opening != self.closing
        if not starts_alike:
            self._wrong(
                self._place,
                "`doubled` needs two delimiters that begin alike and end differently; write `- delimiter: 0x10 0x02` "
                "(or 0x10 alone), `- doubled: [...]`, `- delimiter: 0x10 0x03`",
            )
        elif opening[0] in (*opening[1:], self.closing[1]):
            self._wrong(self._place, "a delimiter whose bytes are equal looks like a doubled byte; take another")
        byte = self.closing[0]
        return Escapes(byte, 0, ((byte, byte),))


def own_rule(syntax: EscapedPart, marks: list[int], place: Place, wrong: Wrong) -> Escapes:
    """Return the escapes for ``marks``, the bytes that must not appear because frames begin or end with them."""
    rule = syntax.escaped
    escape, xor = rule.escape[0], rule.xor[0]
    plain = dict.fromkeys([*marks, escape, *(rule.also or b"")])
    if len(plain) > plan.MAX_ESCAPES:
        wrong(place, f"{len(plain)} bytes are stuffed; at most {plan.MAX_ESCAPES} are possible")
    codes = {byte ^ xor for byte in plain}
    if xor == 0 or escape in marks or codes & set(marks):
        wrong(
            place,
            "this escape rule can put a delimiter on the line; take an escape byte that is not a delimiter, and "
            "an xor after which no stuffed byte is one",
        )
    return Escapes(escape, xor, tuple((byte, byte ^ xor) for byte in plain))


_DELIMITERS: dict[type[Syntax], tuple[bytes, str]] = {
    CobsPart: (b"\x00", "COBS"),
    SlipPart: (b"\xc0", "SLIP"),
    HdlcPart: (b"\x7e", "HDLC"),
}


def stuffed_parts(syntax: Syntax, node: Node) -> list[tuple[PartSyntax, Mapping]] | None:
    """Return the parts within a stuffed group, with their places; None for anything else."""
    if not isinstance(node, Mapping):
        return None
    items: Node | None
    if isinstance(syntax, EscapedPart):
        options = node.get("escaped")
        items = options.get("parts") if isinstance(options, Mapping) else None
        parts = syntax.escaped.parts
    elif isinstance(syntax, CobsPart):
        items, parts = node.get("cobs"), syntax.cobs
    elif isinstance(syntax, SlipPart):
        items, parts = node.get("slip"), syntax.slip
    elif isinstance(syntax, HdlcPart):
        items, parts = node.get("hdlc"), syntax.hdlc
    elif isinstance(syntax, DoubledPart):
        items, parts = node.get("doubled"), syntax.doubled
    elif isinstance(syntax, HexPart):
        items, parts = node.get("hex"), syntax.hex
    elif isinstance(syntax, InsertedPart):
        options = node.get("inserted")
        items = options.get("parts") if isinstance(options, Mapping) else None
        parts = syntax.inserted.parts
    else:
        return None
    assert isinstance(items, Sequence)
    return [(part, item) for part, item in zip(parts, items.items, strict=True) if isinstance(item, Mapping)]


def _advice(stuffed: Outer) -> str:
    """Show how to write a delimited frame with this stuffing."""
    kinds: dict[type[Syntax], tuple[str, str]] = {SlipPart: ("0xC0", "slip"), HdlcPart: ("0x7E", "hdlc")}
    byte, word = kinds.get(type(stuffed[0][0]), ("0x00", "cobs")) if stuffed else ("0x00", "cobs")
    return f"write `- delimiter: {byte}`, `- {word}: [...]`, `- delimiter: {byte}`"
