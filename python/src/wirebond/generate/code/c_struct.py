"""Structs of fields as C: each is in memory as the C++ struct of the same fields, member for member."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from wirebond.generate.code.c_names import Names, member_name
from wirebond.generate.code.cpp_field import element_type, hex_literal, member_comment
from wirebond.generate.code.cpp_number import integer, real, real_type, wire_integer
from wirebond.generate.code.cpp_shape import Member, Shape
from wirebond.protocol.model import End, Field

_INT_MAX = 2**31 - 1


@dataclass(frozen=True)
class Constants:
    """Names for the values of one field: of an enum, or the masks of flags."""

    comment: str
    type_name: str  # typedef of the enum's values; empty for flags
    underlying: str
    values: tuple[tuple[str, str], ...]  # name, literal
    are_ints: bool  # may they be enumeration constants, which are ints in C?


@dataclass(frozen=True)
class CMember:
    name: str
    cpp_name: str
    declaration: str
    comment: str


@dataclass(frozen=True)
class CStruct:
    type_name: str  # the typedef; the struct has the same name without `_t`
    cpp: str  # full name of the C++ struct
    members: tuple[CMember, ...]

    @property
    def tag(self) -> str:
        return self.type_name.removesuffix("_t")


@dataclass
class Declarations:
    """The declarations of a header for its structs, in the order that C needs."""

    constants: list[Constants]
    limits: list[tuple[str, str]]  # name, literal
    structs: list[CStruct]


@dataclass(frozen=True)
class MessageView:
    """A message as C sees it."""

    name: str
    comment: str
    facts: list[tuple[str, str, str]]  # constant, literal, comment
    declared: Declarations
    type_name: str  # empty where it has no member
    cpp: str
    functions: dict[str, str]
    encoders: list[tuple[str, str]]  # function, template argument of the C++ one
    header_encoders: list[tuple[str, str]]  # the same with a header; none where frames have no header field
    index: int
    sender: End
    reply: str | None


class Declarer:
    """Collects declarations of structs, those within them first."""

    def __init__(self, names: Names, namespace: str) -> None:
        self._names = names
        self._namespace = namespace
        self._named: dict[str, str] = {}  # C++ path of one of the file's types -> its C type
        self._found = Declarations([], [], [])

    def take(self) -> Declarations:
        """Return the declarations since the last call."""
        found, self._found = self._found, Declarations([], [], [])
        return found

    def named(self, shapes: Mapping[str, Shape]) -> None:
        """Declare the file's types, by their names in the file."""
        for name, shape in shapes.items():
            self._named[shape.path] = self.struct(shape, name)

    def struct(self, shape: Shape, *words: str) -> str:
        """Declare a struct that ``words`` name; its type."""
        type_name = self._names.claim(*words, suffix="_t")
        members = []
        for member in shape.members:
            if not member.name:
                continue
            element = self._element(member, words)
            self._limits(member.spec, words)
            comment = member_comment(member.spec, self._names_of_flags(member.spec, words))
            name = member_name(member.name)
            members.append(CMember(name, member.name, _declared(member.spec, element, name), comment))
        self._found.structs.append(CStruct(type_name, f"{self._namespace}::{shape.path}", tuple(members)))
        return type_name

    def _element(self, member: Member, words: tuple[str, ...]) -> str:
        """Return the type of one element; its own types are declared before."""
        spec = member.spec
        if member.shape is not None:
            if not member.is_own_type:
                return self._named[member.type_name]
            return self.struct(member.shape, *words, spec.name)
        if spec.flags:
            self._values(spec, words, [(name, 1 << bit) for name, bit in spec.flags])
        if spec.enum:
            return self._values(spec, words, spec.enum)
        if spec.is_string:
            return "char" if spec.value_type is str else "uint8_t"
        return element_type(spec, "").removeprefix("std::")

    def _values(self, spec: Field, words: tuple[str, ...], values: Iterable[tuple[str, int]]) -> str:
        underlying = wire_integer(spec).type_name.removeprefix("std::")
        type_name = self._names.claim(*words, spec.name, suffix="_t") if spec.enum else ""
        literal = (lambda value: hex_literal(value, (spec.width + 7) // 8)) if spec.flags else integer
        named = [(self._names.constant(*words, spec.name, name), value) for name, value in values]
        self._found.constants.append(
            Constants(
                f"{'Values' if spec.enum else 'Bits'} of `{'.'.join((*words, spec.name))}`.",
                type_name,
                underlying,
                tuple((name, literal(value)) for name, value in named),
                all(-_INT_MAX - 1 <= value <= _INT_MAX for _, value in named),
            )
        )
        return type_name

    def _names_of_flags(self, spec: Field, words: tuple[str, ...]) -> str:
        return f"{self._names.prefix_of(*words, spec.name)}_..." if spec.flags else ""

    def _limits(self, spec: Field, words: tuple[str, ...]) -> None:
        """Declare a constant for each end of a number's range."""
        if not spec.is_number or spec.enum:
            return
        for bound, word, whole in ((spec.minimum, "min", math.ceil), (spec.maximum, "max", math.floor)):
            if bound is None:
                continue
            is_real = spec.is_float or spec.is_scaled
            literal = real(bound, real_type(spec)) if is_real else integer(whole(bound))
            negative = literal.startswith("-")
            self._found.limits.append(
                (self._names.constant(*words, spec.name, word), f"({literal})" if negative else literal)
            )


def _declared(spec: Field, element: str, name: str) -> str:
    if spec.is_string:
        size = spec.size if not spec.is_variable else spec.max_size
        array = f"{element} {'data' if spec.is_variable else name}[{size}]"
        return f"struct {{ uint16_t size; {array}; }} {name}" if spec.is_variable else array
    if spec.is_list:
        return f"struct {{ uint16_t size; {element} data[{spec.max_count}]; }} {name}"
    return f"{element} {name}" + (f"[{spec.count}]" if spec.count is not None else "")
