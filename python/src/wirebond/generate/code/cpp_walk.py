"""Finds the places of a message's values in its payload, for the lines that write, read and check them.

A place in the payload is ``payload`` and a number known here. After fields of varying size, ``payload``
itself is moved on by what they take beyond their least; so these lines read like those of plain messages.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from wirebond.generate.code.cpp_field import Slot, element_type
from wirebond.generate.code.cpp_shape import Member, Shape
from wirebond.protocol.model import ByteOrder, Field, FieldKind
from wirebond.protocol.model.layout import Step


@dataclass(frozen=True)
class Here:
    """The place of a struct: in the message, and in its payload."""

    value: str = "message"
    at: int = 0
    terms: str = ""  # ` + 7 * i`
    depth: int = 0  # of loops
    more: bool = False  # does something follow in the payload?

    def place(self, at: int) -> str:
        return f"payload + {self.at + at}{self.terms}"

    def inner(self, name: str, at: int, more: bool) -> Here:
        return replace(self, value=f"{self.value}.{name}", at=self.at + at, more=more)

    @property
    def index(self) -> str:
        return "ijklmnopq"[self.depth]

    def element(self, name: str, at: int, stride: int, index: str, data: str = "") -> Here:
        """Return an element of an array of structs; ``index`` is its variable."""
        return Here(
            f"{self.value}.{name}{data}[{index}]",
            self.at + at,
            f"{self.terms} + {stride} * {index}",
            self.depth + 1,
            True,
        )


def _term(stride: int, index: str) -> str:
    return f" + {index}" if stride == 1 else f" + {stride} * {index}"


def indented(lines: list[str]) -> list[str]:
    return ["  " + line for line in lines]


def loop(index: str, end: str, lines: list[str]) -> list[str]:
    head = f"for (std::size_t {index} = 0; {index} < {end}; ++{index}) {{"
    return [head, *indented(lines), "}"] if lines else []


def walk(shape: Shape, here: Here) -> Iterator[tuple[Member, Step, bool]]:
    """Yield each member with its step, and whether something follows it."""
    for number, member in enumerate(shape.members):
        assert isinstance(member.part, Step), "the bits of a number are walked with it"
        yield member, member.part, here.more or number + 1 < len(shape.members)


def container_type(spec: Field) -> str:
    return element_type(Field(spec.name, FieldKind.INTEGER, spec.size), "")


def container(spec: Field) -> Field:
    """Return the number that holds bit fields."""
    return Field(spec.name, FieldKind.INTEGER, spec.size, spec.order)


def block_copy(spec: Field, element: str) -> str:
    """Return template arguments of load_array and store_array if an array's numbers are the wire's."""
    order = ", wirebond::ByteOrder::big" if spec.order == ByteOrder.BIG else ""
    return f"<{element}, {spec.count}{order}>"


def element_slot(spec: Field, here: Here, at: int, index: str) -> Slot:
    if spec.packed is not None:
        return Slot(here.place(at), index)
    return Slot(here.place(at) + _term(spec.size, index))


def product(step: int, number: str) -> str:
    return number if step == 1 else f"{step} * {number}"


def refusal(number: str, most: int, bits: int) -> list[str]:
    """Return the line that refuses a greater number, where its type can hold one."""
    return [f"if ({number} > {most}) return false;"] if most < 2**bits - 1 else []
