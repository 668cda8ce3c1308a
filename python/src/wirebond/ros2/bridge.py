"""Between one link and one node of ROS 2: messages become topics, topics become messages, as a mapping says."""

from __future__ import annotations

import struct
import threading
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from wirebond.errors import LinkDownError, WirebondError
from wirebond.protocol.model import End
from wirebond.ros2.commands import Commands, Throttle
from wirebond.ros2.diagnostics import Diagnostics, deadline_words
from wirebond.ros2.json_text import from_json, to_json
from wirebond.ros2.mapping.model import BridgeMapping, Incoming, OdometryMapping, Outgoing
from wirebond.ros2.node import LATCHED, Node, Parameter, Publisher, Qos, whole_topic
from wirebond.ros2.odometry import Odometry
from wirebond.ros2.serial_topics import SerialTopics
from wirebond.ros2.types import RosType, ros_type

if TYPE_CHECKING:
    from wirebond.codec import Message
    from wirebond.link import Link
    from wirebond.link.handlers import DeadlineEvent
    from wirebond.protocol.model import Message as MessageModel

_WAIT = 0.1  # seconds that the bridge waits for messages before it looks at the time again
_SERIAL_WAIT = 0.02  # where sent frames have topics, which nothing wakes the bridge for
_DIAGNOSE_EVERY = 1.0
_POLL_HOLD = 3.0  # seconds that a request goes on after the bridge last wanted it
_POLL_AGAIN = 1.0

Stamp = Mapping[str, int]
Taker = Callable[["Message", Stamp], None]


class Bridge:
    """Runs from ``run`` to ``close``; it owns neither the link nor the node."""

    def __init__(self, link: Link, node: Node, mapping: BridgeMapping) -> None:
        self.link = link
        self.node = node
        self.mapping = mapping
        self.commands = Commands(link, node.log)
        self._throttle = Throttle(node.log)
        self._takers: dict[str, list[Taker]] = {}
        self._closed = threading.Event()
        self._model = link.codec.model
        self._deadlines = {d.then: d for d in self._model.deadlines if d.at == End.HOST}
        for outgoing in mapping.publish:
            self._add_outgoing(outgoing)
        for incoming in mapping.subscribe:
            self._add_incoming(incoming)
        self._add_json()
        if mapping.odometry is not None:
            self._add_odometry(mapping.odometry)
        self._navigation = None
        if mapping.navigation is not None:
            self._navigation = self._publisher(mapping.navigation.topic, "std_msgs/Bool", LATCHED)
        self._navigation_ok: bool | None = None
        if mapping.emergency_stop is not None:
            self._subscribe(mapping.emergency_stop, "std_msgs/Bool", Qos(), self._emergency_stop)
        self._serial = SerialTopics(link, self.commands, self._publisher, self._subscribe) if mapping.serial else None
        self._diagnostics = Diagnostics(link, self.commands, mapping.node, mapping.diagnostics)
        self._diagnostics_out = self._publisher("/diagnostics", "diagnostic_msgs/DiagnosticArray", Qos())

    def run(self) -> None:
        """Until ``close``, or until the link is closed. One thread."""
        if self._deadlines:
            self.link.on_deadline()(self._on_deadline)
        self._set_navigation()
        self.node.start()
        next_poll = next_diagnosis = 0.0
        try:
            while not self._closed.is_set():
                now = time.monotonic()
                if now >= next_poll:
                    next_poll = now + _POLL_AGAIN
                    self._poll()
                if now >= next_diagnosis:
                    next_diagnosis = now + _DIAGNOSE_EVERY
                    self._set_navigation()
                    self._diagnostics_out.publish(self._diagnostics.message(_stamp(self.node.now_ns())))
                self._take(self.link.receive(_WAIT if self._serial is None else _SERIAL_WAIT))
                if self._serial is not None:
                    self._serial.take_sent()
        except LinkDownError:
            self.node.log("info", "the link is closed; the bridge ends")
        finally:
            if self._deadlines:
                self.link.off(self._on_deadline)

    def close(self) -> None:
        """Let ``run`` return. Any thread."""
        self._closed.set()

    # ---- from the MCU

    def _take(self, messages: list[Message]) -> None:
        if not messages:
            return
        ahead = self.node.now_ns() - time.monotonic_ns()
        for message in messages:
            takers = self._takers.get(message.name)
            if takers is not None:
                t: float | None = getattr(message, "stamp", None)
                stamp = _stamp(int((message.t if t is None else t) * 1e9) + ahead)
                for take in takers:
                    take(message, stamp)
            if self._serial is not None:
                self._serial.take_received(message)

    def _add_outgoing(self, outgoing: Outgoing) -> None:
        publisher = self.node.publisher(self._whole(outgoing.topic), outgoing.type, outgoing.qos)
        next_t = 0.0

        def take(message: Message, stamp: Stamp) -> None:
            nonlocal next_t
            if outgoing.every:
                if message.t < next_t:
                    return
                is_steady = message.t - next_t < outgoing.every
                next_t = (next_t if is_steady else message.t) + outgoing.every
            try:
                if outgoing.pack is not None:
                    publisher.publish_bytes(outgoing.pack(message.fields, stamp))
                else:
                    publisher.publish(outgoing.fill(message.fields, stamp))
            except (ValueError, TypeError, ArithmeticError, LookupError, struct.error) as error:
                topic = outgoing.topic
                self._throttle.say("warning", f"publish {topic}", f"{topic} was not published: {error!r}")

        self._takers.setdefault(outgoing.message, []).append(take)

    def _add_json(self) -> None:
        for message in self.mapping.json_out:
            publisher = self._publisher(f"~/{message.name}", "std_msgs/String", Qos())

            def show(received: Message, _: Stamp, publisher: Publisher = publisher) -> None:
                publisher.publish({"data": to_json(received)})

            self._takers.setdefault(message.name, []).append(show)
        for message in self.mapping.json_in:

            def send(values: dict[str, Any], message: MessageModel = message) -> None:
                try:
                    fields, header = from_json(values["data"], message)
                except ValueError as error:
                    self.commands.refuse(message.name, str(error))
                    return
                self.commands.send(message.name, fields, header=header)

            self._subscribe(f"~/{message.name}/send", "std_msgs/String", Qos(), send)

    def _add_odometry(self, mapping: OdometryMapping) -> None:
        every = next(m.every for m in self._model.messages if m.name == mapping.message)
        pose = Odometry(mapping, every)
        tells = [(self._publisher(mapping.topic, "nav_msgs/Odometry", Qos()), pose.odometry)]
        if mapping.tf:
            tells.append((self._publisher("/tf", "tf2_msgs/TFMessage", Qos(depth=100)), pose.transform))
        if mapping.joints:
            tells.append((self._publisher("joint_states", "sensor_msgs/JointState", Qos()), pose.joint_states))

        def take(message: Message, stamp: Stamp) -> None:
            pose.take(message.fields, message.t)
            for publisher, tell in tells:
                publisher.publish(tell(stamp))

        self._takers.setdefault(mapping.message, []).append(take)
        for name, (limit, text) in _WHEELS.items():
            value = getattr(mapping.wheels, name)

            def change(new: float, name: str = name) -> None:
                setattr(mapping.wheels, name, new)

            self.node.declare(Parameter(f"odometry.{name}", value, 1e-6, limit, text, change))

    # ---- to the MCU

    def _add_incoming(self, incoming: Incoming) -> None:
        def take(values: dict[str, Any]) -> None:
            try:
                fields = {name: getter(values) for name, getter in incoming.values}
            except LookupError:
                self.commands.refuse(
                    incoming.message, f"a message of {incoming.topic} is shorter than the mapping says"
                )
                return
            self.commands.send(incoming.message, fields, hold=incoming.stale)

        self.node.subscribe(self._whole(incoming.topic), incoming.type, incoming.qos, take)

    def _emergency_stop(self, values: dict[str, Any]) -> None:
        try:
            if values["data"]:
                self.link.emergency_stop()
                self.node.log("error", "emergency stop: what moves the robot is held until false comes")
            else:
                self.link.release_stop()
                self.link.take_control()
                self.node.log("warning", "the emergency stop is released")
        except WirebondError as error:
            self.node.log("error", str(error))

    def _poll(self) -> None:
        for name in self.mapping.poll:
            try:
                self.link.repeat(name, hold=_POLL_HOLD)
            except WirebondError as error:
                self._throttle.say("warning", f"poll {name}", f"{name} is not asked: {error}")

    # ---- deadlines

    def _on_deadline(self, event: DeadlineEvent) -> None:
        words = deadline_words(self._deadlines[event.action])
        self.node.log("warning" if event.struck else "info", f"{event.action}: {words if event.struck else 'over'}")
        self._set_navigation()

    def _set_navigation(self) -> None:
        """Stop or resume, and say so where it changed. Before its message has ever come, navigation is not possible."""
        if self.mapping.navigation is None or self._navigation is None:
            return
        deadline = self._deadlines[self.mapping.navigation.deadline]
        struck = self.link.deadlines[deadline.then]
        is_ok = not struck and self.link.latest(deadline.message) is not None
        if is_ok == self._navigation_ok:
            return
        was, self._navigation_ok = self._navigation_ok, is_ok
        if is_ok:
            self.commands.resume()
        elif was is None:
            self.commands.why_stopped = f"no {deadline.message} has come yet"
        else:
            self.commands.stop(f"navigation is stopped, because there was {deadline_words(deadline)}")
        self._navigation.publish({"data": is_ok})

    # ---- names

    def _whole(self, topic: str) -> str:
        return whole_topic(topic, self.mapping.namespace, self.mapping.node)

    def _publisher(self, topic: str, type_name: str, qos: Qos) -> Publisher:
        return self.node.publisher(self._whole(topic), _known(type_name), qos)

    def _subscribe(self, topic: str, type_name: str, qos: Qos, take: Callable[[dict[str, Any]], None]) -> None:
        self.node.subscribe(self._whole(topic), _known(type_name), qos, take)


_WHEELS = {
    "radius": (10.0, "Radius of a wheel, in metres"),
    "separation": (100.0, "Distance between the two wheels, in metres"),
    "ticks_per_turn": (1e9, "Encoder ticks of one turn of a wheel"),
}


def _known(name: str) -> RosType:
    found = ros_type(name)
    assert found is not None, f"ROS 2 has no {name}"
    return found


def _stamp(ns: int) -> Stamp:
    return {"sec": ns // 1_000_000_000, "nanosec": ns % 1_000_000_000}
