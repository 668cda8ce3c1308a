"""Between one link and one node of ROS 2: messages become topics, topics become messages, as a mapping says."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from wirebond import _engine
from wirebond.errors import LinkDownError, StoppedByOtherError, WirebondError
from wirebond.link.stop_file import StopFile
from wirebond.protocol.model import End
from wirebond.ros2.commands import Commands
from wirebond.ros2.diagnostics import Diagnostics, deadline_words
from wirebond.ros2.held_back import HeldBack, can_hold_back
from wirebond.ros2.json_text import from_json
from wirebond.ros2.mapping.model import BridgeMapping, Incoming, OdometryMapping
from wirebond.ros2.mcu_parameters import McuParameters
from wirebond.ros2.node import LATCHED, Node, Parameter, Publisher, Qos, whole_topic
from wirebond.ros2.pace import Pace
from wirebond.ros2.ros_words import RosWords
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

_WAIT = 0.1  # seconds that the bridge waits for messages before it checks the time again
_SERIAL_WAIT = 0.02  # where sent frames have topics, which nothing wakes the bridge for
_GATHER = 0.001  # seconds that messages may wait for others at a high rate
_DIAGNOSE_EVERY = 1.0
_POLL_HOLD = 3.0  # seconds that a request goes on after the bridge last wanted it
_POLL_AGAIN = 1.0
_TAKE_CONTROL = "~/take_control"
_ACTS = 5  # lines a second about actions of persons and other rare events
_DECISION = 3.0  # seconds without a message to take control; then the next one is a person's decision


class Bridge:
    """Runs from ``run`` to ``close``; it owns neither the link nor the node.

    :param kept_stop: where a stop is kept for the next bridge, if this one is killed. None: the link's server does.
    """

    def __init__(self, link: Link, node: Node, mapping: BridgeMapping, kept_stop: StopFile | None = None) -> None:
        self.link = link
        self._kept_stop = kept_stop or StopFile(None)
        self.node = node
        self.mapping = mapping
        self._words = RosWords(
            link, self._whole(mapping.emergency_stop) if mapping.emergency_stop else "", self._whole(_TAKE_CONTROL)
        )
        self.commands = Commands(link, node.log, self._words, lambda: node.stalls.why_old)
        self._throttle = Throttle(node.log)
        self._closed = threading.Event()
        self._model = link.codec.model
        self._deadlines = {d.then: d for d in self._model.deadlines if d.at == End.HOST}
        self._deadline_handler = node.failure.handler(self._on_deadline)
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
            self._release_over_topic = f"{mapping.emergency_stop}/release_over"
            self._subscribe(self._release_over_topic, "std_msgs/Empty", Qos(), lambda _: self._release_stop(over=True))
            self._hold_kept_stop(mapping.emergency_stop)
        if link.is_attached:  # else no other program can be in control
            self._subscribe(_TAKE_CONTROL, "std_msgs/Empty", Qos(), self._take_control)
        self._held_back = None
        self._asked = -math.inf  # when a message to take control came last
        self._has_recovered = threading.Event()
        if can_hold_back(self._model):
            self._held_back = HeldBack(link, self.commands, node.log, self._whole(mapping.recover))
            if self._held_back.topic:
                self._subscribe(mapping.recover, "std_msgs/Empty", Qos(), self._recover)
        self._serial = SerialTopics(link, self.commands, self._publisher, self._subscribe) if mapping.serial else None
        self._was_down = False
        self._stop_waits = False  # an emergency stop that the server has not taken yet
        self._oldest = 0.0  # seconds: the age of a message when it became a topic, since the latency was last published
        self._latency = None
        if mapping.latency is not None:
            self._latency = self._publisher(mapping.latency, "std_msgs/Float64", Qos())
        self._parameters = None
        if self._model.service("parameter") is not None:
            self._parameters = McuParameters(link, node, self._throttle.say, self._take)
        self._diagnostics = Diagnostics(link, self.commands, mapping, node, self._serial, self._held_back)
        self._diagnostics_out = self._publisher("/diagnostics", "diagnostic_msgs/DiagnosticArray", Qos())

    def run(self) -> None:
        """Run until ``close``. One thread.

        :raises LinkDownError: the link was closed before.
        """
        if self._deadlines:
            self.link.on_deadline()(self._deadline_handler)
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
                if now >= next_diagnosis or self._has_recovered.is_set():
                    self._has_recovered.clear()
                    next_diagnosis = now + _DIAGNOSE_EVERY
                    self._set_navigation()
                    self._tell_state()
                    if self._held_back is not None:
                        self._held_back.look()
                    self._diagnostics_out.publish(self._diagnostics.message(stamp_of(self.node.now_ns())))
                    self._tell_latency()
                if self._stop_waits:
                    self._stop()
                pace.wait()
                self._take(self.link.receive(_WAIT if self._serial is None else _SERIAL_WAIT))
                if self._serial is not None:
                    self._serial.take_sent()
        except LinkDownError:
            if not self._closed.is_set():
                raise
        finally:
            if self._parameters is not None:
                self._parameters.close()
            if self._deadlines:
                self.link.off(self._deadline_handler)

    def close(self) -> None:
        """Let ``run`` return. Any thread."""
        self._closed.set()

    def start(self) -> threading.Thread:
        """Start ``run`` in a thread of its own. If it ends by a fault, the node's ``failure`` says so."""
        thread = self.node.failure.thread(f"bridge of {self.mapping.node}", self.run)
        thread.start()
        return thread

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
        """Report that the port or the server is away, and that it is back."""
        is_down = self.link.state == "down"
        if is_down and not self._was_down:
            self.node.log("error", self.link.why)
        elif self._was_down and not is_down:
            self.node.log("info", f"the link is back: {self.link.device}")
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
                quick = _QuickCommand(self.commands, self.link.codec.tables.indices[incoming.message], framer)
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
        if values["data"]:
            self._stop_waits = True
            self._stop()
        else:
            self._release_stop(over=False)

    def _stop(self) -> None:
        """Send the emergency stop. A server that is away cannot take it: it gets the stop as soon as it is back."""
        try:
            self.link.emergency_stop()
        except WirebondError as error:
            text = f"emergency stop: NOT confirmed, trying again until false comes; {self._words.why(error)}"
            self._throttle.say("error", "stop", text)
            return
        self._stop_waits = False
        self._kept_stop.write(self._whole(self.mapping.emergency_stop or ""))
        held = "emergency stop: messages that move the robot are held back until false arrives"
        self._throttle.say("error", "emergency stop", held, _ACTS)  # a button may publish it all the time

    def _hold_kept_stop(self, topic: str) -> None:
        """Hold a stop that an earlier bridge left: commands may already be coming."""
        if self._kept_stop.read() is None:
            return
        self.link.emergency_stop()
        self.node.log(
            "error",
            "an emergency stop still holds, as before this node was started; look at the robot, then publish false to "
            f"{self._whole(topic)}",
        )

    def _release_stop(self, *, over: bool) -> None:
        """Release the stop, if there is one. A button may publish its state all the time: without a stop, nothing is
        released and no control taken."""
        if self._is_old("the emergency stop was not released"):
            return
        self._stop_waits = False
        try:
            was_stopped = self.link.stopped
            self.link.release_stop(over=over)
            if not was_stopped:
                return
            self._kept_stop.remove()
            self.link.take_control()
            self._throttle.say("warning", "released", "the emergency stop is released", _ACTS)
        except StoppedByOtherError as error:
            topic = self._whole(self._release_over_topic)
            self._throttle.say(
                "error",
                "release",
                f"the emergency stop still holds: {error.by} stopped the robot; look at the robot, then publish to "
                f"{topic}",
            )
        except WirebondError as error:
            self._throttle.say("error", "release", self._words.why(error))

    def _take_control(self, _: dict[str, Any]) -> None:
        """Take control for one message, which is a person's decision. A topic that is published all the time decides
        nothing: after another program released the emergency stop, it takes no control."""
        if self._is_old("control was not taken"):
            return
        now = time.monotonic()
        is_decision = now - self._asked > _DECISION
        self._asked = now
        try:
            self.link.take_control(over=(self.link.control.released_by or False) if is_decision else False)
        except WirebondError as error:
            self._throttle.say("error", "take control", self._words.why(error), _ACTS)
        else:
            self._throttle.say("info", "in control", "this node is in control of the robot", _ACTS)

    def _recover(self, _: dict[str, Any]) -> None:
        assert self._held_back is not None, "only then there is this topic"
        if self._is_old("nothing was recovered"):
            return
        self._held_back.recover()
        self._has_recovered.set()

    def _is_old(self, outcome: str) -> bool:
        """Check whether a message that lets the robot move again may be from before a stall, and log it with its
        outcome."""
        why = self.node.stalls.why_old
        if why:
            self._throttle.say("warning", outcome, f"{outcome}: {why}")
        return bool(why)

    def _poll(self) -> None:
        for name in self.mapping.poll:
            try:
                self.link.repeat(name, hold=_POLL_HOLD)
            except WirebondError as error:
                self._throttle.say("warning", f"poll {name}", f"{name} is not asked: {self._words.why(error, name)}")

    # ---- deadlines

    def _on_deadline(self, event: DeadlineEvent) -> None:
        words = deadline_words(self._deadlines[event.action])
        level, text = ("warning", words) if event.struck else ("info", "over")
        self._throttle.say(level, f"{event.action} {event.struck}", f"{event.action}: {text}", _ACTS)
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
