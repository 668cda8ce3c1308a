"""The interface of the bridge to ROS 2: a node that publishes, subscribes, has parameters and logs. Two adapters
implement it.

Messages are dicts by field name, nested as their type is; a field that is left out has its default.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from wirebond.ros2.failure import Failure
from wirebond.ros2.stalls import Stalls
from wirebond.ros2.types import RosType, ServiceType

TOPIC = re.compile(r"(/|~/)?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
NAMESPACE = re.compile(r"/|(/[A-Za-z_][A-Za-z0-9_]*)+")


@dataclass(frozen=True)
class Qos:
    """The quality of service of one topic.

    :ivar reliable: what is lost on the network is sent again.
    :ivar latched: a subscriber that comes late gets the last messages (``transient_local``).
    :ivar depth: how many messages are kept.
    """

    reliable: bool = True
    latched: bool = False
    depth: int = 10


LATCHED = Qos(latched=True, depth=1)


@dataclass(frozen=True)
class Parameter:
    """A number that may be set while the bridge runs: of the mapping, or of the MCU.

    :ivar minimum, maximum: None: there is no bound.
    :ivar set: takes the new value. A WirebondError says why it does not.
    """

    name: str
    value: float
    minimum: float | None
    maximum: float | None
    description: str
    set: Callable[[float], None]


class Publisher(Protocol):
    """A topic that the node publishes. Any thread."""

    def publish(self, values: Mapping[str, Any]) -> None:
        """Send one message. What the values cannot be is the caller's mistake."""
        ...

    def publish_encoded(self, messages: Iterable[bytes]) -> None:
        """Send messages that `cdr` has encoded: several cost less than each alone."""
        ...


class Quick(Protocol):
    """Takes messages as they came, which costs a fraction. One thread at a time."""

    def take(self, messages: list[bytes], first: int) -> int:
        """Take these messages from the index ``first`` on; they may wait for ``flush``. How many were taken: the next
        one is for ``take`` of the subscription, before those that follow it."""
        ...

    def flush(self) -> None:
        """Note that no more messages have come for the moment."""
        ...


# Makes the response of a service's request: fields by name, as those of messages.
Answer = Callable[[dict[str, Any]], dict[str, Any]]


class Node(Protocol):
    """A node of ROS 2. Functions that it calls run in one thread of its own; only those of services do not.

    :ivar undecodable: received messages that were not a message of their type, by topic.
    :ivar failure: makes the threads of the node and of its bridge, and knows whether one of them has ended by a fault.
        Then the program that runs the bridge must end, with an error.
    :ivar stalls: whether messages that are taken now may be old.
    """

    undecodable: Counter[str]
    failure: Failure
    stalls: Stalls

    def publisher(self, topic: str, type_: RosType, qos: Qos) -> Publisher:
        """Publish this topic, whose name is whole."""
        ...

    def subscribe(
        self,
        topic: str,
        type_: RosType,
        qos: Qos,
        take: Callable[[dict[str, Any]], None],
        quick: Quick | None = None,
    ) -> None:
        """Call ``take`` with each message of this topic, whose name is whole. An adapter that has messages as bytes
        asks ``quick`` first."""
        ...

    def serve(self, service: str, type_: ServiceType, answer: Answer) -> None:
        """Offer this service, whose name is whole. Before ``start``. ``answer`` may wait: it runs in a thread that
        holds nothing else up, several at once. An adapter that cannot offer it says so in the log."""
        ...

    def declare(self, parameter: Parameter) -> None:
        """Let users of ROS 2 see this parameter, and set it where the adapter can."""
        ...

    def update(self, name: str, value: float) -> None:
        """Note that a declared parameter has this value now; its ``set`` is not called."""
        ...

    def canceller(self, action: str) -> Callable[[], None]:
        """Return a function that cancels all goals of this action, whose name is whole, where the adapter can. Before
        ``start``; it does not wait, and does nothing if there is no such action."""
        ...

    def log(self, level: str, text: str) -> None:
        """Write a line to the node's log. ``level`` is one of ``LEVELS``."""
        ...

    def now_ns(self) -> int:
        """Return the time of ROS, in nanoseconds."""
        ...

    def start(self) -> None:
        """Start: all topics exist. Become visible to others, and begin to call."""
        ...

    def close(self) -> None:
        """Leave. Nothing is called after this. A second call does nothing."""
        ...


LEVELS = {"debug": 10, "info": 20, "warning": 30, "error": 40}


def mismatch(topic: str, policy: str, *, is_publisher: bool) -> str:
    """Return the sentence for another node whose quality of service keeps it from this publisher or subscriber."""
    who = (
        f"a subscriber of {topic} asks for more than is offered"
        if is_publisher
        else f"a publisher of {topic} offers less than is asked for"
    )
    return f"{who} ({policy}): they exchange nothing; give both the same `qos`"


def type_mismatch(topic: str, theirs: str, own: str, *, is_publisher: bool) -> str:
    """Return the sentence for another node that has another type on a topic; ``is_publisher``: of this node's
    publisher."""
    who = (
        f"a subscriber of {topic} expects {theirs}, and {own} is published"
        if is_publisher
        else f"a publisher of {topic} sends {theirs}, and {own} is expected"
    )
    return f"{who}: they exchange nothing; give both the same `type`"


def whole_topic(topic: str, namespace: str, node: str) -> str:
    """Return the full name of a topic: ``cmd_vel`` in its namespace, ``~/status`` below the node, ``/odom`` as it
    is."""
    if topic.startswith("/"):
        return topic
    base = namespace.rstrip("/")
    return f"{base}/{node}/{topic[2:]}" if topic.startswith("~/") else f"{base}/{topic}"
