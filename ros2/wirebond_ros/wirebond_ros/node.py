"""The node that Wirebond's bridge asks for, over rclpy. See `wirebond.ros2.node`.

Topics are given to rclpy as the mapping has them, so that remaps and `qos_overrides` of the user hold.
"""

from __future__ import annotations

import threading
from array import array
from collections.abc import Callable, Mapping
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rosidl_runtime_py.utilities import get_message

from wirebond.ros2.node import Parameter, Qos
from wirebond.ros2.types import Kind, RosField, RosType

LEVELS = {"debug": "debug", "info": "info", "warning": "warning", "error": "error"}


class RclpyPublisher:
    """See ``wirebond.ros2.node.Publisher``."""

    def __init__(self, publisher: Any, type_: RosType) -> None:
        self._publisher = publisher
        self._type = type_

    def publish(self, values: Mapping[str, Any]) -> None:
        """Send one message. Any thread."""
        self._publisher.publish(to_message(self._type, values))

    def publish_bytes(self, data: bytes) -> None:
        """See ``wirebond.ros2.node.Publisher``: rclpy takes a message that is serialized already. Any thread."""
        self._publisher.publish(data)


class RclpyNode:
    """See ``wirebond.ros2.node.Node``. Who makes it spins ``node``."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self._parameters: dict[str, Parameter] = {}
        self._subscriptions: list[Any] = []
        self._started = threading.Event()
        node.add_on_set_parameters_callback(self._set)

    def publisher(self, topic: str, type_: RosType, qos: Qos) -> RclpyPublisher:
        """See ``wirebond.ros2.node.Node``."""
        publisher = self.node.create_publisher(
            get_message(type_.name),
            topic,
            _profile(qos),
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )
        return RclpyPublisher(publisher, type_)

    def subscribe(self, topic: str, type_: RosType, qos: Qos, take: Callable[[dict[str, Any]], None]) -> None:
        """See ``wirebond.ros2.node.Node``. What comes before ``start`` is dropped."""

        def received(message: Any) -> None:
            if self._started.is_set():
                take(to_values(type_, message))

        self._subscriptions.append(
            self.node.create_subscription(
                get_message(type_.name),
                topic,
                received,
                _profile(qos),
                qos_overriding_options=QoSOverridingOptions.with_default_policies(),
            )
        )

    def declare(self, parameter: Parameter) -> None:
        """See ``wirebond.ros2.node.Node``."""
        span = FloatingPointRange()
        span.from_value, span.to_value = parameter.minimum, parameter.maximum
        descriptor = ParameterDescriptor()
        descriptor.description = parameter.description
        descriptor.floating_point_range = [span]
        given = self.node.declare_parameter(parameter.name, parameter.value, descriptor).value
        parameter.set(given)
        self._parameters[parameter.name] = parameter

    def log(self, level: str, text: str) -> None:
        """See ``wirebond.ros2.node.Node``."""
        getattr(self.node.get_logger(), LEVELS[level])(text)

    def now_ns(self) -> int:
        """See ``wirebond.ros2.node.Node``."""
        return int(self.node.get_clock().now().nanoseconds)

    def start(self) -> None:
        """See ``wirebond.ros2.node.Node``."""
        self._started.set()

    def close(self) -> None:
        """See ``wirebond.ros2.node.Node``."""
        self._started.clear()

    def _set(self, parameters: list[Any]) -> Any:
        for parameter in parameters:
            if parameter.name in self._parameters:
                self._parameters[parameter.name].set(parameter.value)
        result = SetParametersResult()
        result.successful = True
        return result


def to_message(type_: RosType, values: Mapping[str, Any]) -> Any:
    """A message of rclpy; what the values lack has the default of ROS."""
    message = get_message(type_.name)()
    for name, value in values.items():
        field = type_.field(name)
        if field is None:
            raise ValueError(f"{type_.short} has no field {name}")
        setattr(message, name, _to_field(field, value))
    return message


def _to_field(field: RosField, value: Any) -> Any:
    if field.of is not None:
        return to_message(field.of, value) if field.kind == Kind.ONE else [to_message(field.of, one) for one in value]
    if field.kind != Kind.ONE:
        return list(value) if field.base != "byte" else [bytes([one]) for one in value]
    if field.base == "byte":
        return bytes([value])  # as rclpy has it
    return float(value) if field.base.startswith("float") else value


def to_values(type_: RosType, message: Any) -> dict[str, Any]:
    """A message of rclpy as a dict."""
    return {field.name: _from_field(field, getattr(message, field.name)) for field in type_.fields}


def _from_field(field: RosField, value: Any) -> Any:
    if field.of is not None:
        return to_values(field.of, value) if field.kind == Kind.ONE else [to_values(field.of, one) for one in value]
    if field.base == "byte":
        return value[0] if field.kind == Kind.ONE else [one[0] for one in value]
    if isinstance(value, array):
        return value.tobytes() if field.base == "uint8" else value.tolist()
    return value


def _profile(qos: Qos) -> QoSProfile:
    return QoSProfile(
        depth=qos.depth,
        reliability=QoSReliabilityPolicy.RELIABLE if qos.reliable else QoSReliabilityPolicy.BEST_EFFORT,
        durability=QoSDurabilityPolicy.TRANSIENT_LOCAL if qos.latched else QoSDurabilityPolicy.VOLATILE,
    )
