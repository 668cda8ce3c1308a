"""Frames: their parts in wire order, checks, conditions, stuffing."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from wirebond.protocol.model.fields import ByteOrder, End, Field


class PartKind(StrEnum):
    MAGIC = "magic"
    CONSTANT = "constant"
    TAIL = "tail"
    LENGTH = "length"
    ID = "id"
    RESERVED = "reserved"
    PAYLOAD = "payload"
    CHECK = "check"
    FIELD = "field"
    SEQUENCE = "sequence"
    BITS = "bits"


class PayloadRule(StrEnum):
    BY_LENGTH = "by_length"
    FIXED = "fixed"
    BY_ID = "by_id"
    REST = "rest"


class LengthCounts(StrEnum):
    """The bytes that a length counts; the part's ``offset`` is added."""

    PAYLOAD = "payload"
    REST = "rest"  # all that follows the length
    SELF_AND_REST = "self_and_rest"
    FRAME = "frame"


class CheckKind(StrEnum):
    CRC = "crc"
    SUM = "sum"
    XOR = "xor"
    FLETCHER = "fletcher"


class OddTail(StrEnum):
    """The treatment of bytes after the last whole word, for a check over words."""

    PAD = "pad"  # zero bytes complete the word
    XOR = "xor"  # each byte is combined with the register by exclusive-or
    REFUSE = "refuse"  # no value fits


@dataclass(frozen=True)
class Algorithm:
    """A check algorithm by its parameters. CRC parameters as in the reveng catalogue (Rocksoft model).

    The value is worked out in this order: the register over the units, ``odd``, ``negate``, ``plus``, ``mask``,
    ``xorout``, ``bcd``, ``avoided``.
    """

    name: str
    kind: CheckKind
    width: int  # bits
    poly: int = 0
    init: int = 0
    refin: bool = False
    refout: bool = False
    xorout: int = 0
    modulus: int = 0  # of a sum, and of both of Fletcher's; 0: 2 ** width, 2 ** (width / 2)
    negate: bool = False  # two's complement of the value
    unit: int = 1  # bytes of a word: 1, 2, 4
    unit_order: ByteOrder = ByteOrder.BIG
    odd: OddTail = OddTail.PAD
    end_around: bool = False  # sum: a carry out of the highest bit is added to the lowest one
    plus: int = 0
    mask: int | None = None  # bits of the value that are kept; None: all
    bcd: bool = False  # in decimal digits of four bits each; those that have no room are dropped
    avoided: tuple[tuple[int, int], ...] = ()  # ranges of values, both bounds included, that no frame has
    avoided_plus: int = 0  # added, once, to such a value

    @property
    def kept(self) -> int:
        every = (1 << self.width) - 1
        return every if self.mask is None else self.mask & every


class BitRole(StrEnum):
    """The role of a run of bits inside a header byte."""

    ID = "id"
    LENGTH = "length"
    FIELD = "field"
    SEQUENCE = "sequence"
    CONSTANT = "constant"
    CHECK = "check"


class Address(StrEnum):
    """Whose address a header field holds."""

    MCU = "mcu"  # in both directions
    RECEIVER = "receiver"
    SENDER = "sender"


HeaderDefault = float | int | str  # a name, where the field has an enum


@dataclass(frozen=True)
class HeaderField:
    """A number of the frame itself that is neither length nor id, such as an address or a sequence number.

    ``value`` says what it means, as for a field of a message: its name, sign, scale, enum or flags. A sender that gives
    no value sends its end's default.
    """

    value: Field
    host_default: HeaderDefault = 0
    mcu_default: HeaderDefault = 0
    is_sequence: bool = False
    per_message: bool = False  # of a sequence: each message has numbers of its own
    address: Address | None = None
    broadcast: tuple[HeaderDefault, ...] = ()  # addresses that mean every receiver

    @property
    def name(self) -> str:
        return self.value.name

    def default(self, sender: End | None) -> HeaderDefault:
        """Return the default that ``sender`` sends; the host's if the sender is unknown, or both."""
        return self.mcu_default if sender == End.MCU else self.host_default

    def default_bits(self, sender: End | None) -> int:
        return self.value.wire_bits(self.default(sender))

    @property
    def broadcast_bits(self) -> tuple[int, ...]:
        return tuple(self.value.wire_bits(value) for value in self.broadcast)


@dataclass(frozen=True)
class Bits:
    """A run of bits of a ``bits`` part: (number >> shift) % 2**width."""

    name: str
    role: BitRole
    shift: int
    width: int
    value: int = 0  # of a constant; of a check: the bit of its value that the run's lowest one is
    header: HeaderField | None = None  # of a field or a sequence

    @property
    def mask(self) -> int:
        return (1 << self.width) - 1


class Subject(StrEnum):
    """The value that a condition compares."""

    FIELD = "field"  # of the header, as bits on the wire
    ID = "id"
    MAGIC = "magic"  # its bytes as a number, the first one highest
    SENDER = "sender"  # SENDER_NUMBERS
    SIZE = "size"  # payload bytes, before trimming and stuffing


SENDER_NUMBERS = {End.HOST: 0, End.MCU: 1}


@dataclass(frozen=True)
class Comparison:
    """``subject & mask`` is in one of ``ranges``. It does not hold if the subject is not in the frame."""

    subject: Subject
    ranges: tuple[tuple[int, int], ...]  # rising and apart, both bounds included
    name: str = ""  # of the header field
    mask: int | None = None  # None: all bits
    size: int = 0  # bytes of a magic

    def holds(self, value: int) -> bool:
        masked = value if self.mask is None else value & self.mask
        return any(low <= masked <= high for low, high in self.ranges)


@dataclass(frozen=True)
class Condition:
    """The condition for a part: all of ``terms`` are true; ``negated``: not all of them."""

    terms: tuple[Comparison | Condition, ...]
    negated: bool = False

    @property
    def comparisons(self) -> tuple[Comparison, ...]:
        """All header fields, those of conditions included."""
        found: list[Comparison] = []
        for term in self.terms:
            found += [term] if isinstance(term, Comparison) else term.comparisons
        return tuple(found)


@dataclass(frozen=True)
class Part:
    """A part of a frame, in wire order.

    ``size`` in bytes is 0 only for the payload, and for a check that has some bits of the part before it.
    """

    kind: PartKind
    name: str
    size: int
    order: ByteOrder = ByteOrder.LITTLE
    value: bytes = b""  # magic, constant, tail
    counts: LengthCounts = LengthCounts.PAYLOAD
    length_offset: int = 0
    payload: PayloadRule = PayloadRule.BY_LENGTH
    fixed_payload: int = 0
    algorithm: Algorithm | None = None
    ranges: tuple[tuple[int, int], ...] = ((0, 0),)  # check: first and last part of each range, in its order
    shift: int = 0  # check: value on the wire = check >> shift
    seeded: bool = False  # check: the message's seed is counted after the range
    in_bits: Bits | None = None  # check: its run in the part before it
    as_hex: bool = False  # check: sent as hex digits, ``size`` of them
    as_decimal: bool = False  # check: sent as decimal digits, without leading zeros; ``size`` is that of its number
    alternatives: tuple[bytes, ...] = ()  # magic: any of these, ``value`` is the first
    by_sender: tuple[tuple[End, bytes], ...] = ()  # magic: another one for each direction
    length_unit: int = 1  # length: bytes that it counts by
    trims_zeros: bool = False  # payload: zeros at its end are not sent
    header: HeaderField | None = None  # field, sequence
    bits: tuple[Bits, ...] = ()
    condition: Condition | None = None
    is_plain: bool = False  # sent as it is, beside parts that are stuffed
    on_wire: bool = False  # check: over the bytes as they are sent, after stuffing

    @property
    def check_bits(self) -> int:
        """For a check: how many bits of its value are sent."""
        return self.in_bits.width if self.in_bits is not None else (4 if self.as_hex else 8) * self.size

    @property
    def covered(self) -> tuple[int, ...]:
        """For a check: indices of the covered parts, in its order."""
        return tuple(index for first, last in self.ranges for index in range(first, last + 1))

    @property
    def last_covered(self) -> int:
        """For a check: index of the last covered part; -1: none is left."""
        return max((last for first, last in self.ranges if first <= last), default=-1)


def decimal_digits(size: int) -> int:
    """Return the maximum number of decimal digits of a number of ``size`` bytes (1 to 4)."""
    return len(str(256**size - 1))


def cobs_overhead(size: int) -> int:
    """Return the maximum number of bytes that COBS adds to ``size`` bytes; `cobs_overhead` of
    core/include/wirebond/format.hpp."""
    return 1 + size // 254


class Stuffing(StrEnum):
    NONE = "none"
    COBS = "cobs"
    ESCAPE = "escape"  # by an escape byte: see ``Escapes``
    HEX = "hex"  # each byte as two hex digits
    HEX_AFTER_DIGIT = "hex_after_digit"  # the same, but the first byte as one digit: it is below 16
    INSERTION = "insertion"  # a byte after each occurrence of a sequence: see ``Insertion``
    DECIMAL_CHECK = "decimal_check"  # the check at the end in decimal digits, and all other bytes as they are

    @property
    def hides_delimiters(self) -> bool:
        """Can no byte of what is stuffed look like a delimiter?"""
        return self not in (Stuffing.NONE, Stuffing.DECIMAL_CHECK)


@dataclass(frozen=True)
class Escapes:
    """Byte stuffing by an escape byte: each of ``pairs`` is (byte that must not appear, code after the escape).

    With ``exclusive_or`` every code is its byte xor that value, and a receiver takes any escaped byte.
    """

    escape: int
    exclusive_or: int
    pairs: tuple[tuple[int, int], ...]

    @property
    def doubles(self) -> bool:
        """Is the one stuffed byte sent twice? It is the first byte of both delimiters then."""
        return self.pairs == ((self.escape, self.escape),)


@dataclass(frozen=True)
class Insertion:
    """After the bytes ``after``, anywhere among the stuffed ones, ``byte`` is sent."""

    after: bytes
    byte: int


@dataclass(frozen=True)
class FrameFormat:
    """``delimiter`` is None for frames that are found by their magic and size, or ended by silence."""

    parts: tuple[Part, ...]
    max_payload: int
    deliver_unknown: bool
    delimiter: bytes | None = None  # after a frame
    stuffing: Stuffing = Stuffing.NONE
    opening: bytes | None = None  # delimiter before a frame; None: only its end is marked
    escapes: Escapes | None = None
    insertion: Insertion | None = None
    ends_by_silence: bool = False
    is_strict: bool = False  # a candidate that failed after its header is not searched again
    longest_sent: tuple[tuple[End, int], ...] = ()  # of each end, where the file has no `max_payload`

    def max_payload_from(self, sender: End | None) -> int:
        """Return the greatest payload of this end's frames; None: of either end's."""
        return dict(self.longest_sent).get(sender, self.max_payload) if sender is not None else self.max_payload

    def part(self, kind: PartKind) -> Part | None:
        return next((p for p in self.parts if p.kind == kind), None)

    @property
    def is_sized(self) -> bool:
        """Is it stuffed, and ended by its length and no delimiter?"""
        return self.delimiter is None and self.stuffing != Stuffing.NONE

    @property
    def length_on_wire(self) -> bool:
        """Whether the length counts the bytes as they are sent: if it ends a stuffed frame, and is not stuffed."""
        return self.is_sized and any(
            part.is_plain and (part.kind == PartKind.LENGTH or any(run.role == BitRole.LENGTH for run in part.bits))
            for part in self.parts
        )

    @property
    def decimal_bytes(self) -> int:
        """Bytes of the check that is sent in decimal digits; 0 where none is."""
        return self.parts[-1].size if self.stuffing == Stuffing.DECIMAL_CHECK else 0

    def overhead(self, size: int) -> int:
        """Return the maximum number of bytes that stuffing adds to ``size`` bytes."""
        if self.stuffing == Stuffing.DECIMAL_CHECK:
            return decimal_digits(self.decimal_bytes) - self.decimal_bytes
        if self.stuffing == Stuffing.COBS:
            return cobs_overhead(size)
        if self.stuffing == Stuffing.INSERTION and self.insertion is not None:
            return size // len(self.insertion.after)
        return 0 if self.stuffing == Stuffing.NONE else size
