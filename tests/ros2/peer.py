"""Another program of the ROS 2 network, in the test's process. Its bytes are those of rosbags, not the bridge's own."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
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

from tests.waiting import let_pass, moments, rounds_for
from wirebond.ros2.dds_services import any_bytes
from wirebond.ros2.idl import idl_type
from wirebond.ros2.types import RosType, ServiceType, ros_type, service_type

STORE = get_typestore(Stores.ROS2_JAZZY)
_ANY = 0x7F
_CLIENT = 0x1122334455667788  # as a program over rmw_cyclonedds calls itself


class Peer:
    """Takes and gives messages of topics, as objects of rosbags."""

    def __init__(self, domain: int, generated: Mapping[str, RosType] | None = None) -> None:
        """``generated``: types that ROS does not have, by their short names."""
        self._generated = generated or {}
        self._participant = DomainParticipant(domain)
        self._topics: dict[str, tuple[Topic[Any], RosType]] = {}
        self._readers: dict[str, DataReader[Any]] = {}
        self._writers: dict[str, DataWriter[Any]] = {}
        self.seen: dict[str, list[Any]] = {}
        self.publications = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication)
        self.subscriptions = BuiltinDataReader(self._participant, BuiltinTopicDcpsSubscription)

    def listen(self, topic: str, type_name: str, latched: bool = False, raw: str = "") -> None:
        """Hear this topic from now on. ``raw``: its name in DDS, where that is not a topic of ROS."""
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

    def is_advertised(self, topic: str) -> bool:
        return topic in self._writers

    def publish(self, topic: str, message: Any) -> None:
        """One message."""
        type_ = self._topics[topic][1]
        data = bytes(type_.store.serialize_cdr(message, type_.name))
        assert ddspy_write(self._writers[topic]._ref, data + bytes(-len(data) % 4)) == 0

    def serve_calls(self, service: str, type_name: str) -> Calls:
        """Be a caller of this service, as a program over rmw_cyclonedds is."""
        type_ = service_type(type_name)
        assert type_ is not None
        return Calls(self._participant, service, type_)

    def look(self) -> None:
        """Take what has come."""
        for topic, reader in self._readers.items():
            for data, info in ddspy_take(reader._ref, _ANY, 1000):
                if info.valid_data:
                    type_ = self._topics[topic][1]
                    self.seen[topic].append(type_.store.deserialize_cdr(data, type_.name))

    def wait(self, what: Callable[[], Any]) -> Any:
        """Look until this is true; what it gave."""

        def look() -> Any:
            self.look()
            return what()

        def told() -> str:
            counts = {topic: len(seen) for topic, seen in self.seen.items()}
            return (
                f"what is wanted; seen: {counts}; last said: {[line.msg for line in self.seen.get('/rosout', [])][-5:]}"
            )

        return wait(look, told)

    def next(self, topic: str) -> Any:
        """The next message of this topic that comes after this call."""
        self.look()
        count = len(self.seen[topic])
        self.wait(lambda: len(self.seen[topic]) > count)
        return self.seen[topic][count]

    def _topic(self, topic: str, type_name: str, raw: str = "") -> Topic[Any]:
        type_ = self._generated.get(type_name) or ros_type(type_name)
        assert type_ is not None
        if topic not in self._topics:
            made = Topic(self._participant, raw or f"rt{topic}", idl_type(type_))
            self._topics[topic] = made, type_
        return self._topics[topic][0]


def wait(what: Callable[[], Any], about: object = "it") -> Any:
    """Until this is true; what it gave. ``about``: as in `moments`."""
    for _ in moments(about):
        if found := what():
            return found
    raise AssertionError


class Calls:
    """Calls one service in the bytes of rmw_cyclonedds: a header, and the request."""

    def __init__(self, participant: DomainParticipant, service: str, type_: ServiceType) -> None:
        user_data = Policy.Userdata(b"clientid=1.2.3;")
        qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(10), user_data)
        requests = Topic(participant, f"rq{service}Request", any_bytes(type_.request))
        responses = Topic(participant, f"rr{service}Reply", any_bytes(type_.response))
        self._requests: DataWriter[Any] = DataWriter(participant, requests, qos)
        self._responses: DataReader[Any] = DataReader(participant, responses, qos)
        self._type = type_
        self._number = 0

    def is_offered(self) -> bool:
        """As rmw_cyclonedds asks: is there a reader of requests and a writer of responses with one ``serviceid``?"""
        writer, reader = self._requests, self._responses
        readers = [writer.get_matched_subscription_data(one) for one in writer.get_matched_subscriptions()]
        writers = [reader.get_matched_publication_data(one) for one in reader.get_matched_publications()]
        return bool({_service_id(one) for one in readers} & {_service_id(one) for one in writers})

    def call(self, request: bytes, header: bool = True) -> tuple[bool, str] | None:
        """``request``: its bytes in CDR. Without a header no response is expected; None: none came."""
        self._number += 1
        numbers = struct.pack("<Qq", _CLIENT, self._number) if header else b""
        data = request[:4] + numbers + request[4:]
        assert ddspy_write(self._requests._ref, data + bytes(-len(data) % 4)) == 0
        for _ in moments("a response") if header else rounds_for(0.3):
            for answer, _ in ddspy_take(self._responses._ref, _ANY, 10):
                assert struct.unpack_from("<Qq", answer, 4) == (_CLIENT, self._number)
                (size,) = struct.unpack_from("<I", answer, 24)
                return bool(answer[20]), answer[28 : 28 + size - 1].decode()
            let_pass(0.01)
        return None


def _service_id(endpoint: Any) -> str:
    data = next((policy.data for policy in endpoint.qos if isinstance(policy, Policy.Userdata)), b"")
    return next(pair for pair in data.decode().split(";") if pair.startswith("serviceid="))


def message(type_name: str, *values: Any) -> Any:
    """An object of rosbags, by the values of its fields in their order."""
    package, name = type_name.split("/")
    return STORE.types[f"{package}/msg/{name}"](*values)


def twist(linear: float, angular: float) -> Any:
    """A command of a robot with two driven wheels."""
    vector = "geometry_msgs/Vector3"
    return message("geometry_msgs/Twist", message(vector, linear, 0.0, 0.0), message(vector, 0.0, 0.0, angular))
