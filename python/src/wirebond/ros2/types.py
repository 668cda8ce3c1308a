"""The message and service types of ROS 2: fields, constants, hashes. No bytes, no DDS, no protocol."""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any

from wirebond.errors import UsageError

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

MISSING = (
    "ROS 2 needs the packages rosbags and cyclonedds; install them with: "
    "pip install cyclonedds==11.0.1 'rosbags>=0.11.9,<0.12'"
)


class Kind(StrEnum):
    """How often a field's element occurs."""

    ONE = "one"
    ARRAY = "array"  # always ``count`` times
    SEQUENCE = "sequence"


@dataclass(frozen=True)
class RosField:
    """A field of a message type.

    :ivar base: the primitive type of its element, such as ``float64``; empty where the element is a message.
    :ivar of: the type of the element where it is a message.
    :ivar limit: of a string or a sequence: the most that it holds; 0: no limit.
    """

    name: str
    kind: Kind
    base: str
    of: RosType | None
    count: int = 0
    limit: int = 0

    @property
    def spelled(self) -> str:
        """The type in a .msg file's notation: ``float64[36]``, ``geometry_msgs/Point``."""
        element = self.base or (self.of.short if self.of is not None else "")
        return element + {Kind.ONE: "", Kind.ARRAY: f"[{self.count}]", Kind.SEQUENCE: "[]"}[self.kind]


@dataclass(frozen=True, eq=False)
class RosType:
    """A message type. ``name`` has three parts: ``geometry_msgs/msg/Twist``.

    :ivar store: of rosbags, which has it.
    """

    name: str
    fields: tuple[RosField, ...]
    constants: dict[str, Any]
    store: Typestore = field(repr=False)

    @property
    def short(self) -> str:
        """The name as people write it: ``geometry_msgs/Twist``."""
        package, _, name = self.name.split("/")
        return f"{package}/{name}"

    @property
    def dds_name(self) -> str:
        """The name in DDS: ``geometry_msgs::msg::dds_::Twist_``."""
        package, room, name = self.name.split("/")
        return f"{package}::{room}::dds_::{name}_"

    def field(self, name: str) -> RosField | None:
        """Return the field of this name."""
        return self._by_name.get(name)

    @cached_property
    def _by_name(self) -> dict[str, RosField]:
        return {field.name: field for field in self.fields}

    @cached_property
    def hash(self) -> str:
        """Its RIHS01 hash, by which ROS 2 compares types. ROS 2 hashes ``char`` as ``uint8``, and rosbags does not."""
        hashed = copy(self.store)
        hashed.fielddefs = {
            name: (constants, [(field, _without_char(described)) for field, described in fields])
            for name, (constants, fields) in self.store.fielddefs.items()
        }
        return hashed.hash_rihs01(self.name)

    @property
    def is_generated(self) -> bool:
        """Is it of a package that `wirebond gen --lang ros2` writes, and none of ROS 2?"""
        return self.store is not _store()

    @cached_property
    def definition(self) -> str:
        """The text of its .msg file, with those of the types that it needs, as recordings have them."""
        return self.store.generate_msgdef(self.name, ros_version=2)[0]


@dataclass(frozen=True, eq=False)
class ServiceType:
    """A service type. ``name`` is as people write it: ``std_srvs/Trigger``."""

    name: str
    request: RosType
    response: RosType


# Services by the texts of request and response. rosidl gives an empty message a field.
_NOTHING = "uint8 structure_needs_at_least_one_member"
_OUTCOME = "bool success\nstring message"
_SERVICES = {
    "std_srvs/Empty": (_NOTHING, _NOTHING),
    "std_srvs/SetBool": ("bool data", _OUTCOME),
    "std_srvs/Trigger": (_NOTHING, _OUTCOME),
    "action_msgs/CancelGoal": (
        "action_msgs/GoalInfo goal_info",
        "int8 return_code\naction_msgs/GoalInfo[] goals_canceling",
    ),
}
SERVICE_NAMES = tuple(name for name in _SERVICES if name.startswith("std_srvs/"))  # that a mapping may use


# Fields that a new message does not begin with zero in.
DEFAULTS: dict[str, dict[str, Any]] = {"geometry_msgs/msg/Quaternion": {"w": 1.0}}
RANGES: dict[str, tuple[float, float]] = {
    **{f"int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f"uint{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)},
    "char": (0, 255),
    "byte": (0, 255),
    **dict.fromkeys(("float32", "float64"), (-math.inf, math.inf)),
}


def ros_type(name: str) -> RosType | None:
    """Return the type of this name, of two parts or three; None where ROS 2 has none.

    :raises UsageError: the package rosbags is not installed.
    """
    parts = name.split("/")
    return _type(f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else name)


def type_names() -> list[str]:
    """Return every known type, as people write it."""
    return sorted(_short(name) for name in _store().fielddefs if "/msg/" in name)


def _short(name: str) -> str:
    package, _, last = name.split("/")
    return f"{package}/{last}"


@cache
def service_type(name: str) -> ServiceType | None:
    """Return the service type of this name, of two parts or three; None where it is not known.

    :raises UsageError: the package rosbags is not installed.
    """
    short = name.replace("/srv/", "/")
    if short not in _SERVICES:
        return None
    whole = short.replace("/", "/srv/")
    names = [f"{whole}_Request", f"{whole}_Response"]
    found = types_from(dict(zip(names, _SERVICES[short], strict=True)))
    return ServiceType(short, *(found[one] for one in names))


def types_from(definitions: Mapping[str, str]) -> dict[str, RosType]:
    """Return the types of these texts, as .msg files have them, by their names of three parts. They may use each other,
    and those of ROS 2.

    :raises UsageError: the package rosbags is not installed.
    """
    store = _new_store()
    from rosbags.typesys import get_types_from_msg  # noqa: PLC0415 an extra: most installations lack it

    parsed: dict[str, Any] = {}
    for name, text in definitions.items():
        (parsed[name],) = get_types_from_msg(text, name).values()  # under another name where it is part of a service
    store.register(parsed)
    found: dict[str, RosType] = {}
    for name in definitions:
        _made(name, store, found)
    return found


@cache
def _store() -> Typestore:
    return _new_store()


def _new_store() -> Typestore:
    try:
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415 an extra: most installations lack it
    except ImportError:
        raise UsageError(MISSING) from None
    return get_typestore(Stores.ROS2_JAZZY)


@cache
def _type(name: str) -> RosType | None:
    return _made(name, _store(), {}) if name in _store().fielddefs else None


def _made(name: str, store: Typestore, own: dict[str, RosType]) -> RosType:
    """Make a type. ``own``: those that only this store has; the new one is added."""
    if name in own:
        return own[name]
    constants, fields = store.fielddefs[name]
    made = RosType(
        name,
        tuple(_field(*one, store, own) for one in fields),
        {constant: value for constant, _, value in constants},
        store,
    )
    own[name] = made
    return made


def _without_char(described: Any) -> Any:
    """Return the description of a field by rosbags, with ``uint8`` instead of ``char``."""
    if isinstance(described, tuple):
        return tuple(_without_char(part) for part in described)
    return "uint8" if described == "char" else described


def _field(name: str, described: Any, store: Typestore, own: dict[str, RosType]) -> RosField:
    kind, facts = described
    if kind.name in ("ARRAY", "SEQUENCE"):
        element, amount = facts
        one = _field(name, element, store, own)
        is_array = kind.name == "ARRAY"
        shape = Kind.ARRAY if is_array else Kind.SEQUENCE
        return RosField(name, shape, one.base, one.of, amount if is_array else 0, 0 if is_array else amount)
    if kind.name == "NAME":
        return RosField(name, Kind.ONE, "", _type(facts) or _made(facts, store, own))
    base, limit = facts
    return RosField(name, Kind.ONE, base, None, limit=limit)
