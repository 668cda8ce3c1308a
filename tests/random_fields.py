"""Random fields of messages: every type and every option of the vocabulary, as text of a protocol file."""

from __future__ import annotations

import random
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import Context, Decimal
from enum import IntEnum
from fractions import Fraction
from itertools import combinations

from wirebond.protocol.names import code_name

SCALES = ("0.5", "0.1", "0.01", "0.001", "2", "-0.25", "0.0625", "1.5")
OFFSETS = ("-40", "3.2", "-3.2", "100", "0.5")
ENDS = ("0x2C", "0x20", "0x00", "0xFF")  # of numbers in characters
TEXTS = ("", "a", "ok", "né", "0 1")
# Words that generated code may use for itself stand beside plain names.
NAMES = (
    "size", "payload", "message", "bits", "wire", "spare", "found", "bytes", "i", "j", "data", "count", "info", "value",
    "decode", "encode", "clamp", "violations", "out", "reg", "name", "id", "index", "header", "type", "text",
    "mode", "state", "gain", "x", "y", "left", "right", "total",
    # As manuals have them: keywords, capitals, macros.
    "class", "default", "lambda", "None", "RPM", "MotorSpeed", "errno", "EOF", "int", "sender", "hold", "t", "Info",
    "restrict",
)  # fmt: skip
WIDTHS = (8, 8, 16, 16, 24, 24, 24, 32, 32, 40, 48, 56, 64)
MOST_OFFSET = 2**46  # in steps of the wire: doubles have to tell them apart
MOST_SCALED_BITS = 40  # beyond, a double does not tell all numbers of the wire apart
MOST_RANGED_BITS = 48


class Vary(IntEnum):
    """The variable sizes that a frame allows; each value includes those before it."""

    NOTHING = 0
    TOLD = 1  # by counts alone, which tell where the payload ends
    COUNTED = 2  # by a field, or by a byte that ends a text
    TO_END = 3


COUNT = "COUNT"  # stands in a draw for what counts it


@dataclass(frozen=True)
class Drawn:
    """A field's mapping in flow style, and its most bytes on the wire."""

    text: str
    most: int


@dataclass(frozen=True)
class Counter:
    """A field that counts, or one whose bits do; ``path``: what names the number."""

    name: str
    path: str
    bits: int
    drawn: Drawn


class FieldSource:
    """Draws the fields of one protocol's messages, and the named types that they use."""

    def __init__(self, source: random.Random, vary: Vary) -> None:
        self._random = source
        self._vary = vary
        self._defaults = source.choice((0.0, 0.3, 0.9))
        self._types: dict[str, int] = {}  # most bytes of each
        self._constants = False  # may stand here: not within or behind what has elements of various sizes

    def types(self) -> list[str]:
        """Lines of the file's ``types`` section, empty at times. Draw them first: messages use them."""
        lines = []
        for number in range(self._random.choice((0, 0, 1, 2))):
            fields, most = self._list(12, depth=1)
            lines.append(f"  t{number}: {{{fields}}}")
            self._types[f"t{number}"] = most
        return ["types:", *lines] if lines else []

    def message(self, room: int, only_text_to_end: bool = False) -> tuple[str, int]:
        """The fields of one message of at most ``room`` bytes, as the inside of a mapping, and their most bytes.

        ``only_text_to_end``: whatever reaches to the payload's end is a text alone, and nothing else varies.
        """
        self._constants = True
        if only_text_to_end and self._random.random() < 0.3:
            most = self._random.randint(1, room)
            return f"label: {{type: text, max: {most}}}", most
        return self._list(room, depth=0, least=0, ends=self._vary == Vary.TO_END)

    # ---- lists of fields

    def _list(self, room: int, depth: int, least: int = 1, ends: bool = False) -> tuple[str, int]:
        """The inside of a mapping, and its most bytes; ``ends``: the last field may reach to the payload's end."""
        found: dict[str, Drawn] = {}
        left = room
        for _ in range(self._random.randint(least, 5 if depth == 0 else 3)):
            for name, drawn in self._some(left, depth, found).items():
                found[name] = drawn
                left -= drawn.most
        if ends and left > 0 and self._random.random() < 0.3:
            found[self._name(found)] = self._last(left, depth)
        if len(found) < least:
            found["least"] = Drawn("{type: u8}", 1)
        return ", ".join(f"{name}: {d.text}" for name, d in found.items()), sum(d.most for d in found.values())

    def _name(self, taken: dict[str, Drawn]) -> str:
        name = self._random.choice(NAMES) if self._random.random() < 0.5 else f"f{len(taken)}"
        return name if code_name(name) not in map(code_name, taken) else f"g{len(taken)}"

    def _some(self, room: int, depth: int, taken: dict[str, Drawn]) -> dict[str, Drawn]:
        """One field, or a field that counts and those that it counts; nothing where they do not fit."""
        draws = [
            self._number, self._number, self._number, self._bool, self._array, self._packed, self._bits, self._string,
            self._padding,
        ]  # fmt: skip
        nested = [self._struct, self._group] if depth < 3 else []
        if self._vary >= Vary.TOLD and room > 4 and self._random.random() < 0.15:
            return self._counted(room, depth, taken)
        if self._vary >= Vary.COUNTED and room > 1 and self._random.random() < 0.1:
            self._constants = False
            return {self._name(taken): self._ended(room)}
        draw = self._random.choice([*draws, *nested])
        drawn = draw(room, depth) if draw in nested else draw(room)  # type: ignore[call-arg]
        if draw == self._number and drawn is not None:
            drawn = self._at_times_in_characters(drawn, room)
        return {self._name(taken): drawn} if drawn is not None and drawn.most <= room else {}

    # ---- numbers

    def _integer(self, widths: Sequence[int]) -> tuple[str, int]:
        """Letter and bits."""
        letter = self._random.choice("uuuis")
        return letter, max(self._random.choice(widths), 1 if letter == "u" else 2)

    def _order(self, word: str, bits: int) -> str:
        return word + self._random.choice(("", "", "le", "be")) if bits > 8 else word

    def _number(self, _: int = 0) -> Drawn:
        if self._random.random() < 0.2:
            return self._float()
        letter, bits = self._integer(WIDTHS)
        options, default = self._options(letter, bits)
        word = self._order(f"{letter}{bits}", bits)
        return Drawn(f"{{type: {_at_times_digits(word, f'{options}{self._given(default)}')}}}", bits // 8)

    def _at_times_in_characters(self, drawn: Drawn, room: int) -> Drawn:
        """At times a whole number is sent in digits. Drawn by itself, so that other fields stay as they are."""
        found = re.fullmatch(r"\{type: ([ui])(8|16|24|32|40|48)(, .*|)\}", drawn.text)
        own = random.Random(f"characters {drawn.text}")
        if found is None or own.random() < 0.6:
            return drawn
        letter, bits, options = found[1], int(found[2]), found[3]
        notation = own.choice(("decimal", "decimal", "hex")) if letter == "u" else "decimal"
        size = bits // 4 if notation == "hex" else len(str(-(2 ** (bits - 1)) if letter == "i" else 2**bits))
        text = f"{{type: {letter}{bits}, text: {notation}{options}"
        if notation == "decimal" and not re.search("scale|range|default|enum|flags", options):
            decimals = own.randint(1, 4)
            text, size = f"{text}, decimals: {decimals}", max(size + 1, decimals + 3)
        ends = self._vary >= Vary.COUNTED and own.random() < 0.5
        if size + ends > room:
            return drawn
        self._constants = self._constants and not ends
        return Drawn(f"{text}, {f'ends_with: {own.choice(ENDS)}' if ends else f'size: {size}'}}}", size + ends)

    def _float(self) -> Drawn:
        bits = self._random.choice((32, 64))
        options = self._random.choice(
            (
                "",
                "",
                ", range: [-10.5, 20]",
                ", range: [0, 1], on_range: clamp",
                ", scale: 0.5",
                ", scale: -0.25",
                ", scale: 4",
            )
        )
        default = self._random.choice(("0.5", "0", "0.125"))
        return Drawn(f"{{type: {self._order(f'f{bits}', bits)}{options}{self._given(default)}}}", bits // 8)

    def _given(self, default: str) -> str:
        return f", default: {default}" if self._random.random() < self._defaults else ""

    def _options(self, letter: str, bits: int, repeats: bool = False) -> tuple[str, str]:
        """Scale, range or names of an integer, and a value that they allow.

        ``repeats``: the value stands in a list, where flags are numbers.
        """
        half = 2 ** (bits - 1)
        least, most = (0, 2 * half - 1) if letter == "u" else (-half + (letter == "s"), half - 1)
        kind = self._random.choice(("", "", "scale", "scale", "scale", "scale", "range", "enum", "flags"))
        if kind == "enum":
            numbers = sorted({self._random.randint(least, most) for _ in range(self._random.randint(1, 4))})
            words = self._random.choice(
                (("e0", "e1", "e2", "e3"), ("NULL", "Off", "class", "In"), ("is", "EOF", "unix", "X1"))
            )
            names = ", ".join(f"{word}: {number}" for word, number in zip(words, numbers, strict=False))
            return f", enum: {{{names}}}", self._random.choice((f'"{words[0]}"', str(numbers[-1])))
        if kind == "flags" and letter == "u":
            places = self._random.sample(range(bits), min(bits, self._random.randint(1, 3)))
            words = self._random.choice((("b0", "b1", "b2"), ("register", "TX_Full", "try")))
            names = ", ".join(f"{word}: {place}" for word, place in zip(words, places, strict=False))
            value = str(1 << places[-1])
            return f", flags: {{{names}}}", value if repeats else self._random.choice((f"[{words[0]}]", "[]", value))
        scale, offset, options = Fraction(1), Fraction(0), ""
        if kind == "scale" and bits <= MOST_SCALED_BITS:
            word = self._random.choice(SCALES) if self._random.random() < 0.3 else self._awkward(-9, 3)
            scale, options = Fraction(word), f", scale: {word}, unit: m"
            if self._random.random() < 0.4:
                word = self._random.choice(OFFSETS) if self._random.random() < 0.3 else self._awkward(-3, 4)
                if abs(Fraction(word)) <= MOST_OFFSET * abs(scale):
                    offset, options = Fraction(word), f"{options}, offset: {word}"
        wires = sorted((self._random.randint(least, most), self._random.randint(least, most)))
        values = sorted(wire * scale + offset for wire in wires)
        ranged = kind in ("scale", "range") and bits <= MOST_RANGED_BITS and values[0] < values[1]
        if ranged and (kind == "range" or self._random.random() < 0.5):
            rule = self._random.choice(("", ", on_range: clamp", ", on_range: reject"))
            options += f", range: [{decimal(values[0])}, {decimal(values[1])}]{rule}"
        return options, decimal(self._random.choice(values))

    def _awkward(self, least: int, most: int) -> str:
        """A number of up to nine digits that no float holds, times a power of ten: products with it are wide."""
        digits = self._random.randrange(1, 10 ** self._random.choice((1, 3, 6, 7, 8, 9)))
        sign = self._random.choice((1, 1, -1))
        return decimal(Fraction(sign * digits) * Fraction(10) ** self._random.randint(least, most))

    def _bool(self, _: int) -> Drawn:
        return Drawn(f"{{type: bool{self._given(self._random.choice(('true', 'false')))}}}", 1)

    def _element(self) -> tuple[str, int, str]:
        """Type and options of an array's elements, their bytes, and a value that they allow."""
        if self._random.random() < 0.15:
            return "type: bool", 1, "true"
        if self._random.random() < 0.2:
            bits = self._random.choice((32, 64))
            return f"type: {self._order(f'f{bits}', bits)}", bits // 8, "0.25"
        letter, bits = self._integer(range(8, 65, 8))
        options, default = self._options(letter, bits, repeats=True)
        return f"type: {self._order(f'{letter}{bits}', bits)}{options}", bits // 8, default

    def _array(self, _: int) -> Drawn:
        element, size, default = self._element()
        count = self._random.randint(1, 4)
        one = self._random.choice((default, f"[{', '.join([default] * count)}]"))
        return Drawn(f"{{{element}, count: {count}{self._given(one)}}}", size * count)

    def _packed(self, room: int) -> Drawn:
        count = self._random.randint(1, 9)
        if self._random.random() < 0.2:
            word, bits, options, default = "bool", 1, "", "true"
        else:
            letter, bits = self._integer(range(1, max(2, min(64, 8 * room // count) + 1)))
            word, (options, default) = f"{letter}{bits}", self._options(letter, bits, repeats=True)
        order = self._random.choice(("low_first", "high_first"))
        given = self._given(f"[{', '.join([default] * count)}]")
        described = f", count: {count}, packed: {order}{options}{given}"
        return Drawn(f"{{type: {_at_times_digits(word, described)}}}", (bits * count + 7) // 8)

    def _bits(self, _: int) -> Drawn:
        width = self._random.choice((8, 8, 16, 24, 32, 40, 48, 56, 64))
        left, members = width, []
        for number in range(self._random.randint(1, 5)):
            if left < 2:
                break
            if self._random.random() < 0.2:
                members.append(f"m{number}: {{type: bool{self._given('true')}}}")
                left -= 1
            elif self._random.random() < 0.2:
                size = self._random.randint(1, min(left, 7))
                must = ", must_be_zero: true" if self._constants and self._random.random() < 0.3 else ""
                members.append(f"m{number}: {{type: padding, size: {size}{must}}}")
                left -= size
            elif self._constants and self._random.random() < 0.1:
                bits = self._random.randint(1, left)
                members.append(f"m{number}: {{type: u{bits}, constant: {self._random.randrange(2**bits)}}}")
                left -= bits
            else:
                letter, bits = self._integer(range(1, left + 1))
                options, default = self._options(letter, bits)
                described = f"{options}{self._given(default)}"
                members.append(f"m{number}: {{type: {_at_times_digits(f'{letter}{bits}', described)}}}")
                left -= bits
        first = self._random.choice(("", ", first: high", ", first: low"))
        container = self._order(f"u{width}", width)
        listed = ", ".join(_at_times_in_pieces(members))
        return Drawn(f"{{bits: {{type: {container}{first}, fields: {{{listed}}}}}}}", width // 8)

    # ---- strings and padding

    def _string(self, _: int) -> Drawn:
        size = self._random.randint(1, 8)
        kind = self._random.choice(("text", "bytes"))
        return Drawn(f"{{type: {kind}, size: {size}{self._given(self._string_default(kind, size))}}}", size)

    def _string_default(self, kind: str, most: int) -> str:
        if kind == "text":
            fitting = [text for text in TEXTS if len(text.encode()) <= most]
            return f'"{self._random.choice(fitting)}"'
        return " ".join(f"0x{self._random.randrange(256):02X}" for _ in range(self._random.randint(1, most)))

    def _ended(self, room: int) -> Drawn:
        """A string that a byte ends, which no default has in it."""
        most = self._random.randint(1, min(room - 1, 12))
        end = self._random.choice((0x00, 0x00, 0x0D, 0x2C))
        if self._random.random() < 0.3:
            given = self._given(f"0x{self._random.randrange(0x30, 256):02X}")
            return Drawn(f"{{type: bytes, max: {most}, ends_with: 0x{end:02X}{given}}}", most + 1)
        given = self._given(self._string_default("text", most))
        return Drawn(f"{{type: text, max: {most}, ends_with: 0x{end:02X}{given}}}", most + 1)

    def _padding(self, _: int) -> Drawn:
        size = self._random.randint(1, 3)
        if self._constants and self._random.random() < 0.5:
            return self._constant()
        must = self._random.choice(("", ", must_be_zero: true")) if self._constants else ""
        return Drawn(f"{{type: padding, size: {size}{must}}}", size)

    def _constant(self) -> Drawn:
        if self._random.random() < 0.2:
            return Drawn('{type: text, size: 3, constant: "AB"}', 3)
        if self._random.random() < 0.2:
            return Drawn("{type: bytes, constant: 0x0D 0x0A}", 2)
        letter, bits = self._integer((8, 8, 16, 24, 32, 64))
        value = self._random.randrange(2 ** (bits - 1)) * (1 if letter == "u" else self._random.choice((1, -1)))
        return Drawn(f"{{type: {self._order(f'{letter}{bits}', bits)}, constant: {value}}}", bits // 8)

    # ---- fields within fields

    def _own_or_type(self, room: int, depth: int) -> tuple[str, int]:
        """Fields, or the name of a type, and their most bytes."""
        fitting = [name for name, most in self._types.items() if most <= room]
        if fitting and self._random.random() < 0.5:
            name = self._random.choice(fitting)
            self._constants = False  # a text in it may be ended by a byte
            return name, self._types[name]
        fields, most = self._list(room, depth + 1)
        return f"{{{fields}}}", most

    def _struct(self, room: int, depth: int) -> Drawn | None:
        if room < 1:
            return None
        fields, most = self._own_or_type(room, depth)
        return Drawn(f"{{struct: {fields}}}", most)

    def _group(self, room: int, depth: int) -> Drawn | None:
        count = self._random.randint(1, 3)
        if room < count:
            return None
        fields, most = self._own_or_type(room // count, depth)
        return Drawn(f"{{group: {{count: {count}, fields: {fields}}}}}", count * most)

    # ---- what varies in number

    def _counted(self, room: int, depth: int, taken: dict[str, Drawn]) -> dict[str, Drawn]:
        """A field that counts, at times one among bits, at times another field, and one or two that it counts."""
        counter = self._counter(f"n{len(taken)}")
        found = {counter.name: counter.drawn}
        counts = self._random.choice((1, 1, 2))
        second = self._counter(f"m{len(taken)}") if counts == 1 and self._random.random() < 0.2 else None
        if second is not None:
            found[second.name] = second.drawn
        left = room - sum(drawn.most for drawn in found.values())
        for number in range(counts):
            if left > 0 and self._random.random() < 0.3:
                between = self._number()
                if between.most < left:
                    found[f"b{len(taken)}_{number}"] = between
                    left -= between.most
            drawn = self._varying(left, depth, COUNT, alone=counts == 1)
            if drawn is not None:
                how = counter.path if counts > 1 else self._how_counted(drawn, counter, second)
                found[f"v{len(taken)}_{number}"] = replace(drawn, text=drawn.text.replace(COUNT, how))
                left -= drawn.most
        return found if left >= 0 else {}

    def _counter(self, name: str) -> Counter:
        """A number, or one among the bits of a number."""
        bits = self._random.choice((8, 8, 16, 24, 64))
        word = self._order(f"u{bits}", bits)
        if self._random.random() < 0.7:
            return Counter(name, name, bits, Drawn(f"{{type: {word}}}", bits // 8))
        width = self._random.randint(4, bits)  # for at most 15 of anything
        members = [f"many: {{type: u{width}}}"]
        if width < bits:
            members.append(self._random.choice((f"rest: {{type: u{bits - width}}}", "flag: {type: bool}")))
        self._random.shuffle(members)
        first = self._random.choice(("", ", first: high"))
        text = f"{{bits: {{type: {word}{first}, fields: {{{', '.join(members)}}}}}}}"
        return Counter(name, f"{name}.many", width, Drawn(text, bits // 8))

    def _how_counted(self, drawn: Drawn, counter: Counter, second: Counter | None) -> str:
        """Elements by their number, by their bytes, or by both; bytes only where all elements have one size."""
        found = re.search(rf"count: {COUNT}, max: (\d+)(.*)", drawn.text)
        if found is None or re.search(r"max:|\bt\d\b", found.group(2)):
            return counter.path
        if second is not None and drawn.most < 2**second.bits:
            return f"{{elements: {counter.path}, bytes: {second.path}}}"
        if drawn.most < 2**counter.bits and self._random.random() < 0.5:
            return f"{{bytes: {counter.path}}}"
        return self._random.choice((counter.path, f"{{elements: {counter.path}}}"))

    def _last(self, room: int, depth: int) -> Drawn:
        """Draw a field that reaches to the payload's end."""
        if self._random.random() < 0.15:
            inner = self._varying(room, depth, "to_end", alone=True) or Drawn("{type: bytes, max: 1}", 1)
            return Drawn(f"{{struct: {{last: {inner.text}}}}}", inner.most)
        return self._varying(room, depth, "to_end", alone=True) or Drawn("{type: bytes, max: 1}", 1)

    def _varying(self, room: int, depth: int, count: str, alone: bool) -> Drawn | None:
        """A string, array or group counted by ``count``; ``alone``: nothing else is counted by it."""
        kind = self._random.choice(("string", "string", "array", "group"))
        if room < 1:
            return None
        if kind == "string":
            most = self._random.randint(1, min(room, 12))
            word = self._random.choice(("text", "bytes"))
            size = "" if count == "to_end" else f", size: {count}"
            given = self._given(self._string_default(word, most)) if alone else ""
            return Drawn(f"{{type: {word}{size}, max: {most}{given}}}", most)
        if kind == "array":
            element, size, default = self._element()
            most = min(room // size, self._random.randint(1, 5))
            given = self._given(f"[{', '.join([default] * self._random.randint(0, most))}]") if alone else ""
            return Drawn(f"{{{element}, count: {count}, max: {most}{given}}}", size * most) if most else None
        most = self._random.randint(1, min(room, 3))
        before, self._constants = self._constants, False
        if self._vary == Vary.TOLD:  # a count tells how many elements there are, and not how long each is
            vary, types, self._vary, self._types = self._vary, self._types, Vary.NOTHING, {}
            inner, size = self._list(room // most, depth + 1)
            fields, self._vary, self._types = f"{{{inner}}}", vary, types
        else:
            fields, size = self._own_or_type(room // most, depth)
        self._constants = before and "max:" not in fields and fields[0] == "{"
        return Drawn(f"{{group: {{count: {count}, max: {most}, fields: {fields}}}}}", size * most)


def _at_times_digits(word: str, options: str) -> str:
    """A type and its options; at times decimal digits in place of an unsigned number that has no value or name among
    them. Drawn by themselves, so that other fields stay as they are."""
    found = re.fullmatch(r"u(\d+)(le|be|)", word)
    is_free = not re.search("range|enum|flags|default", options)
    if found and is_free and int(found[1]) % 4 == 0 and int(found[1]) <= 60:
        word = f"bcd{found[1]}{found[2]}" if random.Random(word + options).random() < 0.4 else word
    return word + options


def _at_times_in_pieces(members: list[str]) -> list[str]:
    """The values that share a number's bits; at times one without options continues an earlier one, of whose kind it is
    then. Drawn by itself, so that other fields stay as they are."""
    numbers = [(at, re.fullmatch(r"(\w+): \{type: ([uis]|bcd)(\d+)(.*)\}", text)) for at, text in enumerate(members)]
    found = [(at, *match.groups()) for at, match in numbers if match and not re.search("constant|scale", match[4])]
    for (_, name, letter, bits, _), (at, other, own, more, options) in combinations(found, 2):
        is_like = letter == own or ("bcd" not in (letter, own) and int(more) > 1)
        fits = int(bits) + int(more) <= (60 if letter == "bcd" else 64)
        if is_like and fits and not options and random.Random(" ".join(members)).random() < 0.7:
            changed = f"{other}: {{type: {letter}{more}, continues: {name}}}"
            return [*members[:at], changed, *members[at + 1 :]]
    return members


def decimal(value: Fraction) -> str:
    """Exact, for all that scales and offsets here can give."""
    digits = Context(prec=60)
    return format(digits.divide(Decimal(value.numerator), Decimal(value.denominator)), "f")
