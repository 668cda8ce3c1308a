"""Between one link and one node of ROS 2: messages become topics, topics become messages, as a mapping says."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from wirebond import _engine
from wirebond.errors import LinkDownError, WirebondError
from wirebond.protocol.model import End
from wirebond.ros2.commands import Commands
from wirebond.ros2.diagnostics import Diagnostics, deadline_words
from wirebond.ros2.json_text import from_json
from wirebond.ros2.mapping.model import BridgeMapping, Incoming, OdometryMapping
from wirebond.ros2.mcu_parameters import McuParameters
from wirebond.ros2.node import LATCHED, Node, Parameter, Publisher, Qos, whole_topic
from wirebond.ros2.pace import Pace
from wirebond.ros2.serial_topics import SerialTopics
from wirebond.ros2.services import Services
from wirebond.ros2.throttle import Throttle
from wirebond.ros2.topics import Topics, known, stamp_of
from wirebond.ros2.types import service_type

if TYPE_CHECKING:
    from wirebond.codec import Message
    from wirebond.link import Link
    from wirebond.link.handlers import DeadlineEvent
    from wirebond.protocol.model import Message as MessageModel

_WAIT = 0.1  # seconds that the bridge waits for messages before it looks at the time again
_SERIAL_WAIT = 0.02  # where sent frames have topics, which nothing wakes the bridge for
_GATHER = 0.001  # seconds that messages may wait for others at a high rate
_DIAGNOSE_EVERY = 1.0
_POLL_HOLD = 3.0  # seconds that a request goes on after the bridge last wanted it
_POLL_AGAIN = 1.0


class Bridge:
    """Runs from ``run`` to ``close``; it owns neither the link nor the node."""

    def __init__(self, link: Link, node: Node, mapping: BridgeMapping) -> None:
        self.link = link
        self.node = node
        self.mapping = mapping
        self.commands = Commands(link, node.log)
        self._throttle = Throttle(node.log)
        self._closed = threading.Event()
        self._model = link.codec.model
        self._deadlines = {d.then: d for d in self._model.deadlines if d.at == End.HOST}
        self._topics = Topics(
            link.codec,
            mapping,
            lambda topic, type_, qos: node.publisher(self._whole(topic), type_, qos),
            lambda topic, why: self._throttle.say("warning", f"publish {topic}", f"{topic} was not published: {why}"),
        )
        for incoming in mapping.subscribe:
            self._add_incoming(incoming)
        for message in mapping.json_in:
            self._add_json(message)
        services = Services(link, self.commands, self._take)
        for one in mapping.services:
            node.serve(self._whole(one.service), one.type, services.answer(one))
        if mapping.odometry is not None:
            self._declare_wheels(mapping.odometry)
            if mapping.odometry.reset is not None:
                self._serve_reset(mapping.odometry.reset)
        self._navigation = None
        if mapping.navigation is not None:
            self._navigation = self._publisher(mapping.navigation.topic, "std_msgs/Bool", LATCHED)
            self._cancellers = [node.canceller(self._whole(action)) for action in mapping.navigation.cancel]
        self._navigation_ok: bool | None = None
        if mapping.emergency_stop is not None:
            self._subscribe(mapping.emergency_stop, "std_msgs/Bool", Qos(), self._emergency_stop)
        self._serial = SerialTopics(link, self.commands, self._publisher, self._subscribe) if mapping.serial else None
        self._was_down = False
        self._oldest = 0.0  # seconds: the age of a message when it became a topic, since the latency was last published
        self._latency = None
        if mapping.latency is not None:
            self._latency = self._publisher(mapping.latency, "std_msgs/Float64", Qos())
        self._parameters = None
        if self._model.service("parameter") is not None:
            self._parameters = McuParameters(link, node, self._throttle.say, self._take)
        self._diagnostics = Diagnostics(link, self.commands, mapping, node, self._serial)
        self._diagnostics_out = self._publisher("/diagnostics", "diagnostic_msgs/DiagnosticArray", Qos())

    def run(self) -> None:
        """Until ``close``, or until the link is closed. One thread."""
        if self._deadlines:
            self.link.on_deadline()(self._on_deadline)
        self._set_navigation()
        self.node.start()
        if self._parameters is not None:
            self._parameters.start()
        next_poll = next_diagnosis = 0.0
        pace = Pace(_GATHER)
        try:
            while not self._closed.is_set():
                now = time.monotonic()
                if now >= next_poll:
                    next_poll = now + _POLL_AGAIN
                    self._poll()
                if now >= next_diagnosis:
                    next_diagnosis = now + _DIAGNOSE_EVERY
                    self._set_navigation()
                    self._tell_state()
                    self._diagnostics_out.publish(self._diagnostics.message(stamp_of(self.node.now_ns())))
                    self._tell_latency()
                pace.wait()
                self._take(self.link.receive(_WAIT if self._serial is None else _SERIAL_WAIT))
                if self._serial is not None:
                    self._serial.take_sent()
        except LinkDownError:
            self.node.log("info", "the link is closed; the bridge ends")
        finally:
            if self._parameters is not None:
                self._parameters.close()
            if self._deadlines:
                self.link.off(self._on_deadline)

    def close(self) -> None:
        """Let ``run`` return. Any thread."""
        self._closed.set()

    # ---- from the MCU

    def _take(self, messages: list[Message]) -> None:
        if not messages:
            return
        ahead_ns = self.node.now_ns() - time.monotonic_ns()
        oldest_ns = self._topics.take(messages, _engine.stamps_ns(messages, ahead_ns))
        if oldest_ns is not None:
            self._oldest = max(self._oldest, time.monotonic() - (oldest_ns - ahead_ns) * 1e-9)
        if self._serial is not None:
            for message in messages:
                self._serial.take_received(message)

    def _tell_state(self) -> None:
        """That the port or the server is away, and that it is back."""
        is_down = self.link.state == "down"
        if is_down and not self._was_down:
            self.node.log("error", self.link.why)
        elif self._was_down and not is_down:
            self.node.log("info", f"the link is back: {self.link.port}")
        self._was_down = is_down

    def _tell_latency(self) -> None:
        if self._latency is not None and self._oldest:
            self._latency.publish({"data": self._oldest})
        self._oldest = 0.0

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

        quick = None
        if incoming.plan is not None and incoming.stale is None:
            framer = self.commands.framer(incoming.plan)
            if framer is not None:
                quick = _QuickCommand(self.commands, self.link.codec._index_of(incoming.message), framer)
        self.node.subscribe(self._whole(incoming.topic), incoming.type, incoming.qos, take, quick)

    def _add_json(self, message: MessageModel) -> None:
        def send(values: dict[str, Any]) -> None:
            try:
                fields, header = from_json(values["data"], message)
            except ValueError as error:
                self.commands.refuse(message.name, str(error))
                return
            self.commands.send(message.name, fields, header=header)

        self._subscribe(f"~/{message.name}/send", "std_msgs/String", Qos(), send)

    def _declare_wheels(self, mapping: OdometryMapping) -> None:
        for name, (limit, text) in _WHEELS.items():

            def change(new: float, name: str = name) -> None:
                setattr(mapping.wheels, name, new)

            value = getattr(mapping.wheels, name)
            self.node.declare(Parameter(f"odometry.{name}", value, 1e-6, limit, text, change))

    def _serve_reset(self, service: str) -> None:
        pose, type_ = self._topics.pose, service_type("std_srvs/Trigger")
        assert pose is not None, "the mapping has odometry"
        assert type_ is not None, "the type is known"

        def answer(_: dict[str, Any]) -> dict[str, Any]:
            pose.reset()
            return {"success": True, "message": "the pose begins at zero again"}

        self.node.serve(self._whole(service), type_, answer)

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
            for cancel in self._cancellers:
                cancel()
        self._navigation.publish({"data": is_ok})

    # ---- names

    def _whole(self, topic: str) -> str:
        return whole_topic(topic, self.mapping.namespace, self.mapping.node)

    def _publisher(self, topic: str, type_name: str, qos: Qos) -> Publisher:
        return self.node.publisher(self._whole(topic), known(type_name), qos)

    def _subscribe(self, topic: str, type_name: str, qos: Qos, take: Callable[[dict[str, Any]], None]) -> None:
        self.node.subscribe(self._whole(topic), known(type_name), qos, take)


class _QuickCommand:
    """See ``node.Quick``: what is in order leaves without a look at its fields."""

    def __init__(self, commands: Commands, index: int, framer: _engine.CdrCommand) -> None:
        self._commands = commands
        self._index = index
        self._frames = framer.frames

    def take(self, messages: list[bytes], first: int) -> int:
        frames = self._frames(messages, first)
        self._commands.send_frames(self._index, frames)
        return len(frames)

    def flush(self) -> None:
        self._commands.flush()


_WHEELS = {
    "radius": (10.0, "Radius of a wheel, in metres"),
    "separation": (100.0, "Distance between the two wheels, in metres"),
    "ticks_per_turn": (1e9, "Encoder ticks of one turn of a wheel"),
}
