"""The ROS 2 form of a protocol's messages: names, types, constants, comments. No file, no bytes."""

from __future__ import annotations

import json
import keyword
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

from wirebond.generate.code.cpp import message_comment
from wirebond.generate.code.cpp_field import comment_text, member_comment
from wirebond.protocol.model import Default, End, Field, Message, Protocol
from wirebond.protocol.model.forms import header_fields
from wirebond.protocol.names import code_name, identifier, type_name

HEADER = "std_msgs/Header"
STAMPED = "header"  # the member with the stamp, of messages from the MCU
FRAME = "frame_header"  # the member with the frame's own fields

# The first words of packages that every ROS 2 has: `sensor` would be sensor_msgs.
_TAKEN_PACKAGES = frozenset(
    (  # noqa: SIM905  (as text it stays a table)
        "action actionlib actuator control diagnostic geographic geometry lifecycle map nav nav2 pcl rosgraph sensor "
        "shape statistics std stereo test tf2 trajectory unique_identifier vision visualization"
    ).split()
)
# Words of IDL, through which rosidl takes every message, and members of rosidl's classes in Python.
_RESERVED = frozenset(
    (  # noqa: SIM905  (as text it stays a table)
        "abstract any attribute boolean component context exception factory fixed get_fields_and_field_types in inout "
        "interface module native octet oneway out raises readonly sequence string supports wchar wstring"
    ).split()
)
_TAKEN_TYPES = frozenset({"none", "true", "false", "header"})  # words of Python; `Header` is std_msgs/Header to some
_C_KEYWORDS = frozenset({"restrict", "typeof"})
_SIZES = (8, 16, 32, 64)


@dataclass(frozen=True)
class Constant:
    """A number with a name: of an enum, or a flag's bit."""

    type: str
    name: str
    value: int


@dataclass(frozen=True)
class Member:
    """A field of a message type.

    :ivar type: of one element, as a .msg file writes it: ``float64``, ``std_msgs/Header``, ``WheelState``.
    :ivar count: of an array: its elements; None: a sequence. 0: one value.
    :ivar spec: the protocol's field; None: `STAMPED`, or `FRAME`.
    :ivar of: the type of an element that has fields of its own.
    :ivar default: as a .msg file writes it; empty: the default of ROS, which is 0.
    """

    type: str
    name: str
    count: int | None = 0
    spec: Field | None = None
    of: Definition | None = None
    default: str = ""
    comment: str = ""
    constants: tuple[Constant, ...] = ()

    @property
    def spelled(self) -> str:
        """Its type as a .msg file writes it."""
        return self.type + ("[]" if self.count is None else f"[{self.count}]" if self.count else "")


@dataclass(frozen=True)
class Definition:
    """A message type.

    :ivar comment: what it is, in one line.
    """

    name: str
    comment: str
    members: tuple[Member, ...]

    @property
    def text(self) -> str:
        """Return the text of its .msg file."""
        lines = [f"# {self.comment}"] if self.comment else []
        for member in self.members:
            lines += [""] if lines else []
            lines += [f"# {member.comment}"] if member.comment else []
            lines += [f"{one.type} {one.name}={one.value}" for one in member.constants]
            lines.append(f"{member.spelled} {member.name}{f' {member.default}' if member.default else ''}")
        return "".join(f"{line}\n" for line in lines)


@dataclass
class Interfaces:
    """The message types of one protocol, which are one package.

    :ivar definitions: all of them, those that a definition needs before it.
    :ivar messages: the definition of each message, by the message's name.
    """

    package: str
    definitions: list[Definition] = field(default_factory=list)
    messages: dict[str, Definition] = field(default_factory=dict)


def interfaces(protocol: Protocol) -> Interfaces:
    """Return the message types of this protocol."""
    return _Writer(protocol).found


def package_name(protocol: Protocol) -> str:
    """Return the package's name: ``diffdrive_msgs``. It hides no package of ROS 2: ``sensor`` gives
    ``sensor_link_msgs``."""
    base = protocol.name.removesuffix("_msgs")
    return f"{base}_link_msgs" if base in _TAKEN_PACKAGES else f"{base}_msgs"


def field_name(name: str) -> str:
    """Return the name of a field in ROS: lower case, not a keyword, no underscore at the end."""
    found = code_name(name)
    is_taken = identifier(found) != found or keyword.iskeyword(found) or found in _RESERVED | _C_KEYWORDS
    return f"{found}_value" if is_taken else found


class _Names:
    """Hands out each name once. Names of types are apart also in lower case, for files are named after them."""

    def __init__(self, taken: Iterable[str] = ()) -> None:
        self._taken = set(taken)

    def claim(self, name: str, suffix: str) -> str:
        candidate, number = name, 1
        while candidate.lower() in self._taken:
            candidate = f"{name}{suffix}{number if number > 1 else ''}"
            number += 1
        self._taken.add(candidate.lower())
        return candidate


class _Writer:
    """Collects definitions, those that a definition needs before it."""

    def __init__(self, protocol: Protocol) -> None:
        self.found = Interfaces(package_name(protocol))
        self._names = _Names(_TAKEN_TYPES)
        self._named: dict[str, Definition] = {}  # the file's types
        claimed = [self._names.claim(type_name(m.name), "Message") for m in protocol.messages]
        header = [one.value for one in header_fields(protocol.format.parts)]
        frame = self._definition("FrameHeader", "The fields of the frame itself.", header) if header else None
        for message, name in zip(protocol.messages, claimed, strict=True):
            self.found.messages[message.name] = self._message(message, name, frame)

    def _message(self, message: Message, name: str, frame: Definition | None) -> Definition:
        before: list[Member] = []
        if message.sent_by(End.MCU):
            before.append(Member(HEADER, STAMPED, comment="When it came, or when the MCU measured it."))
            if frame is not None:
                before.append(Member(frame.name, FRAME, of=frame))
        has_defaults = message.sent_by(End.HOST)
        return self._add(name, message_comment(message), message.fields, before, has_defaults=has_defaults)

    def _definition(self, name: str, comment: str, fields: Iterable[Field]) -> Definition:
        return self._add(self._names.claim(name, "Value"), comment, fields)

    def _add(
        self,
        name: str,
        comment: str,
        fields: Iterable[Field],
        before: Iterable[Member] = (),
        *,
        has_defaults: bool = False,
    ) -> Definition:
        members = [*before]
        names, constants = _Names(one.name for one in members), _Names()
        for spec in fields:
            if not spec.has_value or spec.is_count or spec.only_counts:
                continue
            own = names.claim(field_name(spec.name), "_value")
            member = self._member(name, own, spec, constants)
            members.append(replace(member, default=_default(spec) if has_defaults else ""))
        definition = Definition(name, comment, tuple(members))
        self.found.definitions.append(definition)
        return definition

    def _member(self, owner: str, name: str, spec: Field, names: _Names) -> Member:
        comment = member_comment(replace(spec, flags=()))
        count = None if spec.is_list else spec.count or 0
        if spec.fields:
            of = self._struct(owner, spec)
            return Member(of.name, name, count, spec, of, comment=comment)
        if spec.value_type is bytes:
            return Member("uint8", name, spec.size or None, spec, comment=comment)
        type_ = _type_of(spec)
        values = [*spec.enum, *((flag, 1 << bit) for flag, bit in spec.flags)]
        constants = tuple(
            Constant(type_, names.claim(f"{code_name(spec.name)}_{code_name(key)}".upper(), "_2"), value)
            for key, value in values
        )
        if spec.flags:
            comment = comment_text(f"{comment}{'' if comment.endswith('.') or not comment else '.'} Bits:".strip())
        return Member(type_, name, count, spec, comment=comment, constants=constants)

    def _struct(self, owner: str, spec: Field) -> Definition:
        if not spec.type_name:
            return self._definition(owner + type_name(spec.name), "", spec.fields)
        if spec.type_name not in self._named:
            self._named[spec.type_name] = self._definition(type_name(spec.type_name), "", spec.fields)
        return self._named[spec.type_name]


def _type_of(spec: Field) -> str:
    if spec.value_type is bool:
        return "bool"
    if spec.value_type is str:
        return "string"
    if spec.is_float or spec.is_scaled:
        return "float32" if spec.is_float and spec.float_format.cpp == "float" and not spec.is_scaled else "float64"
    size = next(size for size in _SIZES if size >= spec.width)
    return f"{'' if spec.coding.is_signed else 'u'}int{size}"


def _default(spec: Field) -> str:
    """Return the default of a field, where it is not that of ROS."""
    if spec.default is None or spec.fields or spec.value_type is bytes:
        return ""
    if isinstance(spec.default, tuple):
        found = [_one(spec, one) for one in spec.default]
        return f"[{', '.join(found)}]" if any(one not in _ZERO for one in found) else ""
    one = _one(spec, spec.default)
    if one in _ZERO or spec.is_list:
        return ""
    return f"[{', '.join([one] * spec.count)}]" if spec.count else one


_ZERO = ("0", "0.0", "false", '""')


def _one(spec: Field, default: Default) -> str:
    if isinstance(default, str):
        return json.dumps(default, ensure_ascii=False) if spec.value_type is str else str(dict(spec.enum)[default])
    if spec.value_type is bool:
        return "true" if default else "false"
    is_real = spec.is_float or spec.is_scaled
    return repr(float(default) if is_real else int(default))  # type: ignore[arg-type]
