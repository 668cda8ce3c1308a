"""The constants among a message's fields, as a payload has them. Read field by field, without the engine's offsets."""

from __future__ import annotations

from dataclasses import dataclass, field

from wirebond.protocol.model import ByteOrder, Field, FieldKind, Message
from wirebond.protocol.payload_rules import bit_places


@dataclass(frozen=True)
class FoundConstant:
    """``path`` names the field: ``motor.version``."""

    path: str
    holds: bool
    expected: str
    text: str  # what the payload has


def constants_of(message: Message, payload: bytes) -> list[FoundConstant]:
    """In wire order. What a count of the payload moves beyond its end is not there, and does not hold."""
    walk = _Walk(payload)
    walk.read(message.fields, "")
    return walk.found


@dataclass
class _Walk:
    payload: bytes
    at: int = 0
    found: list[FoundConstant] = field(default_factory=list)
    misplacing: list[FoundConstant] = field(default_factory=list)  # counts behind which no constant has its place

    def read(self, fields: tuple[Field, ...], path: str) -> None:
        numbers: dict[str, int] = {}
        for one in fields:
            if one.is_list or (one.is_characters and one.size == 0):
                unit = 1 if one.is_string else one.element_min_bytes
                for name, step in one.counters[:1]:  # what reaches to the end is the last, and has none
                    number = numbers[name]
                    self.at += unit // step * number
                    if number % step and number <= one.max_wire_bytes:
                        fault = FoundConstant(f"{path}{name}", False, f"a multiple of {step}", str(number))
                        self.misplacing.append(fault)
            elif one.kind == FieldKind.STRUCT:
                for index in range(one.count or 1):
                    self.read(one.fields, f"{path}{one.name}{'' if one.count is None else f'[{index}]'}.")
            else:
                size = one.min_wire_bytes
                data = self.payload[self.at : self.at + size]
                self.at += size
                if one.is_unsigned:
                    numbers[one.name] = _number(one, data)
                for member, low in bit_places(one) if one.kind == FieldKind.BITS else ():
                    numbers[f"{one.name}.{member.name}"] = _number(one, data) >> low & (1 << member.width) - 1
                self._constants(one, data, path)

    def _constants(self, one: Field, data: bytes, path: str) -> None:
        if one.constant is not None:
            self._add(one, f"{path}{one.name}", _number(one, data) if len(data) == one.size else None)
        for member, low in bit_places(one) if one.kind == FieldKind.BITS else ():
            if member.constant is None:
                continue
            touched = range(low // 8, (low + member.width - 1) // 8 + 1)  # the lowest byte first
            places = touched if one.order == ByteOrder.LITTLE else [one.size - 1 - place for place in touched]
            whole = data.ljust(one.size, b"\0")
            bits = _number(one, whole) >> low & (1 << member.width) - 1
            self._add(member, f"{path}{one.name}.{member.name}", bits if max(places) < len(data) else None)

    def _add(self, one: Field, path: str, number: int | None) -> None:
        assert one.constant is not None
        self.found += self.misplacing
        self.misplacing.clear()
        text = "the payload's end" if number is None else constant_text(one, number)
        self.found.append(FoundConstant(path, number == one.constant, constant_text(one, one.constant), text))


def _number(one: Field, data: bytes) -> int:
    return int.from_bytes(data, "big" if one.order == ByteOrder.BIG else "little")


def constant_text(one: Field, number: int) -> str:
    """``0x5A``; of bits ``5``; of a string its bytes."""
    if one.bits:
        return str(number)
    if one.size <= 8:
        return f"0x{number:0{2 * one.size}X}"
    return number.to_bytes(one.size, "big").hex(" ").upper()
