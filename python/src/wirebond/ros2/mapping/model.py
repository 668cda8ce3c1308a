"""What a mapping file says, looked up and compared with the protocol and the types of ROS 2."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from wirebond.protocol.model import Message
from wirebond.ros2.mapping.paths import Getter
from wirebond.ros2.node import Qos
from wirebond.ros2.types import RosType

# Fields of the message and the stamp, as builtin_interfaces/Time: the topic's message.
Filler = Callable[[Mapping[str, Any], Mapping[str, int]], dict[str, Any]]
# As a filler, and gives the message's bytes.
Packer = Callable[[Mapping[str, Any], Mapping[str, int]], bytes]


@dataclass(frozen=True)
class Outgoing:
    """A message of the MCU that becomes a topic.

    :ivar every: the least time between two of them, in seconds.
    :ivar pack: does what ``fill`` does and gives bytes, at a fifth of the cost; None: a value that changes has no
        fixed size.
    """

    message: str
    topic: str
    type: RosType
    qos: Qos
    every: float
    fill: Filler
    pack: Packer | None = None


@dataclass(frozen=True)
class Incoming:
    """A topic that becomes a message of the host.

    :ivar values: the message's fields, read from the topic's message. A getter raises LookupError where a sequence is
        too short.
    :ivar stale: seconds that a command is repeated for; None: it is sent once.
    """

    topic: str
    type: RosType
    message: str
    qos: Qos
    values: tuple[tuple[str, Getter], ...]
    stale: float | None


@dataclass
class Wheels:
    """The numbers of a robot with two driven wheels, in metres and ticks. They may change while the bridge runs."""

    radius: float
    separation: float
    ticks_per_turn: float


@dataclass(frozen=True)
class OdometryMapping:
    """From ticks to a pose."""

    message: str
    left: str
    right: str
    wheels: Wheels
    frame: str
    child_frame: str
    topic: str
    tf: bool
    joints: tuple[str, ...]
    pose_deviation: tuple[float, ...]  # x, y, heading
    twist_deviation: tuple[float, ...]  # speed, turn rate


@dataclass(frozen=True)
class FlagsMapping:
    """Flags that /diagnostics names, with what each means."""

    message: str
    field: str
    words: dict[str, str]


@dataclass(frozen=True)
class NavigationMapping:
    """The deadline that stops navigation, and the topic that says so."""

    deadline: str
    topic: str


@dataclass(frozen=True)
class BridgeMapping:
    """A whole mapping. Topics are as the file writes them."""

    node: str
    namespace: str = "/"
    json_out: tuple[Message, ...] = ()
    json_in: tuple[Message, ...] = ()
    serial: bool = False
    publish: tuple[Outgoing, ...] = ()
    subscribe: tuple[Incoming, ...] = ()
    odometry: OdometryMapping | None = None
    poll: tuple[str, ...] = ()
    diagnostics: tuple[FlagsMapping, ...] = ()
    navigation: NavigationMapping | None = None
    emergency_stop: str | None = None
    path: str = field(default="", compare=False)
