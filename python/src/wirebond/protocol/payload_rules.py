"""Rules over a message's payload, lowered to bytes: constants among its fields, and the size given by its counts.

A place is counted from the payload's beginning as if everything that varies were empty. What lies behind elements or
strings of varying number moves by what those take; so each place also says how many of the message's counts it is
behind.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Literal

from wirebond.protocol.model import ByteOrder, Field, Message, PayloadPlace
from wirebond.protocol.model.layout import Bits, Characters, Constant, Group, List, Number, Step, Told, layout_of

MAX_CONSTANT_BYTES = 64  # of one message
MAX_COUNTS = 8  # of one message, where a rule needs them


@dataclass(frozen=True)
class PayloadConstant:
    """A byte that must have ``value`` in the bits of ``mask``."""

    at: int
    behind: int  # it is moved by the bytes of this many counts
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
    """One that counts elements or bytes somewhere after it."""

    unit: int  # payload bytes for each that it counts
    most: int  # a greater number is none of this message
    step: int  # nor is one that this does not divide: it counts the bytes of elements that are so long
    agrees_with: int | None  # an earlier count of the same elements, which must be equal; it moves later bytes


@dataclass(frozen=True)
class PayloadRules:
    constants: tuple[PayloadConstant, ...] = ()
    counts: tuple[PayloadCount, ...] = ()
    tells_size: bool = True  # the counts alone give the payload's size
    faults: tuple[tuple[str, str], ...] = ()  # field of the message, and why a rule about it cannot be applied
    most_beside: int = 0  # not 0: maximum number of payload bytes that no count counts

    @property
    def needed_counts(self) -> int:
        """Return how many of the counts determine the places of the constants."""
        return max((constant.behind for constant in self.constants), default=0)


def payload_rules(message: Message) -> PayloadRules:
    lowering = _Lowering()
    for step in message.layout:
        lowering.name = step.field.name
        lowering.read(step)
    return PayloadRules(
        tuple(lowering.constants), tuple(lowering.counts), lowering.tells_size, tuple(lowering.faults.items())
    )


def bounded(message: Message, rules: PayloadRules) -> PayloadRules:
    """Return the rules with a bound on the payload: what the first counts tell, and the most that everything else
    takes."""
    kept = len(rules.counts)
    if kept > MAX_COUNTS:
        kept = MAX_COUNTS - (rules.counts[MAX_COUNTS].agrees_with is not None)
    counts = rules.counts[:kept]
    counted = sum(count.unit * count.most for count in counts if count.agrees_with is None)
    return replace(rules, counts=counts, most_beside=message.max_payload - counted if counts else 0)


def named_numbers(fields: tuple[Field, ...]) -> Iterator[tuple[str, tuple[Field, PayloadPlace]]]:
    """Return the unsigned numbers of a message at places that are always the same, by their paths: its own, those among
    their bits, and those of its structs."""
    return _numbers_of(_Lowering(), layout_of(fields), "")


def _numbers_of(
    lowering: _Lowering, steps: tuple[Step, ...], path: str
) -> Iterator[tuple[str, tuple[Field, PayloadPlace]]]:
    for step in steps:
        one = step.field
        if isinstance(step, Group) and one.count is None:
            yield from _numbers_of(lowering, step.steps, f"{path}{one.name}.")
            continue
        is_lost = lowering.is_lost or bool(lowering.counts)
        before = lowering.at
        lowering.read(step)
        if is_lost:
            continue
        if isinstance(step, Number) and one.is_unsigned and not one.is_scaled:
            yield f"{path}{one.name}", (one, PayloadPlace(before, one.size, one.order, 0, (1 << one.width) - 1))
        for run in step.members if isinstance(step, Bits) else ():
            if run.field.is_unsigned and not run.field.is_scaled and len(run.pieces) == 1:
                place = PayloadPlace(before, one.size, one.order, run.low, (1 << run.field.width) - 1)
                yield f"{path}{one.name}.{run.field.name}", (run.field, place)


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
    is_lost: bool = False  # after a string that a byte ends, or elements of different sizes
    _numbers: list[dict[str, CountingNumber]] = field(
        default_factory=lambda: [{}]
    )  # of the lists of fields that are open

    def read(self, step: Step) -> None:
        one = step.field
        match step:
            case Bits():
                self._read_bits(step)
            case Group():
                for _ in range(one.count or 1):
                    self._numbers.append({})
                    for inner in step.steps:
                        self.read(inner)
                    self._numbers.pop()
            case List(told=told):
                self._read_varying(one, told, step.stride, one.max_count)
            case Characters(told=told) if one.size == 0:
                self._read_varying(one, told, 1, one.max_size)
            case _:
                if isinstance(step, Constant):
                    self._add(step.wire, b"\xff" * one.size)
                if isinstance(step, Number) and one.is_unsigned and not self.is_lost:
                    mask = (1 << one.width) - 1
                    number = CountingNumber(self.at, len(self.counts), one.size, one.order, 0, mask)
                    self._numbers[-1][one.name] = number
                self.at += one.min_wire_bytes

    def _read_bits(self, step: Bits) -> None:
        container = step.field
        mask = value = 0
        for run in step.members:
            ones = (1 << run.field.width) - 1
            if run.field.constant is not None:
                mask |= ones << run.low
                value |= run.field.constant << run.low
            if run.field.is_unsigned and len(run.pieces) == 1 and not self.is_lost:
                number = CountingNumber(self.at, len(self.counts), container.size, container.order, run.low, ones)
                self._numbers[-1][f"{container.name}.{run.field.name}"] = number
        if mask:
            order: Literal["big", "little"] = "big" if container.order == ByteOrder.BIG else "little"
            wire, masks = (n.to_bytes(container.size, order) for n in (value, mask))
            self._add(wire, masks)
        self.at += container.size

    def _add(self, wire: bytes, masks: bytes) -> None:
        if self.is_lost:
            self._fail(f"`{self.name}` follows a field of varying size that has no count; move it before that field")
        for place, (byte, mask) in enumerate(zip(wire, masks, strict=True)):
            if mask:
                self.constants.append(PayloadConstant(self.at + place, len(self.counts), mask, byte))
        if len(self.constants) > MAX_CONSTANT_BYTES:
            self._fail(f"a message has at most {MAX_CONSTANT_BYTES} bytes of constants; write fewer")

    def _read_varying(self, one: Field, told: tuple[Told, ...], size: int, most: int) -> None:
        if has_constants(one.fields):
            self._fail(
                f"`{self.name}` varies in number, and its elements contain a constant; a constant needs a fixed "
                "place: move it out of the elements"
            )
        numbers = self._numbers[-1]
        if not told or told[0].name not in numbers or any(member.is_variable for member in one.fields):
            self.tells_size, self.is_lost = False, True
            return
        first = len(self.counts)
        for count in told:
            agrees_with = None if len(self.counts) == first else first
            self.counts.append(
                PayloadCount(
                    **vars(numbers[count.name]),
                    unit=size // count.per,
                    most=most * count.per,
                    step=count.per,
                    agrees_with=agrees_with,
                )
            )

    def _fail(self, sentence: str) -> None:
        self.faults.setdefault(self.name, sentence)
