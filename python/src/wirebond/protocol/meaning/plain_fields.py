"""A value of a message that has bytes of its own: how many times it occurs, and in how many bytes."""

from __future__ import annotations

from dataclasses import replace

from wirebond.protocol.meaning.counts import Amount, Counting
from wirebond.protocol.meaning.fields import MAX_CONSTANT, STRINGS, ValueReader
from wirebond.protocol.model import SIGN_MAGNITUDE, BitOrder, ByteOrder, Digits, End, Field, FieldKind
from wirebond.protocol.problems import Problems
from wirebond.protocol.stamps import stamp_fault
from wirebond.protocol.text.field_grammar import TO_END, CountSyntax, PlainSyntax
from wirebond.protocol.text.yaml_tree import Mapping

# Of numbers in characters: a double holds every whole number of this width, and has bits left for a scale.
_MOST_BITS = 48
_MOST_CHARACTERS = 32  # more than any of them has
_NUMBER_CHARACTERS = {10: b"0123456789+-.", 16: b"0123456789abcdefABCDEF+"}


# What a number in characters cannot have.
_NOT_IN_CHARACTERS = ("count", "packed", "clock", "constant")


def read_plain(
    name: str, syntax: PlainSyntax, node: Mapping, order: ByteOrder, earlier: dict[str, Field], problems: Problems
) -> Field | None:
    """Return the field, or None when something about it was wrong and has been reported.

    ``earlier``: the fields before it, beside it; one of them may count its elements or bytes.
    """
    return _PlainReader(syntax, syntax.type, node, problems).read(name, syntax, order, earlier)


class _PlainReader(ValueReader):
    def read(self, name: str, syntax: PlainSyntax, order: ByteOrder, earlier: dict[str, Field]) -> Field | None:
        kind = self._type.kind
        self._validate_options()
        if syntax.text is not None and self._good:
            return self._in_characters(name, syntax, syntax.text)
        if syntax.decimals is not None:
            self._wrong(
                self._node.key_place("decimals"), "`decimals` is for numbers in characters; add `text: decimal`"
            )
        self._validate_size(syntax)
        self._validate_packed(syntax)
        count = self._amount("count", syntax.count, syntax.max, earlier)
        size = self._amount("size", syntax.size, syntax.max, earlier)
        if not self._good:
            return None
        is_string = kind in STRINGS
        packed = None if syntax.packed is None else BitOrder(syntax.packed.removesuffix("_first"))
        bits = 1 if kind == FieldKind.BOOL else self._type.width
        is_constant = syntax.constant is not None or syntax.must_be_zero
        field = Field(
            **self._common(name),
            size=0 if packed else size.fixed or 0 if is_string or kind == FieldKind.PADDING else self._type.size,
            order=self._type.order or order,
            count=count.fixed,
            max_size=(MAX_CONSTANT if is_constant else syntax.max or 0) if is_string else 0,
            bits=0 if packed is None else bits,
            packed=packed,
            max_count=0 if is_string or count.fixed is not None else syntax.max or 0,
            **(size if is_string else count).options(),
            ends_with=None if syntax.ends_with is None else syntax.ends_with[0],
            clock=None if syntax.clock is None else End(syntax.clock),
        )
        if field.clock is not None and (fault := stamp_fault(field)):
            self._wrong(self._node.key_place("clock"), fault)
            return None
        return self._constant(field) if is_constant else self._validated(field)

    def _in_characters(self, name: str, syntax: PlainSyntax, notation: str) -> Field | None:
        """Return a number whose digits are sent. A string in every question of place, and a number in every other
        one."""
        digits = Digits(16 if notation == "hex" else 10, syntax.decimals or 0)
        self._validate_characters(syntax, digits)
        if not self._good:
            return None
        common = self._common(name)
        field = Field(
            **{**common, "scale": common["scale"] / 10**digits.decimals},
            size=syntax.size if isinstance(syntax.size, int) else 0,
            bits=self._type.width,
            digits=digits,
        )
        longest = max(len(digits.text(number)) for number in replace(field, max_size=_MOST_CHARACTERS).whole_limits)
        field = replace(
            field,
            max_size=0 if field.size else syntax.max or longest,
            ends_with=None if syntax.ends_with is None else syntax.ends_with[0],
        )
        return self._validated(field)

    def _validate_characters(self, syntax: PlainSyntax, digits: Digits) -> None:
        node, wire_type = self._node, self._type
        for option in _NOT_IN_CHARACTERS:
            if getattr(syntax, option) is not None:
                self._wrong(node.key_place(option), f"`{option}` cannot be combined with `text`; remove one of the two")
        if (
            wire_type.order is not None
            or wire_type.coding == SIGN_MAGNITUDE
            or wire_type.bits
            or wire_type.width > _MOST_BITS
        ):
            sign = "i" if wire_type.is_signed else "u"
            width = min(-(-wire_type.width // 8) * 8, _MOST_BITS)
            self._wrong(
                node.value_place("type"),
                f"{wire_type.word} says how bits lie, or has more than {_MOST_BITS}, and only digits are sent here; "
                f"write `{sign}{width}`",
            )
        if digits.base == 16 and wire_type.is_signed:
            self._wrong(node.value_place("type"), f"hex digits have no sign; write `u{wire_type.width}`")
        if digits.base == 16 and digits.decimals:
            self._wrong(node.key_place("decimals"), "hex digits have no point; remove it, or write `text: decimal`")
        least = len(digits.text(0))
        for option in ("size", "max"):
            number = getattr(syntax, option)
            if option == "size" and isinstance(number, str | CountSyntax):
                self._wrong(
                    node.value_place(option), "no field counts the characters of a number; write how many it has"
                )
            elif number is not None and number < least:
                self._wrong(
                    node.value_place(option), f"{digits.text(0)} has {least} characters; write at least {least}"
                )
        if syntax.size is not None:
            for option in ("max", "ends_with"):
                if getattr(syntax, option) is not None:
                    self._wrong(
                        node.key_place(option), f"`{option}` cannot be combined with `size`; keep one of the two"
                    )
        if syntax.ends_with is not None and syntax.ends_with[0] in _NUMBER_CHARACTERS[digits.base]:
            self._wrong(
                node.value_place("ends_with"),
                "this byte can be part of a number; take another one, such as 0x2C for a comma",
            )

    def _validate_size(self, syntax: PlainSyntax) -> None:
        kind, node = self._type.kind, self._node
        if kind in STRINGS and syntax.constant is not None:
            if isinstance(syntax.size, str):
                self._wrong(node.value_place("size"), "a constant has always as many bytes; remove `size`")
        elif kind in STRINGS and syntax.size is None and syntax.max is None:
            self._wrong(
                node.value_place("type"),
                f"a {syntax.type.word} field needs a size; add `size: 16` (bytes, always as many) "
                "or `max: 16` (at most)",
            )
        if kind == FieldKind.PADDING and syntax.size is None:
            self._wrong(node.value_place("type"), "padding needs its number of bytes; add `size: 2`")
        if kind == FieldKind.PADDING and isinstance(syntax.size, str):
            self._wrong(node.value_place("size"), "padding has always as many bytes; write their number")
        if syntax.ends_with is not None and kind in STRINGS:
            self._validate_end(syntax, syntax.ends_with[0])
        if syntax.max is None:
            return
        if isinstance(syntax.size, int):
            self._wrong(node.key_place("max"), "`max` cannot be combined with `size`; keep one of the two")
        elif isinstance(syntax.count, int):
            self._wrong(node.key_place("max"), "`max` is for a number that varies; remove it, or the number")
        elif kind not in STRINGS and syntax.count is None:
            self._wrong(
                node.key_place("max"),
                "`max` is for text, bytes and arrays of varying size; for an array of numbers write `count`",
            )

    def _validate_end(self, syntax: PlainSyntax, end: int) -> None:
        place = self._node.value_place("ends_with")
        if syntax.size is not None:
            self._wrong(place, "a field with `ends_with` has no `size`; write `max: 16` (bytes before that byte)")
        if self._type.kind == FieldKind.TEXT and end >= 0x80:
            self._wrong(place, "bytes from 0x80 on are parts of letters in UTF-8; write one below, or take `bytes`")

    def _validate_packed(self, syntax: PlainSyntax) -> None:
        node, wire_type = self._node, self._type
        if syntax.packed is None:
            if wire_type.bits:
                self._wrong(
                    node.value_place("type"),
                    f"{wire_type.word} is not a whole number of bytes; pack several (`count: 8, packed: low_first`), "
                    f"put it among `bits`, or take {wire_type.word[0]}{-(-wire_type.bits // 8) * 8}",
                )
            return
        if wire_type.order is not None:
            self._wrong(
                node.value_place("type"),
                f"packed bits have no byte order; write `{wire_type.word[:-2]}`",
            )
        if syntax.count is None:
            self._wrong(node.key_place("packed"), "`packed` has no meaning without `count`; add `count: 16`")
        elif not isinstance(syntax.count, int):
            self._wrong(node.value_place("count"), "packed elements are always as many; write their number")

    def _amount(
        self, key: str, amount: int | str | CountSyntax | None, most: int | None, earlier: dict[str, Field]
    ) -> Amount:
        if key == "size" and amount == TO_END:
            self._wrong(
                self._node.value_place("size"), "a string reaches to the payload's end by itself; write `max` alone"
            )
            return Amount()
        step = 1 if self._type.kind in STRINGS else self._type.size
        found = Counting(self._node, key, earlier, most, step, self._problems).read(amount)
        self._good = self._good and found is not None
        return found or Amount()
