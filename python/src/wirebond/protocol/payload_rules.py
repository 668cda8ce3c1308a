"""Rules over a message's payload, lowered to bytes: constants among its fields, and what its counts tell of its size.

A place is counted from the payload's beginning as if everything that varies were empty. What lies behind elements or
strings of varying number moves by what those take; so each place also says how many of the message's counts it is
behind.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from wirebond.protocol.model import BitOrder, ByteOrder, Field, FieldKind, Message, PayloadPlace

MAX_CONSTANT_BYTES = 64  # of one message
MAX_COUNTS = 8  # of one message, where a rule needs them


@dataclass(frozen=True)
class PayloadConstant:
    """A byte that must have ``value`` in the bits of ``mask``."""

    at: int
    behind: int  # this many of the counts say how much farther it lies
    mask: int
    value: int


@dataclass(frozen=True)
class CountingNumber:
    """A number of the payload: (number >> shift) & mask."""

    at: int
    behind: int
    bytes: int
    order: ByteOrder
    shift: int
    mask: int


@dataclass(frozen=True)
class PayloadCount(CountingNumber):
    """One that tells how many elements or bytes follow somewhere behind it."""

    unit: int  # payload bytes for each that it counts
    most: int  # a greater number is none of this message
    step: int  # nor is one that this does not divide: it counts the bytes of elements that are so long
    agrees_with: int | None  # an earlier count of the same elements, which takes the bytes; this one tells as many


@dataclass(frozen=True)
class PayloadRules:
    constants: tuple[PayloadConstant, ...] = ()
    counts: tuple[PayloadCount, ...] = ()
    tells_size: bool = True  # do the counts alone tell how many bytes the payload has?
    faults: tuple[tuple[str, str], ...] = ()  # field of the message, and why a rule about it cannot be applied
    most_beside: int = 0  # not 0: a payload with more bytes than this beside what the counts tell is refused

    @property
    def needed_counts(self) -> int:
        """How many of the counts say where the constants lie."""
        return max((constant.behind for constant in self.constants), default=0)


def payload_rules(message: Message) -> PayloadRules:
    lowering = _Lowering()
    for one in message.fields:
        lowering.name = one.name
        lowering.read(one)
    return PayloadRules(
        tuple(lowering.constants), tuple(lowering.counts), lowering.tells_size, tuple(lowering.faults.items())
    )


def bounded(message: Message, rules: PayloadRules) -> PayloadRules:
    """The rules with a bound on the payload: what the first counts tell, and the most that everything else takes."""
    kept = len(rules.counts)
    if kept > MAX_COUNTS:
        kept = MAX_COUNTS - (rules.counts[MAX_COUNTS].agrees_with is not None)
    counts = rules.counts[:kept]
    counted = sum(count.unit * count.most for count in counts if count.agrees_with is None)
    return replace(rules, counts=counts, most_beside=message.max_payload - counted if counts else 0)


def named_numbers(fields: tuple[Field, ...]) -> Iterator[tuple[str, tuple[Field, PayloadPlace]]]:
    """The unsigned numbers of a message at places that are always the same, by their paths: its own, those among their
    bits, and those of its structs."""
    return _numbers_of(_Lowering(), fields, "")


def _numbers_of(
    lowering: _Lowering, fields: tuple[Field, ...], path: str
) -> Iterator[tuple[str, tuple[Field, PayloadPlace]]]:
    for one in fields:
        if one.kind == FieldKind.STRUCT and one.count is None and not one.is_list:
            yield from _numbers_of(lowering, one.fields, f"{path}{one.name}.")
            continue
        is_lost = lowering.is_lost or bool(lowering.counts)
        before = lowering.at
        lowering.read(one)
        if is_lost or one.is_list or one.count is not None or one.packed is not None or one.digits is not None:
            continue
        if one.is_unsigned and not one.is_scaled:
            yield f"{path}{one.name}", (one, PayloadPlace(before, one.size, one.order, 0, (1 << one.width) - 1))
        if one.kind == FieldKind.BITS:
            for member, shift in bit_places(one):
                if member.is_unsigned and not member.is_scaled and not member.split:
                    mask = (1 << member.width) - 1
                    place = PayloadPlace(before, one.size, one.order, shift, mask)
                    yield f"{path}{one.name}.{member.name}", (member, place)


def bit_places(container: Field) -> Iterator[tuple[Field, int]]:
    """The values that share a number's bits, and the place of each one's lowest bit."""
    passed = 0
    for member in container.fields:
        low = container.first == BitOrder.LOW
        yield member, passed if low else 8 * container.size - passed - member.bits_here
        passed += member.bits_here


def pieces(member: Field, low: int) -> tuple[tuple[int, int], ...]:
    """The lowest bit, in the number that is shared, and the bits of each piece of a value; the value's lowest first.

    :param low: as `bit_places` gives it.
    """
    return member.split or ((low, member.width),)


def bits_of(member: Field, low: int, number: int) -> int:
    """The bits of one of the values that share ``number``."""
    found = done = 0
    for place, size in pieces(member, low):
        found |= (number >> place & (1 << size) - 1) << done
        done += size
    return found


def bits_text(member: Field, low: int) -> str:
    """``bit 3``, ``bits 0 to 6``, or ``bits 40 to 43 and 8 to 31`` with the value's highest first."""
    places = pieces(member, low)
    if member.width == 1:
        return f"bit {low}"
    spans = (f"{at} to {at + size - 1}" if size > 1 else str(at) for at, size in reversed(places))
    return f"bits {' and '.join(spans)}"


def has_constants(fields: tuple[Field, ...]) -> bool:
    return any(one.constant is not None or has_constants(one.fields) for one in fields)


@dataclass
class _Lowering:
    name: str = ""  # of the message's own field that is being read
    at: int = 0
    constants: list[PayloadConstant] = field(default_factory=list)
    counts: list[PayloadCount] = field(default_factory=list)
    faults: dict[str, str] = field(default_factory=dict)
    tells_size: bool = True
    is_lost: bool = False  # behind a string that a byte ends, or elements of which each has its own size
    _numbers: list[dict[str, CountingNumber]] = field(
        default_factory=lambda: [{}]
    )  # of the lists of fields that are open

    def read(self, one: Field) -> None:
        if one.kind == FieldKind.BITS:
            self._read_bits(one)
        elif one.kind == FieldKind.STRUCT and not one.is_list:
            for _ in range(one.count or 1):
                self._numbers.append({})
                for member in one.fields:
                    self.read(member)
                self._numbers.pop()
        elif one.is_list or (one.is_characters and one.size == 0):
            self._read_varying(one)
        else:
            if one.constant is not None:
                self._add(one.constant_bytes, b"\xff" * one.size)
            if one.is_unsigned and one.digits is None and not self.is_lost:
                mask = (1 << one.width) - 1
                self._numbers[-1][one.name] = CountingNumber(self.at, len(self.counts), one.size, one.order, 0, mask)
            self.at += one.min_wire_bytes

    def _read_bits(self, container: Field) -> None:
        mask = value = 0
        for member, shift in bit_places(container):
            ones = (1 << member.width) - 1
            if member.constant is not None:
                mask |= ones << shift
                value |= member.constant << shift
            if member.is_unsigned and not member.split and not self.is_lost:
                number = CountingNumber(self.at, len(self.counts), container.size, container.order, shift, ones)
                self._numbers[-1][f"{container.name}.{member.name}"] = number
        if mask:
            order = "big" if container.order == ByteOrder.BIG else "little"
            wire, masks = (n.to_bytes(container.size, "big" if order == "big" else "little") for n in (value, mask))
            self._add(wire, masks)
        self.at += container.size

    def _add(self, wire: bytes, masks: bytes) -> None:
        if self.is_lost:
            self._fail(f"`{self.name}` stands behind something whose size no count tells; move it before that")
        for place, (byte, mask) in enumerate(zip(wire, masks, strict=True)):
            if mask:
                self.constants.append(PayloadConstant(self.at + place, len(self.counts), mask, byte))
        if len(self.constants) > MAX_CONSTANT_BYTES:
            self._fail(f"a message has at most {MAX_CONSTANT_BYTES} bytes of constants; write fewer")

    def _read_varying(self, one: Field) -> None:
        if has_constants(one.fields):
            self._fail(
                f"`{self.name}` varies in number, and its elements hold a constant; a constant stands where its place "
                "is known: move it out of them"
            )
        numbers = self._numbers[-1]
        if one.counted_by not in numbers or any(member.is_variable for member in one.fields):
            self.tells_size, self.is_lost = False, True
            return
        size = 1 if one.is_string else one.element_min_bytes
        most = one.max_size if one.is_string else one.max_count
        first = len(self.counts)
        for name, step in one.counters:
            agrees_with = None if len(self.counts) == first else first
            self.counts.append(
                PayloadCount(
                    **vars(numbers[name]), unit=size // step, most=most * step, step=step, agrees_with=agrees_with
                )
            )

    def _fail(self, sentence: str) -> None:
        self.faults.setdefault(self.name, sentence)
