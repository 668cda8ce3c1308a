"""Another program of the ROS 2 network, in the test's process. Its bytes are those of rosbags, not the bridge's own."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from cyclonedds._clayer import ddspy_take, ddspy_write
from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from rosbags.typesys import Stores, get_typestore

from wirebond.ros2.idl import idl_type
from wirebond.ros2.types import ros_type

STORE = get_typestore(Stores.ROS2_JAZZY)
PATIENCE = 20.0  # seconds: a bound for slow machines, not an expectation
_ANY = 0x7F


class Peer:
    """Takes and gives messages of topics, as objects of rosbags."""

    def __init__(self, domain: int) -> None:
        self._participant = DomainParticipant(domain)
        self._topics: dict[str, tuple[Topic[Any], str]] = {}
        self._readers: dict[str, DataReader[Any]] = {}
        self._writers: dict[str, DataWriter[Any]] = {}
        self.seen: dict[str, list[Any]] = {}
        self.publications = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication)
        self.subscriptions = BuiltinDataReader(self._participant, BuiltinTopicDcpsSubscription)

    def listen(self, topic: str, type_name: str, latched: bool = False, raw: str = "") -> None:
        """Hear this topic from now on. ``raw``: its name in DDS, where that is no topic of ROS."""
        reliable = Policy.Reliability.Reliable(duration(seconds=1))
        durability = Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile
        qos = Qos(reliable, durability, Policy.History.KeepLast(1000))
        self._readers[topic] = DataReader(self._participant, self._topic(topic, type_name, raw), qos)
        self.seen[topic] = []

    def advertise(self, topic: str, type_name: str, reliable: bool = True) -> None:
        """Be a publisher of this topic, and wait until the bridge has found it, and it the bridge."""
        policy = Policy.Reliability.Reliable(duration(seconds=1)) if reliable else Policy.Reliability.BestEffort
        self._writers[topic] = DataWriter(self._participant, self._topic(topic, type_name), Qos(policy))

    def is_heard(self, topic: str) -> bool:
        """Has the publisher a subscriber?"""
        return bool(self._writers[topic].get_matched_subscriptions())

    def publish(self, topic: str, message: Any) -> None:
        """One message."""
        data = bytes(STORE.serialize_cdr(message, self._topics[topic][1]))
        assert ddspy_write(self._writers[topic]._ref, data + bytes(-len(data) % 4)) == 0

    def look(self) -> None:
        """Take what has come."""
        for topic, reader in self._readers.items():
            for data, info in ddspy_take(reader._ref, _ANY, 1000):
                if info.valid_data:
                    self.seen[topic].append(STORE.deserialize_cdr(data, self._topics[topic][1]))

    def wait(self, what: Callable[[], Any]) -> Any:
        """Look until this is true; what it gave."""
        end = time.monotonic() + PATIENCE
        while True:
            self.look()
            found = what()
            if found:
                return found
            assert time.monotonic() < end, {topic: len(seen) for topic, seen in self.seen.items()}
            time.sleep(0.01)

    def next(self, topic: str) -> Any:
        """The next message of this topic that comes after this call."""
        self.look()
        count = len(self.seen[topic])
        self.wait(lambda: len(self.seen[topic]) > count)
        return self.seen[topic][count]

    def _topic(self, topic: str, type_name: str, raw: str = "") -> Topic[Any]:
        type_ = ros_type(type_name)
        assert type_ is not None
        if topic not in self._topics:
            made = Topic(self._participant, raw or f"rt{topic}", idl_type(type_))
            self._topics[topic] = made, type_.name
        return self._topics[topic][0]


def message(type_name: str, *values: Any) -> Any:
    """An object of rosbags, by the values of its fields in their order."""
    package, name = type_name.split("/")
    return STORE.types[f"{package}/msg/{name}"](*values)


def twist(linear: float, angular: float) -> Any:
    """A command of a robot with two driven wheels."""
    vector = "geometry_msgs/Vector3"
    return message("geometry_msgs/Twist", message(vector, linear, 0.0, 0.0), message(vector, 0.0, 0.0, angular))
