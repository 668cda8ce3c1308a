"""The content of a mapping file, resolved and compared with the protocol and the types of ROS 2."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from wirebond.protocol.model import Message
from wirebond.ros2.mapping.packing import PackPlan
from wirebond.ros2.mapping.paths import Getter
from wirebond.ros2.mapping.unpacking import UnpackPlan
from wirebond.ros2.node import Qos
from wirebond.ros2.types import RosType, ServiceType

HEADER_KEY = ""  # under which a filler finds the frame's own fields: no field of a message has this name
# Fields of the message and the stamp, as builtin_interfaces/Time: the topic's message.
Filler = Callable[[Mapping[str, Any], Mapping[str, int]], dict[str, Any]]


@dataclass(frozen=True)
class Outgoing:
    """A message of the MCU that becomes a topic.

    :ivar every: the least time between two of them, in seconds.
    :ivar plan: what the engine needs to do what ``fill`` does, straight to bytes; None: a value that changes has no
        fixed size.
    :ivar reads_header: ``fill`` finds the frame's own fields under `HEADER_KEY`.
    """

    message: str
    topic: str
    type: RosType
    qos: Qos
    every: float
    fill: Filler
    plan: PackPlan | None = None
    reads_header: bool = False


@dataclass(frozen=True)
class Incoming:
    """A topic that becomes a message of the host.

    :ivar values: the message's fields, read from the topic's message. A getter raises LookupError where a sequence is
        too short.
    :ivar stale: seconds that a command is repeated for; None: it is sent once.
    :ivar plan: what the engine needs to make the frame of the topic's bytes; None: a value is neither number nor text.
    """

    topic: str
    type: RosType
    message: str
    qos: Qos
    values: tuple[tuple[str, Getter], ...]
    stale: float | None
    plan: UnpackPlan | None = None


@dataclass(frozen=True)
class ServiceMapping:
    """A service whose call sends a message, or ends a deadline.

    :ivar message: of the host; empty: the deadline of ``recover`` ends.
    :ivar values: the message's fields, read from the request.
    :ivar has_reply: the message is a request.
    :ivar timeout: seconds that its reply may take.
    :ivar answer: fills the response from the reply; None: any reply is a success.
    """

    service: str
    type: ServiceType
    message: str
    values: tuple[tuple[str, Getter], ...] = ()
    has_reply: bool = False
    timeout: float = 1.0
    answer: Filler | None = None
    recover: str = ""


@dataclass
class Wheels:
    """The numbers of a robot with two driven wheels, in metres and ticks. They may change while the bridge runs."""

    radius: float
    separation: float
    ticks_per_turn: float


@dataclass(frozen=True)
class OdometryMapping:
    """How ticks become a pose."""

    message: str
    left: str
    right: str
    wheels: Wheels
    frame: str
    child_frame: str
    topic: str
    tf: bool
    reset: str | None
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
    """The deadline that stops navigation, the topic that says so, and the actions whose goals are cancelled."""

    deadline: str
    topic: str
    cancel: tuple[str, ...] = ()


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
    services: tuple[ServiceMapping, ...] = ()
    odometry: OdometryMapping | None = None
    poll: tuple[str, ...] = ()
    diagnostics: tuple[FlagsMapping, ...] = ()
    navigation: NavigationMapping | None = None
    emergency_stop: str | None = None
    recover: str = "~/recover"
    latency: str | None = None
    path: str = field(default="", compare=False)
