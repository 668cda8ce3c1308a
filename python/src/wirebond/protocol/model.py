"""What a protocol file means, after loading: plain immutable values, all units SI, all defaults filled in.

Nothing here reads a file, and nothing here knows how a frame is found or laid out in memory (see ``plan``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from fractions import Fraction
from math import copysign, floor, lcm
from typing import Union


class End(StrEnum):
    """One of the two computers; the sender of a message is one, or both."""

    HOST = "host"
    MCU = "mcu"
    BOTH = "both"


class ByteOrder(StrEnum):
    LITTLE = "little"
    BIG = "big"


class BitOrder(StrEnum):
    """Which bit of a byte, or of a number, comes first."""

    LOW = "low"
    HIGH = "high"


class FieldKind(StrEnum):
    UNSIGNED = "unsigned"
    SIGNED = "signed"
    FLOAT = "float"
    BOOL = "bool"
    TEXT = "text"  # UTF-8
    BYTES = "bytes"
    PADDING = "padding"  # no value; sent as zeros and ignored on receive, or ``constant``
    BITS = "bits"  # a number whose bits are shared by ``fields``
    STRUCT = "struct"  # ``fields``, once or several times


class OnRange(StrEnum):
    """What the handler's side does with a received value outside its range."""

    REJECT = "reject"
    CLAMP = "clamp"


class Queue(StrEnum):
    """How a message waits for the line at its sender."""

    NORMAL = "normal"
    URGENT = "urgent"  # before all that is not
    LATEST = "latest"  # only the newest one


class LogLevel(StrEnum):
    """How severe a log line is, in the order of the log service's numbers."""

    DEBUG = "debug"
    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


class Recover(StrEnum):
    NEXT_MESSAGE = "next_message"
    EXPLICIT = "explicit"


Default = float | int | bool | str | bytes | tuple[float | int | bool | str, ...]


@dataclass(frozen=True)
class Field:
    """One value of a message, or several.

    ``value = wire * scale + offset`` for numbers.

    How often it occurs: ``count`` elements always; or up to ``max_count`` elements, as many as ``counters`` (fields
    before it, beside it) say, or as the payload has where there are none; or once, where both are unset. A text or byte
    string has ``size`` bytes always, or up to ``max_size`` in the same two ways, or up to the byte ``ends_with``, which
    follows it on the wire and is not in it.
    """

    name: str
    kind: FieldKind
    size: int  # wire bytes of one element; 0 for bit fields, packed elements, structs and strings of varying size
    order: ByteOrder = ByteOrder.LITTLE
    count: int | None = None  # elements of a fixed array
    max_size: int = 0
    scale: Fraction = Fraction(1)
    offset: Fraction = Fraction(0)
    unit: str = ""
    minimum: float | None = None  # SI
    maximum: float | None = None  # SI
    on_range: OnRange = OnRange.REJECT
    default: Default | None = None  # a tuple for an array
    enum: tuple[tuple[str, int], ...] = ()
    flags: tuple[tuple[str, int], ...] = ()  # name, bit number
    description: str = ""
    bits: int = 0  # of one element, where that does not begin and end with a byte: a bit field, a packed element
    sign_magnitude: bool = False  # the top bit is the sign, the others the amount
    packed: BitOrder | None = None  # elements follow each other bit by bit, from this bit of each byte on
    first: BitOrder = BitOrder.LOW  # of kind BITS: where its first field lies
    fields: tuple[Field, ...] = ()  # of kinds BITS and STRUCT
    max_count: int = 0  # most elements of a list
    counted_by: str = ""  # the field that tells how many; `state.number` for one among the bits of `state`
    counted_in_bytes: bool = False  # it tells the bytes of all elements, and not their number
    bytes_counted_by: str = ""  # the field that tells their bytes beside one that tells their number
    asked_by: str = ""  # of a list in a reply: the field of the request that says how many elements it wants
    is_count: bool = False  # it counts others: its value follows from theirs, and is not given
    ends_with: int | None = None  # of a string: the byte behind it
    type_name: str = ""  # of kind STRUCT: the type of the file that it is; empty for one of its own
    clock: End | None = None  # it is a time of this end's clock: when the values of its message were measured
    constant: int | None = None  # of kind PADDING: the number that its ``width`` bits must be; None: any

    @property
    def constant_bytes(self) -> bytes:
        """What a constant that begins and ends with a byte is on the wire."""
        return (self.constant or 0).to_bytes(self.size, "big" if self.order == ByteOrder.BIG else "little")

    @property
    def is_scaled(self) -> bool:
        return self.scale != 1 or self.offset != 0

    @property
    def common_factors(self) -> tuple[int, int, int]:
        """``value = (wire * numerator + addend) / denominator`` in whole numbers."""
        denominator = lcm(self.scale.denominator, self.offset.denominator)
        return int(self.scale * denominator), int(self.offset * denominator), denominator

    @property
    def is_exact_in_double(self) -> bool:
        """Are all whole numbers exact in a double, between a wire number and its value?"""
        numerator, addend, denominator = self.common_factors
        largest = (1 << self.width) * abs(numerator) + abs(addend)
        return self.kind != FieldKind.FLOAT and max(largest, denominator) <= 2**53

    @property
    def double_factors(self) -> tuple[Fraction | int, int, int, Fraction | int]:
        """``value = (wire * numerator + addend) / denominator + offset`` as doubles compute it, with one rounding where
        the whole numbers are exact in a double: then the offset is in the addend."""
        if self.is_exact_in_double:
            return *self.common_factors, 0
        numerator, denominator = self.scale.as_integer_ratio()
        if max(abs(numerator), denominator) > 2**53:
            return self.scale, 0, 1, self.offset
        return numerator, 0, denominator, self.offset

    def lost_digits(self, mantissa: int) -> Fraction:
        """The most that a scaled integer's value loses, there and back, in floats of this many bits where the whole
        numbers are not exact.

        Each operation and each constant is off by half a unit in the last place at most (IEEE 754, round to nearest):
        there are five of the value's size on the way, and three of the offset's.
        """
        span = (1 << self.width) * abs(self.scale)
        return (5 * span + 3 * abs(self.offset)) / (1 << mantissa)

    @property
    def double_slack(self) -> Fraction | int:
        """How far a double may lie beyond a bound, and be taken for the bound itself."""
        return 0 if self.kind == FieldKind.FLOAT or self.is_exact_in_double else self.lost_digits(53)

    @property
    def width(self) -> int:
        """Bits of one element."""
        return self.bits or 8 * self.size

    def wire_bits(self, value: float | int | str) -> int:
        """The bits on the wire of one integer's value, at the bottom. The value fits: see ``field_values``.

        A scaled value becomes a whole number as in the engine: with the same doubles, halves away from zero.
        """
        if isinstance(value, str):
            number = dict(self.enum)[value]
        elif self.is_scaled:
            numerator, addend, denominator, offset = (float(factor) for factor in self.double_factors)
            wire = ((value - offset) * denominator - addend) / numerator
            number = int(copysign(floor(abs(wire) + 0.5), wire))
        else:
            number = int(value)
        if self.sign_magnitude and number < 0:
            return 1 << (self.width - 1) | -number
        return number & ((1 << self.width) - 1)

    @property
    def is_string(self) -> bool:
        return self.kind in (FieldKind.TEXT, FieldKind.BYTES)

    @property
    def room(self) -> int:
        """Most bytes of a string's value."""
        return self.size or self.max_size

    @property
    def is_list(self) -> bool:
        """Has it a varying number of elements?"""
        return self.max_count > 0

    @property
    def is_variable(self) -> bool:
        """Does its size on the wire vary?"""
        return self.is_list or (self.is_string and self.size == 0) or any(f.is_variable for f in self.fields)

    @property
    def reaches_end(self) -> bool:
        """Is it as long as the payload is?"""
        open_ended = self.is_list or (self.is_string and self.size == 0 and self.ends_with is None)
        return (open_ended and not self.counted_by) or any(f.reaches_end for f in self.fields)

    @property
    def only_counts(self) -> bool:
        """Are these bits of which each counts others, or pads? Generated structs have no member for them."""
        bits = self.fields if self.kind == FieldKind.BITS else ()
        return any(one.is_count for one in bits) and all(one.is_count or one.kind == FieldKind.PADDING for one in bits)

    @property
    def counters(self) -> tuple[tuple[str, int], ...]:
        """The fields that count it, each with what it tells for one element or byte. The first says how many there are;
        another one agrees with it."""
        step = 1 if self.is_string else self.element_min_bytes
        first = ((self.counted_by, step if self.counted_in_bytes else 1),) if self.counted_by else ()
        return (*first, (self.bytes_counted_by, step)) if self.bytes_counted_by else first

    @property
    def element_min_bytes(self) -> int:
        """Least wire bytes of one element; of a bit field, which lies in a number's bytes, 0."""
        return sum(f.min_wire_bytes for f in self.fields) if self.kind == FieldKind.STRUCT else self.size

    @property
    def min_wire_bytes(self) -> int:
        if self.packed is not None:
            return (self.bits * (self.count or 1) + 7) // 8
        if self.ends_with is not None:
            return 1
        return 0 if self.is_list else self.element_min_bytes * (self.count or 1)

    @property
    def max_wire_bytes(self) -> int:
        if self.is_string and self.size == 0:
            return self.max_size + (self.ends_with is not None)
        if self.kind == FieldKind.STRUCT:
            return sum(f.max_wire_bytes for f in self.fields) * (self.max_count or self.count or 1)
        return self.size * self.max_count if self.is_list else self.min_wire_bytes


class MatchOf(StrEnum):
    """What tells a message's frames from those of others."""

    ID = "id"
    HEADER = "header"  # a header field, as bits on the wire
    PAYLOAD = "payload"  # a number at a place of the payload that is always the same
    SIZE = "size"  # payload bytes


@dataclass(frozen=True)
class PayloadPlace:
    """A number of the payload, at a place that is always the same: (number >> shift) & mask."""

    at: int
    bytes: int
    order: ByteOrder
    shift: int
    mask: int


@dataclass(frozen=True)
class Match:
    """Frames of a message have this: a number of ``width`` bits of which the bits of ``mask`` lie in one of ``ranges``.

    ``width`` is 32 for an id, whatever the frame's id part holds.
    """

    of: MatchOf
    ranges: tuple[tuple[int, int], ...]  # rising and apart, both bounds included; of a magic as the file lists them
    width: int
    mask: int
    name: str = ""  # of the header field, or of the field of the payload
    place: PayloadPlace | None = None  # of a number of the payload

    def holds(self, value: int) -> bool:
        return any(low <= value & self.mask <= high for low, high in self.ranges)

    @property
    def whole(self) -> int:
        return (1 << self.width) - 1

    @property
    def is_one_value(self) -> bool:
        low, high = self.ranges[0]
        return len(self.ranges) == 1 and low == high and self.mask == self.whole

    @property
    def least(self) -> int:
        """The least number that has it, of magics the first: what is sent where no other is given. Bits that do not
        count are 0."""
        return self.ranges[0][0]


@dataclass(frozen=True)
class Message:
    """``id`` is the least one where ``match`` has several."""

    name: str
    id: int
    sender: End
    fields: tuple[Field, ...] = ()
    every: float | None = None  # seconds
    reply: str | None = None
    description: str = ""
    seed: int | None = None  # counted by the frame's seeded check, not sent
    queue: Queue = Queue.NORMAL
    log: str | None = None  # the text that it stands for, `{field}` where a value is shown
    log_level: LogLevel = LogLevel.INFO
    has_id: bool = True  # False: `id` is 0, and of its sender's frames those without an id carry it
    match: tuple[Match, ...] = ()  # what its frames have beside one id, or several ids

    @property
    def ids(self) -> Match | None:
        """All its ids, where it has more than one."""
        return next((match for match in self.match if match.of == MatchOf.ID), None)

    @property
    def min_payload(self) -> int:
        return sum(f.min_wire_bytes for f in self.fields)

    @property
    def max_payload(self) -> int:
        return sum(f.max_wire_bytes for f in self.fields)

    def sent_by(self, end: End | None) -> bool:
        return end is None or end == End.BOTH or self.sender in (end, End.BOTH)


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
    """What a length number counts; ``offset`` of the part comes on top."""

    PAYLOAD = "payload"
    REST = "rest"  # all that follows the length
    SELF_AND_REST = "self_and_rest"
    FRAME = "frame"


class CheckKind(StrEnum):
    CRC = "crc"
    SUM = "sum"
    XOR = "xor"
    FLETCHER = "fletcher"


@dataclass(frozen=True)
class Algorithm:
    """A check algorithm by its parameters. CRC parameters as in the reveng catalogue (Rocksoft model)."""

    name: str
    kind: CheckKind
    width: int  # bits
    poly: int = 0
    init: int = 0
    refin: bool = False
    refout: bool = False
    xorout: int = 0
    modulus: int = 0  # Fletcher: of both sums; 0: 2 ** (width / 2)
    negate: bool = False  # two's complement of the value, before xorout


class BitRole(StrEnum):
    """What a run of bits inside a header byte is."""

    ID = "id"
    LENGTH = "length"
    FIELD = "field"
    SEQUENCE = "sequence"
    CONSTANT = "constant"


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
        """What ``sender`` sends; the host's where the sender is not known, or both."""
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
    value: int = 0  # of a constant
    header: HeaderField | None = None  # of a field or a sequence

    @property
    def mask(self) -> int:
        return (1 << self.width) - 1


class Subject(StrEnum):
    """What a condition compares."""

    FIELD = "field"  # of the header, as bits on the wire
    ID = "id"
    MAGIC = "magic"  # its bytes as a number, the first one highest
    SENDER = "sender"  # SENDER_NUMBERS
    SIZE = "size"  # payload bytes, before trimming and stuffing


SENDER_NUMBERS = {End.HOST: 0, End.MCU: 1}


@dataclass(frozen=True)
class Comparison:
    """``subject & mask`` lies in one of ``ranges``. It does not hold where the subject is not in the frame."""

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
    """When a part is there: all of ``terms`` hold; ``negated``: not all of them."""

    terms: tuple[Comparison | Condition, ...]
    negated: bool = False

    @property
    def comparisons(self) -> tuple[Comparison, ...]:
        """All of them, those of conditions in it, too."""
        found: list[Comparison] = []
        for term in self.terms:
            found += [term] if isinstance(term, Comparison) else term.comparisons
        return tuple(found)


@dataclass(frozen=True)
class Part:
    """One part of a frame, in wire order. ``size`` in bytes is 0 only for the payload."""

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
    first: int = 0  # check: index of the first part that it covers
    last: int = 0  # check: index of the last one, inclusive
    shift: int = 0  # check: value on the wire = check >> shift
    seeded: bool = False  # check: the message's seed is counted behind the range
    as_hex: bool = False  # check: sent as hex digits, ``size`` of them
    alternatives: tuple[bytes, ...] = ()  # magic: any of these, ``value`` is the first
    by_sender: tuple[tuple[End, bytes], ...] = ()  # magic: another one for each direction
    length_unit: int = 1  # length: bytes that it counts by
    trims_zeros: bool = False  # payload: zeros at its end are not sent
    header: HeaderField | None = None  # field, sequence
    bits: tuple[Bits, ...] = ()
    condition: Condition | None = None
    is_plain: bool = False  # sent as it is, beside parts that are stuffed
    on_wire: bool = False  # check: over the bytes as they are sent, after stuffing


def cobs_overhead(size: int) -> int:
    """Bytes that COBS adds to ``size`` bytes at most; `cobs_overhead` of core/include/wirebond/format.hpp."""
    return 1 + size // 254


class Stuffing(StrEnum):
    NONE = "none"
    COBS = "cobs"
    ESCAPE = "escape"  # by an escape byte: see ``Escapes``
    HEX = "hex"  # each byte as two hex digits
    INSERTION = "insertion"  # a byte behind each place where a sequence stands: see ``Insertion``


@dataclass(frozen=True)
class Escapes:
    """Byte stuffing by an escape byte: each of ``pairs`` is (byte that must not appear, code behind the escape).

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
    """Behind the bytes ``after``, wherever they stand among the stuffed ones, ``byte`` is sent."""

    after: bytes
    byte: int


@dataclass(frozen=True)
class FrameFormat:
    """``delimiter`` is None for frames that are found by their magic and size, or ended by silence."""

    parts: tuple[Part, ...]
    max_payload: int
    deliver_unknown: bool
    delimiter: bytes | None = None  # behind a frame
    stuffing: Stuffing = Stuffing.NONE
    opening: bytes | None = None  # delimiter before a frame; None: only its end is marked
    escapes: Escapes | None = None
    insertion: Insertion | None = None
    ends_by_silence: bool = False
    is_strict: bool = False  # a candidate that failed behind its header is not looked through again

    def part(self, kind: PartKind) -> Part | None:
        return next((p for p in self.parts if p.kind == kind), None)

    @property
    def is_sized(self) -> bool:
        """Is it stuffed, and ended by its length and no delimiter?"""
        return self.delimiter is None and self.stuffing != Stuffing.NONE

    @property
    def length_on_wire(self) -> bool:
        """Does the length count the bytes as they are sent? Where it ends a stuffed frame and stands beside them."""
        return self.is_sized and any(
            part.is_plain and (part.kind == PartKind.LENGTH or any(run.role == BitRole.LENGTH for run in part.bits))
            for part in self.parts
        )

    def overhead(self, size: int) -> int:
        """Bytes that stuffing adds to ``size`` bytes at most."""
        if self.stuffing == Stuffing.COBS:
            return cobs_overhead(size)
        if self.stuffing == Stuffing.INSERTION and self.insertion is not None:
            return size // len(self.insertion.after)
        return 0 if self.stuffing == Stuffing.NONE else size


PAUSE_MARGIN = 0.002  # seconds
MAX_LATENCY = 1.0  # seconds that a port may hold bytes back: longer is a fault of the device


class Parity(StrEnum):
    NONE = "none"
    EVEN = "even"
    ODD = "odd"


@dataclass(frozen=True)
class LinkSettings:
    baud: int = 115200
    data_bits: int = 8
    parity: Parity = Parity.NONE
    stop_bits: float = 1
    max_run: float = 0.001  # seconds of line that one run of frames takes at most, unless it is a single frame
    max_age: float | None = None  # seconds; frames that waited longer expire
    echo: bool = False  # an end hears what it sends
    adapter_latency: float | None = None  # seconds that the host's port may hold bytes back; None: by its device

    @property
    def bits_per_byte(self) -> float:
        """Start bit, data, parity and stop bits."""
        return 1 + self.data_bits + (self.parity != Parity.NONE) + self.stop_bits

    @property
    def max_run_bytes(self) -> int:
        return max(1, int(self.max_run * self.baud / self.bits_per_byte))


@dataclass(frozen=True)
class Deadline:
    message: str
    at: End
    after: float  # seconds
    then: str
    recover: Recover


@dataclass(frozen=True)
class StopMessage:
    """One message of ``emergency_stop``: what stops the robot, and the safe value that ends a lease."""

    message: str
    values: tuple[tuple[str, float | int | bool | str], ...]
    header: tuple[tuple[str, HeaderDefault], ...] = ()  # of the frame, where it differs from the host's defaults


ExampleScalar = float | int | bool | str | bytes
# An array is a tuple, a struct a mapping.
ExampleValue = Union[ExampleScalar, tuple["ExampleValue", ...], Mapping[str, "ExampleValue"]]  # noqa: UP007  (recursive)


@dataclass(frozen=True)
class Example:
    """A worked example of the file: a message's values, and the frame that is said to carry them.

    Nothing here says that the two agree; ``wirebond check`` compares them. ``sender`` is one end, never both.
    """

    message: str
    sender: End
    values: tuple[tuple[str, ExampleValue], ...]
    frame: bytes
    header: tuple[tuple[str, HeaderDefault], ...] = ()  # named header fields that differ from their defaults


@dataclass(frozen=True)
class Service:
    """An optional built-in message mapped to messages of this protocol, by role (``request``, ``reply``, …)."""

    name: str
    messages: tuple[tuple[str, str], ...]

    def message(self, role: str) -> str | None:
        return dict(self.messages).get(role)


@dataclass(frozen=True)
class Protocol:
    name: str
    format: FrameFormat
    messages: tuple[Message, ...]
    link: LinkSettings = LinkSettings()
    deadlines: tuple[Deadline, ...] = ()
    emergency_stop: tuple[StopMessage, ...] = ()  # sent and released together, in this order
    services: tuple[Service, ...] = ()
    examples: tuple[Example, ...] = ()
    idle: float | None = None  # seconds; None: the default rule
    fixed: End | None = None  # the end that exists already and cannot change; BOTH: a link that is only listened to
    description: str = ""
    path: str = field(default="", compare=False)
    text: str = field(default="", compare=False, repr=False)  # of the file

    def message(self, name: str) -> Message:
        """The message of this name; KeyError if there is none."""
        for message in self.messages:
            if message.name == name:
                return message
        raise KeyError(name)

    def service(self, name: str) -> Service | None:
        return next((s for s in self.services if s.name == name), None)

    def max_wire_bytes(self, payload: int | None = None) -> int:
        """Wire bytes of the largest frame, or of one with ``payload`` bytes, delimiters and worst stuffing included.

        Of forms that exclude each other the largest counts.
        """
        from wirebond.protocol.plan import forms  # noqa: PLC0415  (it needs this module)

        rule = self.format.part(PartKind.PAYLOAD)
        if rule is not None and rule.payload == PayloadRule.FIXED:
            payload = rule.fixed_payload
        beside = max(form.prefix + form.suffix for form in forms(self.format.parts, None))
        size = beside + (self.format.max_payload if payload is None else payload)
        size += self.format.overhead(size)
        delimiter = self.format.delimiter or b""
        return size + len(self.format.opening or delimiter) + len(delimiter)

    @property
    def pause_seconds(self) -> float:
        """Where silence ends a frame: what a sender leaves the line silent between two frames; else 0.

        More than the silence, so that a receiver that looks every millisecond sees it from its beginning to its end.
        """
        return self.idle_seconds + PAUSE_MARGIN if self.format.ends_by_silence else 0.0

    @property
    def idle_seconds(self) -> float:
        """Silence that ends an incomplete candidate: the file's, or the longer of 20 ms and two frames."""
        if self.idle is not None:
            return self.idle
        frame_time = self.max_wire_bytes() * self.link.bits_per_byte / self.link.baud
        return max(0.020, 2 * frame_time)
