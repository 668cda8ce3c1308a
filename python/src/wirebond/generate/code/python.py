"""A typed Python module for one protocol: a dataclass for each message, over the package's own encode and decode."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from wirebond.errors import UsageError
from wirebond.generate.code.cpp import message_comment
from wirebond.generate.code.cpp_field import comment_text, hex_literal, member_comment
from wirebond.generate.code.folder import render, write_files
from wirebond.generate.code.names import Scope, code_name, python_identifier, type_name
from wirebond.protocol.hash import protocol_hash
from wirebond.protocol.model import Default, Field, HeaderField, Protocol
from wirebond.protocol.model.forms import header_fields
from wirebond.protocol.stamps import stamp_of

# Names of the module itself, and of each class. A message or field of the same name gets a suffix.
_MODULE = frozenset({
    "Any", "AnyMessage", "Callable", "ClassVar", "Codec", "False", "IntEnum", "IntFlag", "Mapping", "Message",
    "None", "True", "TypeAlias",
})  # fmt: skip
_CLASS = frozenset({"bytes", "dict", "encode", "float", "from_values", "int", "bool", "reply_of", "self", "str",
                    "tuple", "values"})  # fmt: skip
# The same where frames have fields of their own.
_MODULE_OF_HEADER = frozenset({"Header", "Literal", "TypedDict"})
_CLASS_OF_HEADER = frozenset({"header"})
# The same of a message that has a time stamp.
_CLASS_OF_STAMP = frozenset({"stamp", "stamp_error"})

_LINE = 100  # longest text of a line within a method


def generate_python(protocol: Protocol, out: Path) -> list[Path]:
    """Write ``<protocol>.py`` into ``out``; return its path. As ``generate_cpp`` otherwise.

    The module loads the protocol file from its place, as seen from ``out``, and checks its hash.
    ``UsageError`` for a protocol that came out of no file.
    """
    return write_files(out, python_files(protocol, out))


def python_files(protocol: Protocol, out: Path) -> dict[str, str]:
    """Return the text of the file that ``generate_python`` writes into ``out``, by its name there."""
    if not Path(protocol.path).is_file():
        raise UsageError(f"{protocol.name} was not loaded from a file, and its module would have none to read")
    return {f"{module_name(protocol)}.py": python_module(protocol, out)}


def module_name(protocol: Protocol) -> str:
    """Return the name of the module. It must not hide a module of the standard library."""
    return protocol.name + "_protocol" if protocol.name in sys.stdlib_module_names else protocol.name


def python_module(protocol: Protocol, out: Path) -> str:
    """Return the text of the module in ``out``."""
    header = header_fields(protocol.format.parts)
    writer = _Writer(has_header=bool(header))
    claimed = [writer.claim(type_name(m.name), "Message") for m in protocol.messages]  # before types of fields
    messages = [
        writer.struct(name, m.fields, _CLASS_OF_STAMP if stamp_of(m) is not None else frozenset())
        for name, m in zip(claimed, protocol.messages, strict=True)
    ]
    stamped = {
        struct.name
        for message, struct in zip(protocol.messages, messages, strict=True)
        if stamp_of(message) is not None
    }
    return render(
        "python.py.j2",
        header=[(_string(field.name), _header_type(field.value), _header_comment(field)) for field in header],
        file=comment_text(Path(protocol.path).name or protocol.name),
        path=_string(Path(os.path.relpath(Path(protocol.path).resolve(), out.resolve())).as_posix()),
        description=_docstring(comment_text(protocol.description)),
        protocol=protocol,
        hash=f"0x{protocol_hash(protocol):016X}",
        stamped=stamped,
        blocks=writer.blocks,
        typing=["Any", "ClassVar", *["Literal"] * any(f.value.enum for f in header), "TypeAlias"]
        + ["TypedDict"] * bool(header),
        enums=sorted({block.base for block in writer.blocks if isinstance(block, ValuesBlock)}),
        replies={
            struct.name: claimed[[m.name for m in protocol.messages].index(message.reply)]
            for message, struct in zip(protocol.messages, messages, strict=True)
            if message.reply is not None
        },
        messages=[
            (message.name, struct, _docstring(message_comment(message)))
            for message, struct in zip(protocol.messages, messages, strict=True)
        ],
    )


def _header_type(field: Field) -> str:
    if field.flags:
        return "list[str | int]"
    if field.enum:
        return f"Literal[{', '.join(_string(name) for name, _ in field.enum)}] | int"
    return "float" if field.is_scaled else "int"


def _header_comment(field: HeaderField) -> str:
    facts = [comment_text(field.value.description)] if field.value.description else []
    facts += [f"in {comment_text(field.value.unit)}"] if field.value.unit else []
    return "; ".join(facts)


def _docstring(text: str) -> str:
    """Make a text safe between three quotes."""
    return text.replace("\\", "\\\\").replace('"', '\\"')


def _string(text: str) -> str:
    """Return a literal with double quotes."""
    return json.dumps(text, ensure_ascii=False)


def _call(opening: str, items: list[str], closing: str) -> str:
    """Return a line of a method, or a line for each item where that is too long."""
    line = f"{opening}{', '.join(items)}{closing}"
    if len(line) <= _LINE:
        return line
    return "\n".join([opening, *(f"            {item}," for item in items), f"        {closing}"])


# ---- classes ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ValuesBlock:
    """An enum, or flags."""

    name: str
    base: str
    comment: str
    members: list[tuple[str, str]]


@dataclass(frozen=True)
class MemberView:
    name: str
    key: str  # its name in the file
    type_text: str
    default: str  # empty: there is none
    comment: str
    to_values: str
    from_values: str


@dataclass(frozen=True)
class StructBlock:
    name: str
    members: list[MemberView]

    @property
    def has_defaults(self) -> bool:
        return all(member.default for member in self.members)

    @property
    def to_values(self) -> str:
        return _call("return {", [f'"{member.key}": {member.to_values}' for member in self.members], "}")

    @property
    def from_values(self) -> str:
        return _call("return cls(", [f"{member.name}={member.from_values}" for member in self.members], ")")


class _Writer:
    """Collects classes, those that a class needs before it."""

    def __init__(self, *, has_header: bool) -> None:
        self._scope = Scope(_MODULE | _MODULE_OF_HEADER if has_header else _MODULE)
        self._taken = _CLASS | _CLASS_OF_HEADER if has_header else _CLASS
        self._named: dict[str, StructBlock] = {}  # the file's types
        self.blocks: list[ValuesBlock | StructBlock] = []

    def claim(self, name: str, suffix: str) -> str:
        return self._scope.claim(name, suffix)

    def struct(self, name: str, fields: tuple[Field, ...], taken: frozenset[str] = frozenset()) -> StructBlock:
        """Return the class ``name``, which was claimed, after those that it needs. ``taken``: names of its own."""
        scope = Scope(self._taken | taken)
        block = StructBlock(
            name,
            [
                self._member(name, field, scope.claim(python_identifier(field.name), "_"))
                for field in fields
                if field.has_value and not field.is_count and not field.only_counts
            ],
        )
        self.blocks.append(block)
        return block

    def _member(self, owner: str, spec: Field, name: str) -> MemberView:
        own = owner + type_name(spec.name)
        value = f'values["{spec.name}"]'
        inner: StructBlock | None = None
        kind = to_one = ""
        if spec.fields:
            inner = self._struct_of(own, spec)
            kind, from_one, to_one = inner.name, f"{inner.name}.from_values({{}})", "{}.values()"
        elif spec.enum:
            kind = self._values(own, "IntEnum", spec, spec.enum)
            from_one = f"typed.enum_of({kind}, {{}})"
        elif spec.flags:
            kind = self._values(own, "IntFlag", spec, [(flag, 1 << bit) for flag, bit in spec.flags])
            from_one = f"typed.flags_of({kind}, {{}})"
        else:
            kind, from_one = _plain_type(spec), "{}"
        element = f"{kind} | int" if spec.enum else kind
        default = _default(spec, kind, inner)
        if spec.is_list or spec.count is not None:
            each = from_one.format("one")
            received = f"tuple({value})" if each == "one" else f"tuple({each} for one in {value})"
            sent = f"[{to_one.format('one')} for one in self.{name}]" if to_one else f"self.{name}"
            return MemberView(name, spec.name, f"tuple[{element}, ...]", default, _comment(spec), sent, received)
        sent = to_one.format(f"self.{name}") if to_one else f"self.{name}"
        return MemberView(name, spec.name, element, default, _comment(spec), sent, from_one.format(value))

    def _struct_of(self, own: str, spec: Field) -> StructBlock:
        if not spec.type_name:
            return self.struct(self.claim(own, "Value"), spec.fields)
        if spec.type_name not in self._named:
            claimed = self.claim(type_name(spec.type_name), "Type")
            self._named[spec.type_name] = self.struct(claimed, spec.fields)
        return self._named[spec.type_name]

    def _values(self, own: str, base: str, spec: Field, values: Iterable[tuple[str, int]]) -> str:
        claimed = self.claim(own, "Value")
        literal = str if base == "IntEnum" else lambda value: hex_literal(value, (spec.width + 7) // 8).rstrip("UL")
        members = [(code_name(name).upper(), literal(value)) for name, value in values]
        self.blocks.append(ValuesBlock(claimed, base, _docstring(comment_text(spec.description)), members))
        return claimed


def _plain_type(spec: Field) -> str:
    if spec.value_type is bool:
        return "bool"
    if spec.is_string:
        return "str" if spec.value_type is str else "bytes"
    return "float" if spec.is_float or spec.is_scaled else "int"


def _comment(spec: Field) -> str:
    return _docstring(member_comment(replace(spec, flags=())))  # its type shows the flags


def _default(spec: Field, kind: str, inner: StructBlock | None) -> str:
    """Return the value of an omitted field, as in the engine's `encode`; empty if it must be given."""
    if spec.is_string:
        empty: Default = "" if spec.value_type is str else b""
        given = empty if spec.default is None else spec.default
        return _string(given) if isinstance(given, str) else repr(given)
    if isinstance(spec.default, tuple):
        items = [_one(spec, kind, one) for one in spec.default]
        return f"({', '.join(items)}{',' if len(items) == 1 else ''})"
    if spec.is_list:
        return ""
    if inner is not None:
        one = f"{inner.name}()" if inner.has_defaults else ""
        return f"({one},) * {spec.count}" if one and spec.count is not None else one
    return "" if spec.default is None else _one(spec, kind, spec.default)


def _one(spec: Field, kind: str, default: Default) -> str:
    if spec.enum:
        by_value: Mapping[int, str] = {value: name for name, value in reversed(spec.enum)}
        name = default if isinstance(default, str) else by_value.get(int(default))  # type: ignore[arg-type]
        return f"{kind}.{code_name(str(name)).upper()}" if name is not None else repr(default)
    if spec.flags:
        return f"{kind}({default!r})"
    if spec.value_type is bool:
        return repr(bool(default))
    number = default if isinstance(default, int | float) else 0
    return repr(float(number) if _plain_type(spec) == "float" else int(number))
