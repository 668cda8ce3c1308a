"""The constants among a message's fields, as a payload has them. Read field by field, without the engine's offsets."""

from __future__ import annotations

from dataclasses import dataclass, field

from wirebond.analysis.explain.numbers import raw_number
from wirebond.protocol.model import ByteOrder, Field, Message
from wirebond.protocol.model.layout import Bits, Characters, Constant, Group, List, Number, Step


@dataclass(frozen=True)
class FoundConstant:
    """``path`` names the field: ``motor.version``."""

    path: str
    holds: bool
    expected: str
    text: str  # its value in the payload


def constants_of(message: Message, payload: bytes) -> list[FoundConstant]:
    """Return the constants in wire order. One that a count moves beyond the payload's end is missing, and does not
    hold."""
    walk = _Walk(payload)
    walk.read(message.layout, "")
    return walk.found


@dataclass
class _Walk:
    payload: bytes
    at: int = 0
    found: list[FoundConstant] = field(default_factory=list)
    misplacing: list[FoundConstant] = field(default_factory=list)  # counts after which no constant has its place

    def read(self, steps: tuple[Step, ...], path: str) -> None:
        numbers: dict[str, int] = {}
        for step in steps:
            one = step.field
            match step:
                case List() | Characters() if one.is_variable:
                    self._skip(step, numbers, path)
                case Group():
                    for index in range(one.count or 1):
                        self.read(step.steps, f"{path}{one.name}{'' if one.count is None else f'[{index}]'}.")
                case _:
                    data = self._take(one.min_wire_bytes)
                    if isinstance(step, Number):
                        numbers[one.name] = raw_number(one, data)
                    if isinstance(step, Constant):
                        self._add(one, f"{path}{one.name}", raw_number(one, data) if len(data) == one.size else None)
                    if isinstance(step, Bits):
                        numbers |= self._bits(step, data, path)

    def _take(self, size: int) -> bytes:
        self.at += size
        return self.payload[self.at - size : self.at]

    def _skip(self, step: List | Characters, numbers: dict[str, int], path: str) -> None:
        unit = step.stride if isinstance(step, List) else 1
        for told in step.told[:1]:  # a count of the payload's rest is the last one, and has none
            number = numbers[told.name]
            self.at += unit // told.per * number
            if number % told.per and number <= step.field.max_wire_bytes:
                fault = FoundConstant(f"{path}{told.name}", False, f"a multiple of {told.per}", str(number))
                self.misplacing.append(fault)

    def _bits(self, step: Bits, data: bytes, path: str) -> dict[str, int]:
        """Return the numbers among the bits."""
        one = step.field
        shared = raw_number(one, data.ljust(one.size, b"\0"))
        for member in step.members:
            if member.field.constant is None:
                continue
            touched = range(member.low // 8, (member.low + member.field.width - 1) // 8 + 1)  # the lowest byte first
            places = touched if one.order == ByteOrder.LITTLE else [one.size - 1 - place for place in touched]
            bits = member.bits_of(shared) if max(places) < len(data) else None
            self._add(member.field, f"{path}{one.name}.{member.field.name}", bits)
        number = raw_number(one, data)
        return {f"{one.name}.{member.field.name}": member.bits_of(number) for member in step.members}

    def _add(self, one: Field, path: str, number: int | None) -> None:
        assert one.constant is not None
        self.found += self.misplacing
        self.misplacing.clear()
        text = "the payload's end" if number is None else constant_text(one, number)
        self.found.append(FoundConstant(path, number == one.constant, constant_text(one, one.constant), text))


def constant_text(one: Field, number: int) -> str:
    """Write the constant: ``0x5A``; of bits ``5``; of a string its bytes."""
    if one.bits:
        return str(number)
    if one.size <= 8:
        return f"0x{number:0{2 * one.size}X}"
    return number.to_bytes(one.size, "big").hex(" ").upper()
