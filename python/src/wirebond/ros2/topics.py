"""Converts messages to topics by a mapping, for the bridge and for bags. No link."""

from __future__ import annotations

import struct
from collections.abc import Callable
from operator import attrgetter
from typing import TYPE_CHECKING

from wirebond import _engine
from wirebond.ros2.cdr import encode
from wirebond.ros2.json_text import to_json
from wirebond.ros2.mapping.model import HEADER_KEY, BridgeMapping, OdometryMapping, Outgoing
from wirebond.ros2.node import Publisher, Qos
from wirebond.ros2.odometry import Odometry
from wirebond.ros2.types import RosType, ros_type

if TYPE_CHECKING:
    from wirebond.codec import Codec, Message

# Takes messages of one kind, with the time of each in nanoseconds of ROS.
Taker = Callable[[list["Message"], list[int]], None]
Publish = Callable[[str, RosType, Qos], Publisher]  # gives the topic of this name, which is as the mapping writes it
Warn = Callable[[str, str], None]  # the topic that was not published, and why
_NAME = attrgetter("name")


class Topics:
    """Every topic that messages become.

    :ivar pose: of the mapping's `odometry`.
    """

    def __init__(self, codec: Codec, mapping: BridgeMapping, publisher: Publish, warn: Warn) -> None:
        self._takers: dict[str, list[Taker]] = {}
        self.pose: Odometry | None = None
        self._codec = codec
        self._publisher = publisher
        self._warn = warn
        for outgoing in mapping.publish:
            self._add_outgoing(outgoing)
        for message in mapping.json_out:
            self._add_json(message.name)
        if mapping.odometry is not None:
            self._add_odometry(mapping.odometry)

    def take(self, messages: list[Message], stamps_ns: list[int]) -> int | None:
        """Publish the messages that came, in this order, each with its time in nanoseconds of ROS. Return the earliest
        time of those that have a topic; None: none has.

        Each topic has its messages in their order. One topic is published after the other.
        """
        names = set(map(_NAME, messages))
        oldest = []
        for name in names & self._takers.keys():
            of_name, stamps = messages, stamps_ns
            if len(names) > 1:
                places = [place for place, message in enumerate(messages) if message.name == name]
                of_name, stamps = [messages[place] for place in places], [stamps_ns[place] for place in places]
            oldest.append(min(stamps))
            for take in self._takers[name]:
                take(of_name, stamps)
        return min(oldest, default=None)

    def _add(self, message: str, take: Taker) -> None:
        self._takers.setdefault(message, []).append(take)

    def _add_outgoing(self, outgoing: Outgoing) -> None:
        publisher = self._publisher(outgoing.topic, outgoing.type, outgoing.qos)
        packer = None if outgoing.plan is None else _engine.CdrPacker.make(self._codec.tables.protocol, outgoing.plan)
        next_t = 0.0

        def is_due(message: Message) -> bool:
            nonlocal next_t
            if message.t < next_t:
                return False
            is_steady = message.t - next_t < outgoing.every
            next_t = (next_t if is_steady else message.t) + outgoing.every
            return True

        def filled(message: Message, stamp_ns: int) -> bytes | None:
            try:
                fields = {**message.fields, HEADER_KEY: message.header} if outgoing.reads_header else message.fields
                return encode(outgoing.type, outgoing.fill(fields, stamp_of(stamp_ns)))
            except (ValueError, TypeError, ArithmeticError, LookupError, struct.error) as error:
                self._warn(outgoing.topic, repr(error))
                return None

        def take(messages: list[Message], stamps_ns: list[int]) -> None:
            if outgoing.every:
                places = [place for place, message in enumerate(messages) if is_due(message)]
                messages, stamps_ns = [messages[place] for place in places], [stamps_ns[place] for place in places]
            packed: list[bytes | None]
            packed = [None] * len(messages) if packer is None else packer.pack(messages, stamps_ns)
            if not all(packed):
                packed = [
                    data or filled(message, stamp_ns)
                    for data, message, stamp_ns in zip(packed, messages, stamps_ns, strict=True)
                ]
            publisher.publish_encoded(filter(None, packed))

        self._add(outgoing.message, take)

    def _add_json(self, message: str) -> None:
        publisher = self._publisher(f"~/{message}", type_ := known("std_msgs/String"), Qos())

        def take(messages: list[Message], _: list[int]) -> None:
            publisher.publish_encoded(encode(type_, {"data": to_json(received)}) for received in messages)

        self._add(message, take)

    def _add_odometry(self, mapping: OdometryMapping) -> None:
        every = self._codec.model.message(mapping.message).every
        self.pose = pose = Odometry(mapping, every)
        tells = [(self._publisher(mapping.topic, known("nav_msgs/Odometry"), Qos()), pose.odometry)]
        if mapping.tf:
            tells.append((self._publisher("/tf", known("tf2_msgs/TFMessage"), Qos(depth=100)), pose.transform))
        if mapping.joints:
            tells.append((self._publisher("joint_states", known("sensor_msgs/JointState"), Qos()), pose.joint_states))

        def take(messages: list[Message], stamps_ns: list[int]) -> None:
            for message, stamp_ns in zip(messages, stamps_ns, strict=True):
                pose.take(message.fields, message.t)
                stamp = stamp_of(stamp_ns)
                for publisher, tell in tells:
                    publisher.publish(tell(stamp))

        self._add(mapping.message, take)


def known(name: str) -> RosType:
    """Return a type that every ROS 2 has."""
    found = ros_type(name)
    assert found is not None, f"ROS 2 has no {name}"
    return found


def stamp_of(ns: int) -> dict[str, int]:
    """Convert nanoseconds to builtin_interfaces/Time."""
    return {"sec": ns // 1_000_000_000, "nanosec": ns % 1_000_000_000}
