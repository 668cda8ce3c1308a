"""A ROS 2 node without ROS: topics over DDS, seen by every ROS 2 program as a node among others.

Names, discovery and types are those of ROS 2 Jazzy. Parameters and remaps are not there; a mapping file says what they
would. Services are those of one RMW alone, see `dds_services`. ``ddspy_write`` and ``ddspy_take`` are private functions
of the package cyclonedds, which is pinned for that: they take ready bytes, and so cost half as much as its public ones.
So is what `_BatchingWriter` calls.
"""

from __future__ import annotations

import ctypes
import logging
import os
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from cyclonedds._clayer import ddspy_take, ddspy_write
from cyclonedds.core import DDSException, InstanceState, Policy, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.core import Qos as DdsQos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.internal import DDS
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from wirebond.errors import UsageError
from wirebond.ros2 import dds_services
from wirebond.ros2.cdr import encode
from wirebond.ros2.dds_services import Calls, any_bytes, numbered
from wirebond.ros2.dds_types import TypeWatch
from wirebond.ros2.failure import Failure
from wirebond.ros2.idl import idl_type
from wirebond.ros2.node import LATCHED, LEVELS, Answer, Parameter, Qos, Quick, mismatch
from wirebond.ros2.pace import Pace
from wirebond.ros2.stalls import Stalls
from wirebond.ros2.subscriber import Subscriber
from wirebond.ros2.throttle import Throttle
from wirebond.ros2.types import RosType, ServiceType, ros_type, service_type
from wirebond.seldom import Seldom, and_more

_ANY = SampleState.Any | ViewState.Any | InstanceState.Any
_AT_ONCE = 256  # messages that one call takes
_LOOK_EVERY = 1.0  # seconds between two checks for subscribers and publishers with another quality of service
_GATHER = 0.001  # seconds that messages may wait for others at a high rate
_WAKE = duration(milliseconds=100)  # how long the end of the node may have to wait
_logger = logging.getLogger("wirebond.ros2")
_set_batching = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_bool)(("dds_qset_writer_batching", DDS._dll_handle))
_write_flush = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_int32)(("dds_write_flush", DDS._dll_handle))

# On this computer alone: the loopback interface has no multicast, so others are asked at its address. A thread of its
# own for data needs one call of the system a packet, not two; it ends by a packet to itself, which no firewall stops
# here.
LOOPBACK = """<CycloneDDS><Domain><General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>
<AllowMulticast>false</AllowMulticast></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>60</MaxAutoParticipantIndex>
<Peers><Peer address="127.0.0.1"/></Peers></Discovery>
<Internal><MultipleReceiveThreads>true</MultipleReceiveThreads></Internal></Domain></CycloneDDS>"""


def domain_of_environment() -> int:
    """Return the number in ROS_DOMAIN_ID, or 0.

    :raises UsageError: it is not a number of a domain.
    """
    text = os.environ.get("ROS_DOMAIN_ID", "").strip() or "0"
    if not text.isdecimal() or int(text) > 232:
        raise UsageError(f"ROS_DOMAIN_ID is {text!r:.40}; expected a number from 0 to 232")
    return int(text)


def is_local_only() -> bool:
    """Return whether the environment keeps ROS on this computer."""
    return os.environ.get("ROS_LOCALHOST_ONLY") == "1" or os.environ.get(
        "ROS_AUTOMATIC_DISCOVERY_RANGE", ""
    ).upper() in ("LOCALHOST", "OFF")


@cache
def _configure(number: int) -> Domain | None:
    """Configure the domain: once in a process, before its first participant."""
    return Domain(number, LOOPBACK) if is_local_only() and "CYCLONEDDS_URI" not in os.environ else None


@dataclass
class _Reader:
    entity: DataReader[Any]
    topic: str
    subscriber: Subscriber
    is_of_service: bool = False


class _BatchingWriter(DataWriter[Any]):
    """Collects writes until ``send``, or until a packet is full: a packet for each message costs more than everything
    else that is done for it."""

    def _create_writer(self, participant: Any, topic: Any, qos: Any, listener: Any) -> Any:
        _set_batching(qos, True)
        return super()._create_writer(participant, topic, qos, listener)

    def send(self) -> None:
        """Send everything that was written and has not left."""
        _write_flush(self._ref)


class DdsPublisher:
    """See ``node.Publisher``."""

    def __init__(self, writer: _BatchingWriter, type_: RosType, topic: str) -> None:
        self.entity = writer
        self.topic = topic
        self.type = type_
        self._reports = Seldom()

    def publish(self, values: Mapping[str, Any]) -> None:
        """Send one message. Any thread.

        :raises ValueError, TypeError, struct.error: a value is not of its field's type.
        """
        self.publish_encoded((encode(self.type, values),))

    def publish_encoded(self, messages: Iterable[bytes]) -> None:
        """See ``node.Publisher``. Any thread."""
        for data in messages:
            padding = -len(data) % 4
            answer = ddspy_write(self.entity._ref, data + bytes(padding) if padding else data)
            left_out = self._reports.passes(time.monotonic()) if answer < 0 else None
            if left_out is not None:
                why = DDSException(answer, "").msg
                _logger.warning("%s was not published: DDS says %s%s", self.topic, why, and_more(left_out))
        self.entity.send()


class DdsNode:
    """See ``node.Node``. The domain is that of ROS_DOMAIN_ID."""

    def __init__(self, name: str, namespace: str = "/") -> None:
        self.name = name
        self.namespace = namespace
        number = domain_of_environment()
        _configure(number)
        self._participant = DomainParticipant(number, qos=DdsQos(Policy.Userdata(b"enclave=/;")))
        self._topics: dict[str, Topic[Any]] = {}
        self._readers: list[_Reader] = []
        self._publishers: list[DdsPublisher] = []
        self._told: dict[int, int] = {}  # reported mismatches, by endpoint
        self.undecodable: Counter[str] = Counter()
        self.failure = Failure()
        self.stalls = Stalls()
        self._throttle = Throttle(self.log)
        self._types = TypeWatch(self._participant, lambda text: self.log("warning", text))
        self._calls = Calls(lambda text: self.log("error", text))
        self._not_offered: list[str] = []  # services
        self._discovery = DdsPublisher(
            _BatchingWriter(
                self._participant,
                self._topic(
                    "ros_discovery_info", idl_type(_known("rmw_dds_common/ParticipantEntitiesInfo")), prefix=""
                ),
                _dds_qos(LATCHED, _known("rmw_dds_common/ParticipantEntitiesInfo")),
            ),
            _known("rmw_dds_common/ParticipantEntitiesInfo"),
            "ros_discovery_info",
        )
        self._log = self.publisher("/rosout", _known("rcl_interfaces/Log"), Qos(latched=True, depth=1000))
        self._closed = threading.Event()
        self._thread = self.failure.thread("ROS 2 topics", self._run)

    def publisher(self, topic: str, type_: RosType, qos: Qos) -> DdsPublisher:
        """See ``node.Node``."""
        writer = _BatchingWriter(self._participant, self._topic(topic, idl_type(type_)), _dds_qos(qos, type_))
        self._publishers.append(made := DdsPublisher(writer, type_, topic))
        return made

    def subscribe(
        self,
        topic: str,
        type_: RosType,
        qos: Qos,
        take: Callable[[dict[str, Any]], None],
        quick: Quick | None = None,
    ) -> None:
        """See ``node.Node``. Before ``start``."""
        reader = DataReader(self._participant, self._topic(topic, idl_type(type_)), _dds_qos(qos, type_))

        def note_undecodable() -> None:
            self.undecodable[topic] += 1

        self._readers.append(_Reader(reader, topic, Subscriber(type_, take, note_undecodable, quick)))

    def serve(self, service: str, type_: ServiceType, answer: Answer) -> None:
        """See ``node.Node``."""
        if not dds_services.are_possible():
            self._not_offered.append(service)
            return
        user_data = f"serviceid={_gid(self._participant)['data'].hex()}.{len(self._readers)};"
        requests = DataReader(
            self._participant,
            self._topic(f"{service}Request", any_bytes(type_.request), "rq"),
            _dds_qos(Qos(), type_.request, user_data),
        )
        responses = _BatchingWriter(
            self._participant,
            self._topic(f"{service}Reply", any_bytes(type_.response), "rr"),
            _dds_qos(Qos(), type_.response, user_data),
        )
        publisher = DdsPublisher(responses, numbered(type_.response), service)
        take = self._calls.taker(requests, responses, answer, publisher.publish)
        self._publishers.append(publisher)

        def note_undecodable() -> None:
            self.undecodable[service] += 1
            self._throttle.say("warning", service, f"{service} was called, and not answered: {_OTHER_RMW}")

        subscriber = Subscriber(numbered(type_.request), take, note_undecodable)
        self._readers.append(_Reader(requests, service, subscriber, is_of_service=True))

    def declare(self, parameter: Parameter) -> None:
        """Use the mapping file's value: without ROS there are no parameter services."""

    def update(self, name: str, value: float) -> None:
        """See ``declare``."""

    def canceller(self, action: str) -> Callable[[], None]:
        """See ``node.Node``. A request without a goal and a time asks for all of them; its response is not read."""
        if not dds_services.are_possible():
            return lambda: None
        type_ = service_type("action_msgs/CancelGoal")
        assert type_ is not None, "the type is known"
        topic = self._topic(f"{action}/_action/cancel_goalRequest", any_bytes(type_.request), "rq")
        writer = _BatchingWriter(self._participant, topic, _dds_qos(Qos(), type_.request))
        self._publishers.append(publisher := DdsPublisher(writer, numbered(type_.request), action))
        return lambda: publisher.publish({})

    def log(self, level: str, text: str) -> None:
        """See ``node.Node``: on /rosout, and by Python's logging."""
        now = time.time_ns()
        number = LEVELS[level]
        _logger.log(number, "%s", text)
        self._log.publish(
            {
                "stamp": {"sec": now // 1_000_000_000, "nanosec": now % 1_000_000_000},
                "level": number,
                "name": ".".join([*self.namespace.strip("/").split("/"), self.name]).lstrip("."),
                "msg": text,
            }
        )

    def now_ns(self) -> int:
        """See ``node.Node``: the clock of the system."""
        return time.time_ns()

    def start(self) -> None:
        """See ``node.Node``."""
        self._announce()
        self.stalls.begin()
        self._thread.start()
        if self._not_offered:
            self.log("warning", _NO_SERVICES.format(", ".join(self._not_offered)))

    def close(self) -> None:
        """See ``node.Node``."""
        self._closed.set()
        if self._thread.is_alive() and threading.current_thread() is not self._thread:
            self._thread.join(5.0)
        self._calls.close()

    # ---- within

    def _topic(self, name: str, declared: type[IdlStruct], prefix: str = "rt") -> Topic[Any]:
        if name not in self._topics:
            self._topics[name] = Topic(self._participant, f"{prefix}{name}", declared)
        return self._topics[name]

    def _announce(self) -> None:
        """Say which node has which endpoints."""
        self._discovery.publish(
            {
                "gid": _gid(self._participant),
                "node_entities_info_seq": [
                    {
                        "node_namespace": self.namespace,
                        "node_name": self.name,
                        "reader_gid_seq": [_gid(reader.entity) for reader in self._readers],
                        "writer_gid_seq": [_gid(publisher.entity) for publisher in self._publishers],
                    }
                ],
            }
        )

    def _run(self) -> None:
        waits = WaitSet(self._participant)
        conditions = [ReadCondition(reader.entity, _ANY) for reader in self._readers]
        for condition in conditions:
            waits.attach(condition)
        next_look = 0.0
        has_come = False
        pace = Pace(_GATHER)
        while not self._closed.is_set():
            pace.wait()
            if not has_come:  # else more of it has come in the meantime, most likely
                waits.wait(_WAKE)
            self.stalls.look()
            has_come = False
            for reader in self._readers:
                has_come |= self._take(reader)
            for reader in self._readers:
                reader.subscriber.flush()
            if (now := time.monotonic()) >= next_look:
                next_look = now + _LOOK_EVERY
                self._tell_mismatches()

    def _take(self, reader: _Reader) -> bool:
        """Take a sample. False: none has come."""
        has_come = False
        while not self._closed.is_set():
            taken = ddspy_take(reader.entity._ref, _ANY, _AT_ONCE)
            if isinstance(taken, int) or not taken:
                break
            has_come = True
            reader.subscriber.give([data for data, info in taken if info.valid_data])
            if len(taken) < _AT_ONCE:
                break
        return has_come

    def _tell_mismatches(self) -> None:
        """Report nodes with other qualities of service, or other types: a publisher and a subscriber do not find each
        other then, and ROS is silent."""
        for publisher in self._publishers:
            entity: Any = publisher.entity
            status = entity.get_offered_incompatible_qos_status()
            self._tell(entity, status, publisher.topic, is_publisher=True)
        for reader in self._readers:
            entity = reader.entity
            status = entity.get_requested_incompatible_qos_status()
            self._tell(entity, status, reader.topic, is_publisher=False)
        self._types.look(
            {publisher.topic: publisher.type for publisher in self._publishers},
            {reader.topic: reader.subscriber.type for reader in self._readers if not reader.is_of_service},
        )

    def _tell(self, entity: Any, status: Any, topic: str, *, is_publisher: bool) -> None:
        if status is None or status.total_count <= self._told.get(entity._ref, 0):
            return
        self._told[entity._ref] = status.total_count
        if status.last_policy_id == _TYPE:
            return  # `TypeWatch` says which types these are
        policy = _POLICIES.get(status.last_policy_id, f"policy {status.last_policy_id}")
        self.log("warning", mismatch(topic, policy, is_publisher=is_publisher))


_NO_SERVICES = (
    "services are not offered: {}. Without ROS they work with rmw_cyclonedds_cpp alone: set "
    f"RMW_IMPLEMENTATION={dds_services.RMW} here and in every program that calls them, or run wirebond_ros"
)
_OTHER_RMW = f"the caller's RMW is another than {dds_services.RMW}; start it with that, or run wirebond_ros here"
_TYPE = 24  # the policy that another type breaks
_POLICIES = {2: "durability", 4: "deadline", 5: "latency budget", 8: "liveliness", 11: "reliability"}


def _gid(entity: Any) -> dict[str, Any]:
    return {"data": entity.get_guid().bytes}


def _known(name: str) -> RosType:
    found = ros_type(name)
    assert found is not None, f"ROS 2 has no {name}"
    return found


def _dds_qos(qos: Qos, type_: RosType | None = None, user_data: str = "") -> DdsQos:
    """Make the quality of service. ``user_data``: comes after the type's hash."""
    policies: list[Any] = [
        Policy.Reliability.Reliable(duration(milliseconds=100)) if qos.reliable else Policy.Reliability.BestEffort,
        Policy.Durability.TransientLocal if qos.latched else Policy.Durability.Volatile,
        Policy.History.KeepLast(qos.depth),
        Policy.DataRepresentation(use_cdrv0_representation=True),
    ]
    if qos.latched:
        policies.append(
            Policy.DurabilityService(
                cleanup_delay=0,
                history=Policy.History.KeepLast(qos.depth),
                max_samples=-1,
                max_instances=-1,
                max_samples_per_instance=-1,
            )
        )
    if type_ is not None:
        policies.append(Policy.Userdata(f"typehash={type_.hash};{user_data}".encode()))
    return DdsQos(*policies)
