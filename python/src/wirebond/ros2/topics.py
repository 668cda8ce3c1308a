"""From messages to topics, as a mapping says: what the bridge publishes, and what a bag holds. No link."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import TYPE_CHECKING

from wirebond import _engine
from wirebond.ros2.json_text import to_json
from wirebond.ros2.mapping.model import HEADER_KEY, BridgeMapping, OdometryMapping, Outgoing
from wirebond.ros2.node import Publisher, Qos
from wirebond.ros2.odometry import Odometry
from wirebond.ros2.types import RosType, ros_type

if TYPE_CHECKING:
    from wirebond.codec import Codec, Message

Taker = Callable[["Message", int], None]  # with the message's time, in nanoseconds of ROS
Publish = Callable[[str, RosType, Qos], Publisher]  # gives the topic of this name, which is as the mapping writes it
Warn = Callable[[str, str], None]  # the topic that was not published, and why


class Topics:
    """Every topic that messages become.

    :ivar takers: what each message is given to, by the message's name.
    :ivar pose: of the mapping's `odometry`.
    """

    def __init__(self, codec: Codec, mapping: BridgeMapping, publisher: Publish, warn: Warn) -> None:
        self.takers: dict[str, list[Taker]] = {}
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

    def _add(self, message: str, take: Taker) -> None:
        self.takers.setdefault(message, []).append(take)

    def _add_outgoing(self, outgoing: Outgoing) -> None:
        publisher = self._publisher(outgoing.topic, outgoing.type, outgoing.qos)
        packer = None if outgoing.plan is None else _engine.CdrPacker.make(self._codec._table, outgoing.plan)
        next_t = 0.0

        def take(message: Message, stamp_ns: int) -> None:
            nonlocal next_t
            if outgoing.every:
                if message.t < next_t:
                    return
                is_steady = message.t - next_t < outgoing.every
                next_t = (next_t if is_steady else message.t) + outgoing.every
            try:
                data = None if packer is None else packer.pack(message, stamp_ns)
                if data is not None:
                    publisher.publish_bytes(data)
                else:
                    fields = {**message.fields, HEADER_KEY: message.header} if outgoing.reads_header else message.fields
                    publisher.publish(outgoing.fill(fields, stamp_of(stamp_ns)))
            except (ValueError, TypeError, ArithmeticError, LookupError, struct.error) as error:
                self._warn(outgoing.topic, repr(error))

        self._add(outgoing.message, take)

    def _add_json(self, message: str) -> None:
        publisher = self._publisher(f"~/{message}", known("std_msgs/String"), Qos())
        self._add(message, lambda received, _: publisher.publish({"data": to_json(received)}))

    def _add_odometry(self, mapping: OdometryMapping) -> None:
        every = self._codec.model.message(mapping.message).every
        self.pose = pose = Odometry(mapping, every)
        tells = [(self._publisher(mapping.topic, known("nav_msgs/Odometry"), Qos()), pose.odometry)]
        if mapping.tf:
            tells.append((self._publisher("/tf", known("tf2_msgs/TFMessage"), Qos(depth=100)), pose.transform))
        if mapping.joints:
            tells.append((self._publisher("joint_states", known("sensor_msgs/JointState"), Qos()), pose.joint_states))

        def take(message: Message, stamp_ns: int) -> None:
            pose.take(message.fields, message.t)
            stamp = stamp_of(stamp_ns)
            for publisher, tell in tells:
                publisher.publish(tell(stamp))

        self._add(mapping.message, take)


def known(name: str) -> RosType:
    """A type that every ROS 2 has."""
    found = ros_type(name)
    assert found is not None, f"ROS 2 has no {name}"
    return found


def stamp_of(ns: int) -> dict[str, int]:
    """Nanoseconds as builtin_interfaces/Time."""
    return {"sec": ns // 1_000_000_000, "nanosec": ns % 1_000_000_000}
