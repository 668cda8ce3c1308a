"""Random protocol files: every part of the frame vocabulary, in every place where it may stand.

Fields of messages are drawn by ``random_fields``.
"""

from __future__ import annotations

import random
import re
from dataclasses import dataclass, field

from tests.random_checks import random_check
from tests.random_fields import FieldSource, Vary
from wirebond.protocol.plan import MAX_CHECKS

# Checks and their bytes.
SHORT_CHECKS = {
    "xor8": 1, "sum8": 1, "sum8-inverted": 1, "sum8-negated": 1, "sum16": 2, "sum16-inverted": 2, "sum16-negated": 2,
    "fletcher-16": 2, "fletcher-16/mod256": 2, "crc-8/smbus": 1, "crc-16/mcrf4xx": 2, "crc-16/ibm-sdlc": 2,
    "crc-16/xmodem": 2,
}  # fmt: skip
CHECKS = SHORT_CHECKS | {
    "sum32": 4, "crc-24/openpgp": 3, "crc-32/iso-hdlc": 4, "crc-32/bzip2": 4, "crc-64/xz": 8,
    "crc, width: 16, poly: 0x8005, init: 0x1234, refin: true, refout: false, xorout: 0x00FF": 2,
    "crc, width: 24, poly: 0x5D6DCB, init: 0xFEDCBA, refin: false, refout: true": 3,
    "crc, width: 8, poly: 0x9B, xorout: 0xFF": 1,
}  # fmt: skip
NUMBERS = ("u8", "u8", "u16", "u16be", "u24", "u24le", "u32", "u32be")
ROOM = 40  # most payload bytes of a message


_PLAIN = re.compile(r"(?<![^ ])(\w+): \{type: u(?:24|32|64)(?:le|be)?(?:, default: \d+)?(?=\})")


def _range_text(first: str, last: str) -> str:
    return first if first == last else f"{first}..{last}"


def _stamped(fields: str) -> str:
    """With the first plain wide number of the message itself as a time stamp, which changes nothing on the wire."""
    for found in _PLAIN.finditer(fields):
        before, name = fields[: found.start()], found[1]
        is_nested = before.count("{") != before.count("}")
        if not is_nested and len(re.findall(rf"\b{name}\b", fields)) == 1:  # else it counts something
            return f"{fields[: found.end()]}, unit: us, clock: mcu{fields[found.end() :]}"
    return fields


@dataclass
class Part:
    """One part: its key and value, and what stands beside them."""

    kind: str
    value: str
    size: int
    options: list[str] = field(default_factory=list)
    name: str = ""
    first: int = 0  # of a check: what it covers
    last: int = 0

    @property
    def text(self) -> str:
        name = [f"name: {self.name}"] if self.name and self.kind != "field" else []
        return "{" + ", ".join([f"{self.kind}: {self.value}", *self.options, *name]) + "}"


def random_protocol(source: random.Random, number: int) -> str:
    """The text of a protocol file; nearly always of one that loads."""
    return _FormatSource(source, random.Random(f"checks {number}")).text(number)


class _FormatSource:
    def __init__(self, source: random.Random, checks: random.Random) -> None:
        self._random = source
        self._checks = checks  # of its own: a number stands for the same format, whatever checks there are
        framings = ["start"] * 5 + [
            "cobs",
            "cobs",
            "slip",
            "hdlc",
            "escaped",
            "doubled",
            "alone",
            "hex",
            "lines",
            "brackets",
            "silence",
            "sized",
            "inserted",
        ]
        self._framing = source.choice(framings)
        self._is_sized = self._framing in ("sized", "inserted")
        self._has_end = self._framing != "start" and not self._is_sized
        self._rule = "rest" if self._has_end and source.random() < 0.7 else self._sized_rule()
        self._id = source.choice(["part"] * 8 + ["bits", "bits", "late", "late", "magic", "none"])
        if self._rule == "by_id" and self._id in ("late", "none"):
            self._id = "part"
        self._id_bits = 0
        self._mixes_ids = False
        self._length = source.choice(("part", "part", "part", "bits", "magic"))
        if self._is_sized:  # every part is always there
            self._id = "part" if self._id == "magic" else self._id
            self._length = "part" if self._length == "magic" else self._length
        self._unit = 1
        self._magics: list[str] = []
        self._parts: list[Part] = []
        self._fields: list[tuple[str, int]] = []  # of the header, with their bits
        self._plain: set[str] = set()  # of these, unsigned ones without a scale: they are compared with numbers
        self._forms = 1  # how many the file has, at most
        self._length_tells = False  # it is the same number in every form
        self._has_sequence = False
        self._trims = False
        self._conditions = 0
        self._seeded = False
        # Whose addresses header fields still to be drawn hold.
        self._addresses = list(source.choice(([], [], [], ["mcu"], ["receiver", "sender"], ["receiver"], ["sender"])))

    def _sized_rule(self) -> str:
        return self._random.choice(("by_length", "by_length", "by_length", "by_id", "fixed"))

    def _chance(self, share: float) -> bool:
        return self._random.random() < share

    def _bytes(self, count: int) -> str:
        return " ".join(f"0x{self._random.randrange(256):02X}" for _ in range(count))

    def text(self, number: int) -> str:
        self._draw_parts()
        lines = ["wirebond: 1", f"protocol: random_{number}", f"byte_order: {self._random.choice(('little', 'big'))}"]
        lines += ["frame:", *(f"  - {item}" for item in self._frame_items())]
        if self._rule == "by_id" or self._seeded:
            lines += self._random.choice(([], ["unknown: reject"]))
        else:
            lines += self._random.choice(([], ["unknown: deliver"], ["unknown: reject"]))
        if self._rule in ("rest", "by_length") and self._chance(0.3):
            lines.append(f"max_payload: {ROOM + 8}")
        if self._looks_again and self._chance(0.2):
            lines.append("resync: strict")
        return "\n".join([*lines, *self._messages()]) + "\n"

    # ---- what stands around the parts

    def _frame_items(self) -> list[str]:
        texts = [part.text for part in self._parts]
        opens = self._chance(0.7)
        self._looks_again = self._framing == "start"
        if self._is_sized:
            return self._sized_items(texts)
        if self._framing == "start":
            return texts
        if self._framing == "silence":
            return [*texts, f"silence: {self._random.choice(('2 ms', '500 us', '20 ms'))}"]
        if self._framing == "lines":  # nothing is stuffed: the test's streams show what is lost then
            end = self._random.choice(("0x0A", "0x0A", "0x0D 0x0A"))
            texts = self._at_times_in_decimal(texts)
            return [*([f"delimiter: {end}"] if self._chance(0.4) else []), *texts, f"delimiter: {end}"]
        if self._framing == "brackets":
            self._looks_again = True
            opening, closing = self._random.choice((("0x24", "0x0A"), ("0xAA 0x55", "0x0A"), ("0x24", "0x0D 0x0A")))
            texts = self._at_times_in_decimal(texts)
            return [f"delimiter: {opening}", *texts, f"delimiter: {closing}"]
        front, back = self._plain_parts() if self._chance(0.35) else (0, 0)
        stop = len(texts) - back
        inner = f"[{', '.join(texts[front:stop])}]"
        if self._framing == "escaped":
            opening, group, closing = self._escaped(inner)
        elif self._framing == "alone":
            self._looks_again = True
            opening, group, closing = self._doubled_alone(inner)
        elif self._framing == "hex":
            opening, closing = (
                [f"delimiter: {self._random.choice(('0x3A', '0x0A'))}"] if opens else [],
                "delimiter: 0x0A",
            )
            if opens and self._chance(0.5):
                closing = "delimiter: 0x0D 0x0A"
            self._looks_again = bool(opening) and opening[0] != closing
            group = f"hex: {inner}"
            digits = random.Random(f"digit {inner}")  # of its own, so that other formats stay as they are
            if front == back == 0 and digits.random() < 0.5:  # no check beside them covers a part of them
                group = f"{{hex: [{{constant: 0x{digits.randrange(16):02X}, name: digit}}, {inner[1:]}, first: digit}}"
        elif self._framing == "doubled":
            self._looks_again = True
            first, one, other = (f"0x{byte:02X}" for byte in self._random.sample(range(256), 3))
            opening, group, closing = [f"delimiter: {first} {one}"], f"doubled: {inner}", f"delimiter: {first} {other}"
        else:
            byte = {"cobs": "0x00", "slip": "0xC0", "hdlc": "0x7E"}[self._framing]
            opening, group = [f"delimiter: {byte}"] if opens else [], f"{self._framing}: {inner}"
            closing = f"delimiter: {byte}"
        return [*opening, *texts[:front], group, *texts[stop:], closing]

    def _at_times_in_decimal(self, texts: list[str]) -> list[str]:
        """At times a check in decimal digits ends the frame. Drawn by itself: other formats stay as they are."""
        drawn = random.Random(f"decimal {texts}")
        kinds = [part.kind for part in self._parts]
        if "tail" in kinds or kinds.count("check") == MAX_CHECKS or drawn.random() < 0.3:
            return texts
        name = drawn.choice(("xor8", "sum8", "sum16", "crc-16/modbus", "crc-24/openpgp", "crc-32/iso-hdlc"))
        return [*texts, "{constant: 0x2A, name: star}", f"{{check: {{type: {name}, text: decimal}}, name: digits}}"]

    def _doubled_alone(self, inner: str) -> tuple[list[str], str, str]:
        """One byte opens a frame, whose first byte must not look like the rest of a delimiter."""
        first = self._parts[0]
        taken = [int(word, 16) for word in re.findall(r"0x[0-9A-F]{2}", first.value)] if first.kind == "magic" else []
        double, end, begin = self._random.sample([byte for byte in range(256) if byte not in taken], 3)
        opening = [f"delimiter: 0x{double:02X}"]
        if not taken:
            opening.append(f"{{constant: 0x{begin:02X}, name: begin}}")
        return opening, f"doubled: {inner}", f"delimiter: 0x{double:02X} 0x{end:02X}"

    def _sized_items(self, texts: list[str]) -> list[str]:
        """Behind the magic the parts are stuffed, from one of them on and up to one of them; a length tells the end."""
        front, back = self._plain_parts() if self._chance(0.6) else (0, 0)
        front, stop = max(front, 1), len(texts) - back
        inner = f"[{', '.join(texts[front:stop])}]"
        if self._framing == "inserted":
            *after, byte = self._random.sample(range(256), self._random.randint(3, 5))
            rule = f"after: {' '.join(f'0x{one:02X}' for one in after)}, byte: 0x{byte:02X}"
            return [*texts[:front], f"inserted: {{{rule}, parts: {inner}}}", *texts[stop:]]
        starts = {int(word, 16) for word in re.findall(r"0x[0-9A-F]{2}", self._parts[0].value)}
        while True:
            escape, xor, *also = self._random.sample(range(1, 256), 2 + self._random.randint(0, 2))
            if escape not in starts and not {byte ^ xor for byte in (*starts, escape, *also)} & starts:
                break
        more = f"also: {' '.join(f'0x{byte:02X}' for byte in also)}, " if also else ""
        rule = f"escape: 0x{escape:02X}, xor: 0x{xor:02X}, {more}parts: {inner}"
        return [*texts[:front], f"escaped: {{{rule}}}", *texts[stop:]]

    def _plain_parts(self) -> tuple[int, int]:
        """Return how many parts before and after the stuffed ones are sent unchanged: such parts are always there, and
        their checks cover all that is stuffed or nothing of it."""
        payload = self._payload_index()
        always = [not any(option.startswith("when:") for option in part.options) for part in self._parts]
        front = self._random.randint(0, next((i for i in range(payload) if not always[i]), payload))
        most = next((i for i in range(len(always) - payload - 1) if not always[-1 - i]), len(always) - payload - 1)
        back = self._random.randint(0, most)
        stop = len(self._parts) - back
        for index, part in enumerate(self._parts):
            if part.kind == "check" and not front <= index < stop:
                first, last = self._covered(index)
                touches = first < stop and last >= front
                if touches and not (first <= front and last >= stop - 1):
                    return 0, 0
        return front, back

    def _covered(self, index: int) -> tuple[int, int]:
        """First and last part that a check covers."""
        found = re.search(r"over: (\w+)(?:\.\.(\w+))?", self._parts[index].value)
        if found is None:
            return 0, index - 1
        names = [part.name for part in self._parts]
        return names.index(found[1]), names.index(found[2] or found[1])

    def _escaped(self, inner: str) -> tuple[list[str], str, str]:
        """An escape rule after which no delimiter is left on the line: opening, group, closing."""
        while True:
            closing, escape, xor, *also = self._random.sample(range(1, 256), 3 + self._random.randint(0, 3))
            opening = self._random.choice((None, closing, self._random.randrange(256)))
            marks = {closing, opening} - {None}
            if escape not in marks and not {byte ^ xor for byte in (*marks, escape, *also) if byte is not None} & marks:
                break
        more = f"also: {' '.join(f'0x{byte:02X}' for byte in also)}, " if also else ""
        rule = f"escaped: {{escape: 0x{escape:02X}, xor: 0x{xor:02X}, {more}parts: {inner}}}"
        marks = [] if opening is None else [f"delimiter: 0x{opening:02X}"]
        if opening not in (None, closing):
            self._looks_again = True
        return marks, rule, f"delimiter: 0x{closing:02X}"

    # ---- parts

    def _draw_parts(self) -> None:
        magic = self._magic()
        header = self._header()
        self._random.shuffle(header)
        self._parts = [*magic, *header]
        self._add_conditional_parts(len(magic))
        payload = self._payload()
        behind = self._behind()
        self._parts += [payload, *behind]
        for index, part in enumerate(self._parts):
            if part.kind != "field":
                part.name = part.name or f"p{index}"
        self._draw_checks()
        self._put_a_check_into_bits()
        if self._chance(0.3):
            size = self._random.randint(1, 2)
            self._parts.append(Part("tail", self._bytes(size), size))

    def _magic(self) -> list[Part]:
        wants_several = "magic" in (self._id, self._length if self._rule == "by_length" else "")
        if not wants_several and not self._is_sized and not self._chance(0.25 if self._has_end else 0.85):
            return []
        size = 1 if self._framing == "sized" else self._random.randint(1, 3)
        kinds = ("one", "one", "one", "any", "any", "ends", "ends", "sender", "several", "size")
        if self._is_sized:
            kinds = ("one", "any", "ends")
        kind = "any" if wants_several else self._random.choice(kinds)
        if kind == "one" or (kind == "size" and self._rule == "fixed"):
            return [Part("magic", self._bytes(size), size)]
        magics: list[str] = []
        while len(set(magics)) < 3:
            magics = [self._bytes(size) for _ in range(3)]
        self._forms = 2
        if kind == "ends":
            return [Part("magic", f"{{host: {magics[0]}, mcu: {magics[1]}}}", size)]
        if kind == "several":
            self._forms = 3
            return [Part("magic", f"{{host: {magics[0]}, mcu: {{any: [{magics[1]}, {magics[2]}]}}}}", size)]
        if kind in ("sender", "size"):
            limit = self._random.choice((0, 3, 16))
            sizes, ends = (f"size <= {limit}", f"size > {limit}"), ("sender == host", "sender == mcu")
            both = zip(magics, ends if kind == "sender" else sizes, strict=False)
            return [Part("magic", one, size, [f"when: {when}"]) for one, when in both]
        magics = magics[:2]
        self._magics = magics
        return [Part("magic", f"{{any: [{', '.join(magics)}]}}", size)]

    def _header(self) -> list[Part]:
        """The parts before the payload, in any order."""
        parts: list[Part] = []
        kinds = self._random.sample(("field", "field", "reserved", "sequence", "constant"), self._random.randint(0, 3))
        for kind in kinds + ["field"] * (len(self._addresses) - kinds.count("field")):
            parts.append(self._plain_part(kind))
        runs: list[tuple[str, int, str]] = []
        if self._id == "bits":
            self._id_bits = self._random.randint(4, 9)
            runs.append(("id", self._id_bits, str(self._id_bits)))
        elif self._id in ("part", "magic"):
            parts += self._by_magic("id") if self._id == "magic" else [self._id_part()]
        if self._rule == "by_length":
            if self._length == "bits":
                runs.append(("length", 8, "8"))
            elif self._length == "magic":
                parts += self._by_magic("length")
            else:
                parts.append(self._length_part())
        if runs or self._chance(0.3):
            parts.append(self._bits_part(runs))
        return parts

    def _number_type(self) -> tuple[str, int]:
        word = self._random.choice(NUMBERS)
        return word, int("".join(c for c in word if c.isdigit())) // 8

    def _id_part(self) -> Part:
        word, size = self._number_type()
        self._id_bits = min(self._id_bits or 32, 8 * size)
        return Part("id", word, size)

    def _by_magic(self, kind: str) -> list[Part]:
        """A part for each magic, of its own width."""
        draw = self._id_part if kind == "id" else self._length_part
        parts = []
        magics = self._magics
        if kind == "id" and self._rule != "by_id" and self._chance(0.4):
            self._mixes_ids = True
            magics = [self._random.choice(magics)]
        for number, magic in enumerate(magics):
            part = draw()
            part.options.append(f"when: magic == {magic}")
            part.name = f"{kind}{number}"
            parts.append(part)
        return parts

    def _plain_part(self, kind: str) -> Part:
        if kind == "reserved":
            size = self._random.randint(1, 3)
            return Part(kind, str(size), size)
        if kind == "constant":
            size = self._random.randint(1, 2)
            return Part(kind, self._bytes(size), size)
        word, size = self._number_type()
        if kind == "sequence":
            if self._has_sequence:
                return Part("reserved", str(size), size)
            self._has_sequence = True
            return Part(kind, word, size, [f"per: {self._per()}"], name="sequence")
        name = f"h{len(self._fields)}"
        letter, size = self._random.choice("uuuis"), self._random.choice((1, 1, 1, 2, 2, 3, 4, 4, 5, 6, 7, 8))
        if self._addresses and self._chance(0.8):
            letter, size = self._random.choice("uuui"), self._random.choice((1, 1, 1, 2, 3, 8))
        if self._addresses and letter == "s":
            letter = "i"  # addresses are compared as bits, and there zero has two spellings
        self._fields.append((name, 8 * size))
        word = f"{letter}{8 * size}{self._random.choice(('', 'le', 'be')) if size > 1 else ''}"
        meaning = self._meaning(letter, 8 * size)
        self._note_plain(name, letter, meaning)
        return Part("field", name, size, [f"type: {word}", *meaning], name=name)

    def _note_plain(self, name: str, letter: str, meaning: list[str]) -> None:
        if letter == "u" and not any(option.startswith(("scale", "range")) for option in meaning):
            self._plain.add(name)

    def _meaning(self, letter: str, bits: int) -> list[str]:
        """Return the properties of a header field, besides its type."""
        half = 2 ** (bits - 1)
        least, most = (0, 2 * half - 1) if letter == "u" else (-half + (letter == "s"), half - 1)
        drawn = [self._random.choice((least, most, 0, 1, self._random.randint(least, most))) for _ in range(3)]
        if self._addresses:
            return self._address(drawn)
        kind = self._random.choice(("number", "number", "ends", "enum", "flags", "scale", "range"))
        if kind == "ends":
            return [f"default: {{host: {drawn[0]}, mcu: {drawn[1]}}}"]
        if kind == "enum":
            return self._enum(drawn)[0]
        if kind == "flags" and letter == "u":
            bit = self._random.sample(range(bits), min(bits, 3))
            listed = ", ".join(f"f{i}: {number}" for i, number in enumerate(bit))
            return [f"flags: {{{listed}}}", *self._random.choice(([], ["default: [f0]"]))]
        if kind == "scale" and bits <= 32:
            return [f"scale: {self._random.choice(('0.1', '0.5', '0.001', '3'))}", "unit: V"]
        if kind == "range" and drawn[0] != drawn[1] and bits <= 48:
            low, high = sorted(drawn[:2])
            return [f"range: [{low}, {high}]", f"default: {low}"]
        return [f"default: {drawn[0]}"]

    def _enum(self, numbers: list[int]) -> tuple[list[str], list[str]]:
        """The options of a header field that takes these numbers, and its names."""
        names = {value: f"e{i}" for i, value in enumerate(numbers)}
        listed = ", ".join(f"{name}: {value}" for value, name in names.items())
        return [f"enum: {{{listed}}}", f"default: {self._random.choice(list(names.values()))}"], list(names.values())

    def _address(self, numbers: list[int]) -> list[str]:
        """The options of the next header field that holds an address, one of these numbers by default."""
        whose = self._addresses.pop(0)
        kind = self._random.choice(("number", "ends", "enum", "range"))
        values = [str(number) for number in numbers]
        if kind == "enum":
            options, values = self._enum(numbers)
        elif kind == "ends":
            options = [f"default: {{host: {values[0]}, mcu: {values[1]}}}"]
        elif kind == "range" and min(numbers) < max(numbers) and max(map(abs, numbers)) < 2**48:
            options = [f"range: [{min(numbers)}, {max(numbers)}]", f"default: {values[0]}"]
        else:
            options = [f"default: {values[0]}"]
        options.append(f"address: {whose}")
        if whose != "sender" and self._chance(0.6):
            given = re.findall(r"-?\w+", next(one for one in options if one.startswith("default: ")))
            others = [
                value for value in dict.fromkeys(values) if value not in given
            ]  # a broadcast is not an own address
            some = self._random.sample(others, self._random.randint(1, len(others))) if others else []
            if some:
                options.append(f"broadcast: {some[0]}" if len(some) == 1 else f"broadcast: [{', '.join(some)}]")
        return options

    def _per(self) -> str:
        return self._random.choice(("sender", "message"))

    def _length_part(self) -> Part:
        word, size = self._number_type()
        counts = self._random.choice(("payload", "payload", "rest", "self_and_rest", "frame"))
        offset = self._random.choice((0, 0, 0, 1, 4))
        if counts in ("self_and_rest", "frame") and self._chance(0.2):
            offset = -1
        options = f"type: {word}, counts: {counts}, offset: {offset}"
        if self._length == "part" and counts == "payload" and self._chance(0.25):
            self._unit = self._random.choice((2, 4))
            options = f"type: {word}, unit: {self._unit}"
        self._length_tells = self._length == "part" and counts == "payload"
        return Part("length", f"{{{options}}}", size)

    def _bits_part(self, runs: list[tuple[str, int, str]]) -> Part:
        """``runs``: those that it must have, each with its bits and its text."""
        needed = sum(bits for _, bits, _ in runs)
        size = self._random.choice([size for size in (1, 1, 2, 3, 4, 8) if 8 * size >= needed])
        left = 8 * size - needed
        while left > 0 and len(runs) < 7:
            bits = self._random.randint(1, min(left, 9))
            name = f"r{len(runs)}"
            kind = self._random.choice(("constant", "field", "field", "default", "sequence"))
            if kind == "constant":
                runs.append((name, bits, f"{{bits: {bits}, constant: {self._random.randrange(2**bits)}}}"))
            elif len(self._fields) >= 6:
                break
            elif kind == "default":
                self._fields.append((name, bits))
                letter = self._random.choice("uuis") if bits > 1 else "u"
                meaning = self._meaning(letter, bits)
                self._note_plain(name, letter, meaning)
                runs.append((name, bits, f"{{type: {letter}{bits}, {', '.join(meaning)}}}"))
            elif kind == "sequence" and not self._has_sequence:
                self._has_sequence = True
                runs.append(("sequence", bits, f"{{bits: {bits}, per: {self._per()}}}"))
            else:
                self._fields.append((name, bits))
                self._plain.add(name)
                runs.append((name, bits, str(bits)))
            left -= bits
        if left > 0:
            runs.append(("filler", left, f"{{bits: {left}, constant: 0}}"))
        self._random.shuffle(runs)
        word = self._random.choice(("", "le", "be")) if size > 1 else ""
        options = [f"fields: {{{', '.join(f'{name}: {text}' for name, _, text in runs)}}}"]
        options += self._random.choice(([], ["first: high"]))
        if any(name == "length" for name, _, _ in runs) and self._chance(0.3):
            options += [f"counts: {self._random.choice(('rest', 'self_and_rest', 'frame'))}", "offset: 1"]
        return Part("bits", f"u{8 * size}{word}", size, options)

    def _add_conditional_parts(self, begin: int) -> None:
        """Parts that are there when a bit of an earlier field says so, or a magic."""
        for _ in range(self._random.choice((0, 0, 0, 1, 2))):
            names, condition = self._condition(behind_payload=False)
            if condition:
                known = min((self._behind_field(name) for name in names), key=len, default=self._parts)
                at = self._random.randint(max(begin, len(self._parts) - len(known)), len(self._parts))
                part = self._plain_part(
                    self._random.choice(("reserved", "constant", "field") if len(self._fields) < 7 else ("reserved",))
                )
                part.options.append(f'when: "{condition}"')
                if part.kind == "field":
                    self._plain.discard(self._fields[-1][0])
                    self._fields.pop()  # nothing depends on a part that may not be there
                    self._conditions += 1
                    part.value = part.name = f"c{self._conditions}"
                self._parts.insert(at, part)

    def _behind_field(self, name: str) -> list[Part]:
        """The parts behind the one that holds this field of the header."""
        for index, part in enumerate(self._parts):
            if name in (part.name, part.kind) or any(
                option.startswith("fields:") and f"{name}: " in option for option in part.options
            ):
                return self._parts[index + 1 :]
        return []

    def _condition(self, *, behind_payload: bool) -> tuple[list[str], str]:
        """A condition, and the parts of the header that it looks at; nothing where there would be too many forms, or
        where every part is always there."""
        if self._is_sized:
            return [], ""
        compared = [self._comparison(behind_payload) for _ in range(self._random.choice((1, 1, 1, 2)))]
        times = 2 if len(compared) == 1 else 3
        if not all(text for _, text in compared) or self._forms * times > 8:
            return [], ""
        self._forms *= times
        names = [name for name, _ in compared if name]
        text = " and ".join(text for _, text in compared)
        return names, f"not ({text})" if self._chance(0.15) else text

    def _comparison(self, behind_payload: bool) -> tuple[str, str]:
        """The part that it looks at, where that must stand before, and the comparison; empty where there is none."""
        kinds = ["field"] * 5 + ["magic"] * 3 * bool(self._magics)
        if self._id in ("part", "bits") and self._rule != "fixed":
            kinds.append("id")
        if behind_payload and self._forms <= 2:
            kinds.append("sender")
            kinds += ["size", "size"] if self._length_tells and not self._trims else []
        kind = self._random.choice(kinds)
        if kind == "magic":
            one = self._random.choice(self._magics)
            return "", f"magic {self._random.choice((f'== {one}', f'!= {one}', f'in [{one}]'))}"
        if kind == "sender":
            return "", f"sender {self._random.choice(('==', '!='))} {self._random.choice(('host', 'mcu'))}"
        if kind == "size":
            limit = self._random.choice((0, 1, 4, 8, 20))
            return "", f"size {self._random.choice((f'> {limit}', f'<= {limit}', f'== {limit}', f'in 1..{limit + 1}'))}"
        if kind == "id":
            return "id", self._number_comparison("id", min(self._id_bits, 8))
        fields = [field for field in self._fields if field[0] != "sequence"]  # the link gives it too late for that
        if not fields:
            return "", ""
        name, bits = self._random.choice(fields)
        if name not in self._plain or self._chance(0.4):
            return name, f"{name} & 0x{1 << self._random.randrange(bits):02X}"
        return name, self._number_comparison(name, bits)

    def _number_comparison(self, name: str, bits: int) -> str:
        most = 2**bits - 1
        one, other = sorted(self._random.choice((0, 1, most, self._random.randint(0, most))) for _ in range(2))
        mask = self._random.randint(1, most)
        listed = f"[{one}, {other}]" if self._chance(0.5) else f"{one}..{other}"
        return self._random.choice(
            (
                f"{name} == {one}",
                f"{name} != {other}",
                f"{name} in {listed}",
                f"{name} not in {listed}",
                f"{name} & 0x{mask:X}",
                f"{name} & 0x{mask:X} == {one & mask}",
                f"{name} >= {other}",
            )
        )

    def _payload(self) -> Part:
        if self._rule == "fixed":
            return Part("payload", str(self._random.choice((0, 8, 16, ROOM))), 0)
        self._trims = self._rule in ("rest", "by_length") and self._unit == 1 and self._chance(0.12)
        return Part("payload", self._rule, 0, ["trim_zeros: true"] if self._trims else [])

    def _behind(self) -> list[Part]:
        """Parts between payload and tail, but for the checks."""
        parts = [self._id_part()] if self._id == "late" else []
        kinds = ["reserved", "constant", "bits"] + (["field"] if len(self._fields) < 6 else [])
        before = list(self._fields)
        for kind in self._random.sample(kinds, self._random.choice((0, 0, 0, 1, 2))):
            if kind == "bits":
                constant = f"{{bits: 3, constant: {self._random.randrange(8)}}}"
                parts.append(Part("bits", "u8", 1, [f"fields: {{after: 5, mark: {constant}}}"]))
            else:
                parts.append(self._plain_part(kind))
        self._fields = before  # conditions are on what stands before them
        condition = self._condition(behind_payload=True)[1] if self._chance(0.3) else ""
        if condition:
            parts.append(Part("reserved", "2", 2, [f'when: "{condition}"']))
        self._random.shuffle(parts)
        return parts

    # ---- checks

    def _draw_checks(self) -> None:
        """In the header, before the payload over what follows, and behind the payload."""
        has_constant = any(part.kind in ("magic", "constant") and not part.options for part in self._parts)
        if self._chance(0.3):
            self._insert_check(self._payload_index(), header=True)
        for _ in range(self._random.choice((1, 1, 1, 2) if not has_constant else (0, 1, 1, 1, 1, 2))):
            self._insert_check(self._random.randint(self._payload_index() + 1, len(self._parts)), header=False)
        if self._chance(0.08):
            self._insert_check(self._payload_index(), header=False)

    def _payload_index(self) -> int:
        return next(i for i, part in enumerate(self._parts) if part.kind == "payload")

    def _insert_check(self, at: int, header: bool) -> None:
        """A check at this place. ``header``: over parts before it alone, where there are some."""
        earlier = self._parts[:at]
        first, last = 0, at - 1
        explicit = self._chance(0.5)
        if at < len(self._parts) and self._parts[at].kind == "payload" and not header:
            first, last = at, self._random.randint(at, len(self._parts) - 1)  # what follows it, but no check
            while any(part.kind == "check" for part in self._parts[first : last + 1]):
                last -= 1
            explicit = True
        elif not earlier:
            return
        elif explicit:
            first = self._random.randrange(at)
            last = self._random.randrange(first, at)
        name = f"k{sum(part.kind == 'check' for part in self._parts)}"
        kind, width = self._random.choice(list((SHORT_CHECKS if header else CHECKS).items()))
        if self._checks.random() < 0.3:
            kind, width = random_check(self._checks)
        options = [f"type: {kind}"]
        if explicit:
            ranges = [(first, last)]
            if self._checks.random() < 0.3:
                ranges += self._more_ranges(at, ranges[0], header)
            texts = [_range_text(*(self._parts[i].name for i in ends)) for ends in ranges]
            options.append(f"over: [{', '.join(texts)}]" if len(texts) > 1 else f"over: {texts[0]}")
        if width > 1 and self._chance(0.15):
            options.append(f"byte: {self._random.choice(('low', 'high'))}")
            width = 1
        if self._chance(0.3):
            options.append(f"byte_order: {self._random.choice(('little', 'big'))}")
        if self._chance(0.1):
            options.append("text: hex")
            width *= 2
        if not (header and self._id in ("late", "none")) and self._chance(0.08):
            options.append("seed: message")
            self._seeded = True
        part = Part("check", f"{{{', '.join(options)}}}", width, name=name)
        if self._chance(0.05) and not header:
            condition = self._condition(behind_payload=at > self._payload_index())[1]
            part.options += [f'when: "{condition}"'] if condition else []
        self._parts.insert(at, part)

    def _more_ranges(self, at: int, own: tuple[int, int], header: bool) -> list[tuple[int, int]]:
        """Others for a check at this place, in any order: of parts before it, and behind it single ones, between which
        no check can come later."""
        free = [i for i in range(at) if not own[0] <= i <= own[1]]
        if not header:
            free += [
                i
                for i in range(at, len(self._parts))
                if i not in range(own[0], own[1] + 1) and self._parts[i].kind != "check"
            ]
        return [(i, i) for i in self._checks.sample(free, min(len(free), self._checks.randint(1, 3)))]

    def _put_a_check_into_bits(self) -> None:
        """At times bits behind the payload are a check, of which no check before them covers anything."""
        kinds = [part.kind for part in self._parts]
        first_check = kinds.index("check") if "check" in kinds else len(kinds)
        least = self._payload_index() + 1
        is_free = self._framing in ("start", "silence", "brackets") and first_check >= least
        if not is_free or kinds.count("check") >= MAX_CHECKS - 1 or self._checks.random() < 0.6:
            return
        held = [i for i in range(least, first_check) if "fields: {after: 5" in " ".join(self._parts[i].options)]
        if not held:
            others = self._checks.choice(("mark: {bits: 3, constant: 5}", "loose: 3"))
            held = [self._checks.randint(least, first_check)]
            self._parts.insert(held[0], Part("bits", "u8", 1, [f"fields: {{after: 5, {others}}}"], name="held"))
        kind, width = self._checks.choice((("crc-5/usb", 5), ("crc-8/smbus", 8), ("xor8", 8), ("sum16", 16)))
        first = self._checks.randint(0, held[0])
        over = _range_text(*(self._parts[i].name for i in (first, self._checks.randint(first, held[0]))))
        seeded = ", seed: message" * (self._seeded and self._checks.random() < 0.5)
        from_bit = self._checks.randint(0, width - 5)
        check = f"{{bits: 5, check: {{type: {kind}, over: {over}{seeded}}}, from_bit: {from_bit}}}"
        part = self._parts[held[0]]
        part.options[0] = part.options[0].replace("after: 5", f"after: {check}", 1)

    # ---- messages

    def _messages(self) -> list[str]:
        vary = Vary.NOTHING if self._unit != 1 else Vary.TOLD if self._rule == "by_id" else Vary.COUNTED
        if self._rule in ("rest", "by_length") and self._unit == 1:
            vary = Vary.TO_END
        payload = self._parts[self._payload_index()]
        trims = bool(payload.options)
        fields = FieldSource(self._random, Vary.NOTHING if trims else vary)
        room = int(payload.value) if self._rule == "fixed" else ROOM
        lines = [*fields.types(), "messages:"]
        for number, (message_id, sender) in enumerate(self._ids()):
            head = [f"sender: {sender}", *([] if message_id is None else [f"id: {message_id}"])]
            if self._seeded:
                head.append(f"seed: {self._random.randrange(256)}")
            text, most = fields.message(room, only_text_to_end=trims)
            if most % self._unit:
                text += f", end: {{type: padding, size: {-most % self._unit}}}"
            if sender == "mcu":
                text = _stamped(text)
            lines.append(f"  m{number}: {{{', '.join(head)}{f', fields: {{{text}}}' if text else ''}}}")
        return lines + self._told_apart(trims)

    def _told_apart(self, trims: bool) -> list[str]:
        """Messages that more than an id tells, of ids that no other message has."""
        if self._seeded or self._mixes_ids or self._id == "none" or self._id_bits < 8 or not self._chance(0.5):
            return []
        sender = self._random.choice(("host", "mcu", "both"))
        padding = f", end: {{type: padding, size: {self._unit - 1}}}" if self._unit > 1 else ""
        byte = f"{{type: u8}}{padding}"
        lines = []
        room = int(self._parts[self._payload_index()].value) if self._rule == "fixed" else ROOM
        if room and self._chance(0.5):
            masked = "{mask: 0xFB, value: 0x43}" if self._id_bits == 8 else "0x43..0x46"
            ids = self._random.choice(("0x40..0x47", "[0x40, 0x43..0x45]", masked))
            lines.append(f"several: {{id: {ids}, sender: {sender}, fields: {{x: {byte}}}}}")
        if self._rule != "by_id" and room >= 1 + self._unit and self._chance(0.6):
            lines.append(f"one: {{id: 0x48, sender: {sender}, match: {{x: 1}}, fields: {{x: {byte}}}}}")
            values = self._random.choice(("[2, 7..9]", "{mask: 0x81, value: 0x80}", "0x80..0xFF"))
            lines.append(f"more: {{id: 0x48, sender: {sender}, match: {{x: {values}}}, fields: {{x: {byte}}}}}")
        if self._rule in ("rest", "by_length") and self._unit == 1 and not trims and self._chance(0.4):
            lines.append(f"short: {{id: 0x49, sender: {sender}, match: {{size: 1}}, fields: {{x: {{type: u8}}}}}}")
            lines.append(f"wide: {{id: 0x49, sender: {sender}, match: {{size: 2}}, fields: {{x: {{type: u16}}}}}}")
        plain = [name for name, bits in self._fields if name in self._plain and bits > 1]
        has_address = any("address:" in str(part) for part in self._parts)  # which tells no message
        if plain and not has_address and self._forms == 1 and room and self._chance(0.6):
            name = self._random.choice(plain)
            for number, values in enumerate(("1", "{mask: 0x01, value: 0x00}")):
                lines.append(
                    f"by{number}: {{id: 0x4A, sender: {sender}, match: {{{name}: {values}}}, fields: {{x: {byte}}}}}"
                )
        return [f"  {line}" for line in lines]

    def _ids(self) -> list[tuple[int | None, str]]:
        """Ids and senders; the same id may mean a message in each direction. None: without an id."""
        without: list[list[tuple[int | None, str]]] = [
            [(None, "both")],
            [(None, "host"), (None, "mcu")],
            [(None, "mcu")],
        ]
        if self._id == "none":
            return self._random.choice(without)
        most = 2**self._id_bits - 1
        small = self._random.sample(range(min(most, 63) + 1), 4)
        ids = [self._random.choice((one, self._random.randint(0x50, most) if most > 0x50 else one)) for one in small]
        found: list[tuple[int | None, str]] = []
        found += [(one, self._random.choice(("host", "mcu", "both"))) for one in dict.fromkeys(ids)]
        found = found[: self._random.randint(1, 4)]
        if found[0][1] == "host" and self._chance(0.3):
            found.append((found[0][0], "mcu"))
        if self._mixes_ids and self._chance(0.8):
            found += self._random.choice(without)
        return found
