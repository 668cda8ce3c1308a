"""The node that Wirebond's bridge asks for, over rclpy. See `wirebond.ros2.node`.

Messages pass as bytes, which rclpy takes and gives: both adapters have one way from values to bytes. Topics are given
to rclpy as the mapping has them, so that remaps and `qos_overrides` of the user hold.
"""

from __future__ import annotations

import importlib
import os
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from action_msgs.srv import CancelGoal
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.exceptions import InvalidParameterTypeException, ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy, qos_policy_name_from_kind
from rclpy.qos_overriding_options import QoSOverridingOptions

from wirebond.errors import UsageError, WirebondError
from wirebond.ros2.cdr import encode
from wirebond.ros2.failure import Failure
from wirebond.ros2.node import Answer, Parameter, Qos, Quick, mismatch
from wirebond.ros2.stalls import Stalls
from wirebond.ros2.subscriber import Subscriber
from wirebond.ros2.types import RosType, ServiceType
from wirebond_ros.calls import CallLoop
from wirebond_ros.taking import TakeLoop, Taken

_LOOK_EVERY = 0.1  # seconds between two checks for stalls, if the executor takes the messages


class RclpyPublisher:
    """See ``wirebond.ros2.node.Publisher``."""

    def __init__(self, publisher: Any, type_: RosType) -> None:
        self._publisher = publisher
        self._type = type_

    def publish(self, values: Mapping[str, Any]) -> None:
        """Send one message. Any thread."""
        self.publish_encoded((encode(self._type, values),))

    def publish_encoded(self, messages: Iterable[bytes]) -> None:
        """See ``wirebond.ros2.node.Publisher``. Any thread."""
        for data in messages:
            self._publisher.publish(data)


class RclpyNode:
    """See ``wirebond.ros2.node.Node``. Who makes it spins ``node``."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self.undecodable: Counter[str] = Counter()
        self._parameters: dict[str, Parameter] = {}
        self._started = threading.Event()
        self._updating = threading.local()  # in its thread: the parameter that is set because it has changed
        self.failure = Failure(lambda: not node.context.ok())
        self.stalls = Stalls()
        self._taking = TakeLoop(node.context, self.failure, self.stalls)
        if self._taking.group is None:
            node.create_timer(_LOOK_EVERY, self.stalls.look)
        self._calls = CallLoop(lambda text: self.log("error", text), self.failure)
        node.add_on_set_parameters_callback(self._set)

    def publisher(self, topic: str, type_: RosType, qos: Qos) -> RclpyPublisher:
        """See ``wirebond.ros2.node.Node``.

        :raises UsageError: this ROS 2 has no such type.
        """
        with _overrides_of(topic):
            publisher = self.node.create_publisher(
                class_of(type_),
                topic,
                _profile(qos),
                callback_group=self._taking.group,
                event_callbacks=PublisherEventCallbacks(incompatible_qos=self._teller(topic, is_publisher=True)),
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
            )
        self._taking.add_events(publisher)
        return RclpyPublisher(publisher, type_)

    def subscribe(
        self,
        topic: str,
        type_: RosType,
        qos: Qos,
        take: Callable[[dict[str, Any]], None],
        quick: Quick | None = None,
    ) -> None:
        """See ``wirebond.ros2.node.Node``. What comes before ``start`` is dropped.

        :raises UsageError: this ROS 2 has no such type.
        """

        def note_undecodable() -> None:
            self.undecodable[topic] += 1

        subscriber = Subscriber(type_, take, note_undecodable, quick)

        def received_alone(data: bytes) -> None:
            if self._started.is_set():
                subscriber.give([data])
                subscriber.flush()

        with _overrides_of(topic):
            subscription = self.node.create_subscription(
                class_of(type_),
                topic,
                received_alone,
                _profile(qos),
                callback_group=self._taking.group,
                event_callbacks=SubscriptionEventCallbacks(incompatible_qos=self._teller(topic, is_publisher=False)),
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
                raw=True,
            )
        self._taking.add(Taken(subscription, subscriber))
        self._taking.add_events(subscription)

    def serve(self, service: str, type_: ServiceType, answer: Answer) -> None:
        """See ``wirebond.ros2.node.Node``. Where this rclpy has no call that takes a request, its executor waits, too.

        :raises UsageError: this ROS 2 has no such type.
        """

        def respond(request: Any, response: Any) -> Any:
            given = {
                field.name: getattr(request, field.name)
                for field in type_.request.fields
                if hasattr(request, field.name)
            }
            for name, value in answer(given).items():
                setattr(response, name, value)
            return response

        class_ = class_named(type_.name, "srv", is_generated=False)
        self._calls.add(self.node.create_service(class_, service, respond, callback_group=self._calls.group))

    def declare(self, parameter: Parameter) -> None:
        """See ``wirebond.ros2.node.Node``.

        :raises WirebondError: the value that the user gave is not taken; that of ``parameter`` stays.
        """
        descriptor = ParameterDescriptor()
        descriptor.description = parameter.description
        if parameter.minimum is not None and parameter.maximum is not None and isinstance(parameter.value, float):
            span = FloatingPointRange()
            span.from_value, span.to_value = parameter.minimum, parameter.maximum
            descriptor.floating_point_range = [span]
        try:
            given = self.node.declare_parameter(parameter.name, parameter.value, descriptor).value
        except ParameterException as error:
            self.node.declare_parameter(parameter.name, parameter.value, descriptor, ignore_override=True)
            raise UsageError(words_of(error)) from None
        finally:
            self._parameters[parameter.name] = parameter  # not before: rclpy also asks `_set` about a declaration
        if given != parameter.value:
            try:
                parameter.set(given)
            except WirebondError:
                self.update(parameter.name, parameter.value)
                raise

    def update(self, name: str, value: float) -> None:
        """See ``wirebond.ros2.node.Node``."""
        self._updating.name = name
        try:
            self.node.set_parameters([RosParameter(name, value=value)])
        finally:
            self._updating.name = ""

    def canceller(self, action: str) -> Callable[[], None]:
        """See ``wirebond.ros2.node.Node``. A request without a goal and a time asks for all of them."""
        client = self.node.create_client(CancelGoal, f"{action}/_action/cancel_goal")

        def cancel() -> None:
            if client.service_is_ready():
                client.call_async(CancelGoal.Request())

        return cancel

    def log(self, level: str, text: str) -> None:
        """See ``wirebond.ros2.node.Node``."""
        # rclpy remembers the severity of each place in the code that logs, and raises if it changes. So each severity
        # has a call of its own.
        logger = self.node.get_logger()
        match level:
            case "debug":
                logger.debug(text)
            case "info":
                logger.info(text)
            case "warning":
                logger.warning(text)
            case _:
                logger.error(text)

    def now_ns(self) -> int:
        """See ``wirebond.ros2.node.Node``."""
        return int(self.node.get_clock().now().nanoseconds)

    def start(self) -> None:
        """See ``wirebond.ros2.node.Node``."""
        self._taking.drop_waiting()
        self.stalls.begin()
        self._started.set()
        self._taking.start()
        self._calls.start()

    def close(self) -> None:
        """See ``wirebond.ros2.node.Node``."""
        self._started.clear()
        self._taking.close()
        self._calls.close()

    def _teller(self, topic: str, *, is_publisher: bool) -> Callable[[Any], None]:
        def tell(event: Any) -> None:
            policy = qos_policy_name_from_kind(event.last_policy_kind).lower()
            self.log("warning", mismatch(topic, policy, is_publisher=is_publisher))

        return tell

    def _set(self, parameters: list[Any]) -> Any:
        """Set parameters. rclpy asks before it sets them, all or none: so a refused value leaves the others
        unchanged."""
        result = SetParametersResult()
        result.successful = True
        own = [p for p in parameters if p.name in self._parameters and p.name != getattr(self._updating, "name", "")]
        if len(own) > 1:
            result.successful = False
            result.reason = "set these one by one: each may be refused by itself"
            return result
        for parameter in own:
            try:
                self._parameters[parameter.name].set(parameter.value)
            except WirebondError as error:
                result.successful = False
                result.reason = str(error)
        return result


def class_of(type_: RosType) -> Any:
    """Return the class of these messages in rclpy.

    :raises UsageError: its package is not installed.
    """
    return class_named(type_.short, "msg", is_generated=type_.is_generated)


def class_named(short: str, room: str, *, is_generated: bool) -> Any:
    """Return the class of a type, such as ``std_srvs/Trigger``, which is in ``msg`` or in ``srv``.

    :raises UsageError: its package is not installed.
    """
    package, name = short.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.{room}"), name)
    except (ImportError, AttributeError):
        distribution = os.environ.get("ROS_DISTRO", "jazzy")
        advice = f"install its package: apt install ros-{distribution}-{package.replace('_', '-')}"
        if is_generated:
            advice = f"write its package by `wirebond gen --lang ros2`, build it with colcon, and source it: {package}"
        raise UsageError(f"this ROS 2 has no {short}; {advice}") from None


def words_of(error: Exception) -> str:
    """Say why the node does not start: an error of Wirebond as it is; one of rclpy, about names and parameters of the
    user, on one line, with advice."""
    text = str(error) if isinstance(error, WirebondError) else " ".join(str(error).split())
    is_of_yaml = isinstance(error, InvalidParameterTypeException) or "parameter override rule" in text
    return f"{text}; {_YAML}" if is_of_yaml else text


_YAML = (
    "values are YAML: a number that may have a fraction is 1.0, not 1, and a port that ends with a colon needs quotes: "
    "-p port:=\"'sim:'\""
)


@contextmanager
def _overrides_of(topic: str) -> Iterator[None]:
    """Turn errors of rclpy about overrides into sentences.

    :raises UsageError: the user's ``qos_overrides`` of this topic have no such value.
    """
    try:
        yield
    except RuntimeError as error:
        if "QoS override" not in str(error):
            raise
        raise UsageError(f"{topic}: {error}; correct its qos_overrides") from None


def _profile(qos: Qos) -> QoSProfile:
    return QoSProfile(
        depth=qos.depth,
        reliability=QoSReliabilityPolicy.RELIABLE if qos.reliable else QoSReliabilityPolicy.BEST_EFFORT,
        durability=QoSDurabilityPolicy.TRANSIENT_LOCAL if qos.latched else QoSDurabilityPolicy.VOLATILE,
    )
