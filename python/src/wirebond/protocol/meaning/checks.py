"""A check's algorithm: from the words of the file to its parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from wirebond.protocol import algorithms
from wirebond.protocol.model import Algorithm, ByteOrder, CheckKind, OddTail
from wirebond.protocol.problems import Place
from wirebond.protocol.text.check_grammar import Check
from wirebond.protocol.text.yaml_tree import Mapping

_CRC_ALONE = ("poly", "refin", "refout")
_MOST_BITS = 32  # of other checks than CRCs, and of all checks over words
_FEWEST_CRC_BITS = 3
_BYTE = 8  # bits


def algorithm_of(check: Check, node: Mapping, order: ByteOrder, wrong: Callable[[Place, str], None]) -> Algorithm:
    """Return the algorithm that ``check`` describes. ``order``: of the check's bytes; ``wrong`` takes what cannot
    be."""
    return _Reader(check, node, wrong).read(order)


class _Reader:
    def __init__(self, check: Check, node: Mapping, wrong: Callable[[Place, str], None]) -> None:
        self._check = check
        self._node = node
        self._wrong = wrong

    def read(self, order: ByteOrder) -> Algorithm:
        known = algorithms.find(self._check.type)
        base = self._own() if known is None else self._known(known)
        self._validate_options(base)
        found = self._with_options(base, order)
        self._validate_sizes(found)
        return found

    def _given(self, key: str) -> Any:
        return getattr(self._check, key)

    # ---- where it begins: a name, or a kind with a width

    def _own(self) -> Algorithm:
        kind = algorithms.OWN_KINDS[self._check.type]
        for key in ("width", "poly") if kind == CheckKind.CRC else ("width",):
            if self._given(key) is None:
                of_own = "a CRC of your own" if kind == CheckKind.CRC else f"`{kind.value}`"
                self._wrong(
                    self._node.key_place("type"), f"{of_own} needs `{key}`; or {algorithms.advice_for_kind(kind)}"
                )
        width = int(self._given("width") or 16)
        self._validate_width(kind, width)
        poly = self._given("poly") or 0
        if kind == CheckKind.CRC and self._given("poly") is not None and poly % 2 == 0:
            self._wrong(
                self._node.value_place("poly"),
                "a CRC's polynomial is odd; write it highest power first (0x1021), without its "
                "leading one, not reflected",
            )
        return Algorithm(
            self._check.type, kind, width, poly, refin=bool(self._given("refin")), refout=bool(self._given("refout"))
        )

    def _known(self, known: Algorithm) -> Algorithm:
        """Return a known algorithm by its name. Only parameters that it leaves open may be given."""
        own = ["width"]
        if known.kind == CheckKind.CRC:
            own += [*_CRC_ALONE, "init", "xorout"]
        own += [
            key for key, is_set in (("xorout", known.xorout), ("modulo", known.modulus), ("init", known.init)) if is_set
        ]
        own += ["negate", "sums_to"] * known.negate
        own += ["unit"] * (known.unit > 1)
        own += ["carry"] * known.end_around
        for key in dict.fromkeys(own):
            if self._given(key) is not None:
                self._wrong(
                    self._node.key_place(key),
                    f"`{self._check.type}` has its own `{key}`; remove this, or write `type: {known.kind.value}` for "
                    "your own",
                )
        return known

    def _validate_width(self, kind: CheckKind, width: int) -> None:
        least, most = (_FEWEST_CRC_BITS, 64) if kind == CheckKind.CRC else (1, _MOST_BITS)
        place = self._node.value_place("width")
        if not least <= width <= most:
            self._wrong(place, f"a check of this kind has {least} to {most} bits; write one of these")
        elif kind == CheckKind.FLETCHER and width not in (8, 16, 32):
            self._wrong(place, "Fletcher's two sums have 8, 16 or 32 bits together; write one of these")

    # ---- changes to the algorithm in the file

    def _validate_options(self, base: Algorithm) -> None:
        """Refuse options that this kind of check does not have."""
        for keys, kinds, what in (
            (_CRC_ALONE, (CheckKind.CRC,), "a CRC"),
            (("carry",), (CheckKind.SUM,), "a sum"),
            (("modulo",), (CheckKind.SUM, CheckKind.FLETCHER), "a sum or Fletcher's"),
            (("sums_to",), (CheckKind.SUM,), "a sum"),
            (("bcd",), (CheckKind.SUM,), "a sum"),
        ):
            for key in keys:
                if self._given(key) is not None and base.kind not in kinds:
                    self._wrong(self._node.key_place(key), f"only {what} has `{key}`; remove it")
        for one, other in (("sums_to", "negate"), ("sums_to", "plus"), ("carry", "modulo")):
            if self._given(one) is not None and self._given(other) is not None:
                self._wrong(
                    self._node.key_place(other), f"`{other}` cannot be combined with `{one}`; remove one of them"
                )
        unit = self._given("unit") or base.unit
        if unit == 1:
            for key in ("unit_order", "odd"):
                if self._given(key) is not None:
                    self._wrong(self._node.key_place(key), f"`{key}` is about words; add `unit: 2` or `unit: 4`")
        for key in ("poly", "init", "plus", "sums_to", "mask", "xorout"):
            value = self._given(key)
            if value is not None and value >= 2**base.width:
                self._wrong(
                    self._node.value_place(key),
                    f"{value:#x} has more than {base.width} bits; write at most {2**base.width - 1:#x}",
                )

    def _with_options(self, base: Algorithm, order: ByteOrder) -> Algorithm:
        options: dict[str, Any] = {}
        for key in ("init", "xorout", "modulo", "negate", "plus", "mask", "unit"):
            value = self._given(key)
            if value is not None:
                options["modulus" if key == "modulo" else key] = value if key == "negate" else int(value)
        found = replace(base, **options)
        if (total := self._given("sums_to")) is not None:
            found = replace(found, negate=True, plus=total)
        if (odd := self._given("odd")) is not None:
            found = replace(found, odd=OddTail(odd))
        if (carry := self._given("carry")) is not None:
            found = replace(found, end_around=carry == "end_around")
        if self._given("bcd"):
            found = replace(found, bcd=True)
        if self._check.avoid is not None:
            found = replace(found, avoided=self._check.avoid.values, avoided_plus=self._check.avoid.plus)
        if found.unit == 1:
            return found
        if (given := self._given("unit_order")) is not None:
            return replace(found, unit_order=ByteOrder(given))
        return replace(found, unit_order=order) if base.unit == 1 else algorithms.in_order(found, order)

    def _validate_sizes(self, found: Algorithm) -> None:
        room = found.width // 2 if found.kind == CheckKind.FLETCHER else found.width
        if found.modulus > 2**room:
            self._wrong(self._node.value_place("modulo"), f"{room} bits hold less; write at most {2**room}")
        if found.kind == CheckKind.SUM and found.modulus and found.init >= found.modulus:
            self._wrong(self._node.key_place("init"), f"a sum modulo {found.modulus} begins below that; write less")
        if found.bcd and found.width % 4:
            self._wrong(
                self._node.key_place("bcd"),
                f"a decimal digit has four bits, and {found.width} are not a multiple of that"
                f"; write `width: {found.width + -found.width % 4}`",
            )
        self._validate_avoided(found)
        if found.unit == 1:
            return
        if found.width > _MOST_BITS:
            self._wrong(
                self._node.key_place("unit"),
                f"a check over words has at most {_MOST_BITS} bits; remove `unit`, or take a narrower one",
            )
        if found.kind in (CheckKind.XOR, CheckKind.FLETCHER) and room < 8 * found.unit:
            self._wrong(
                self._node.key_place("unit"),
                f"{room} bits do not hold words of {8 * found.unit}; write `unit: {max(1, room // 8)}`, or more bits",
            )
        if found.kind == CheckKind.CRC and found.odd == OddTail.XOR:
            self._wrong(self._node.key_place("odd"), "a CRC has no `odd: xor`; write pad or refuse")

    def _validate_avoided(self, found: Algorithm) -> None:
        if not found.avoided:
            return
        place = self._node.key_place("avoid")
        if found.width > _BYTE or self._given("text") is not None:
            self._wrong(place, "only a check of up to 8 bits, sent as a byte, has values to avoid; remove `avoid`")
            return
        every = (1 << found.width) - 1
        if found.avoided_plus > every or any(high > every for _, high in found.avoided):
            self._wrong(place, f"the check has {found.width} bits; write values and `plus` of at most {every:#x}")
            return

        def is_avoided(value: int) -> bool:
            return any(low <= value <= high for low, high in found.avoided)

        for value in filter(is_avoided, range(every + 1)):
            instead = value + found.avoided_plus & every
            if is_avoided(instead):
                self._wrong(
                    place, f"{value:#x} becomes {instead:#x}, which is to be avoided, too; write another `plus`"
                )
                return
