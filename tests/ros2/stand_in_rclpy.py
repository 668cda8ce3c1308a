"""What the package `wirebond_ros` uses of rclpy, in memory: for machines without ROS 2. It has rclpy's names and its
types of values, and no network."""

from __future__ import annotations

import sys
import time
from array import array
from functools import cache
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from wirebond.ros2.cdr import default_of
from wirebond.ros2.types import DEFAULTS, Kind, RosField, RosType, ros_type


@cache
def get_message(name: str) -> type:
    """A class of messages: each field begins as rclpy has it, and takes only what rclpy takes."""
    type_ = ros_type(name)
    assert type_ is not None

    def begin(self: Any) -> None:
        for field in type_.fields:
            object.__setattr__(self, field.name, _begin(type_, field))

    def assign(self: Any, field_name: str, value: Any) -> None:
        field = type_.field(field_name)
        assert field is not None, f"{name} has no {field_name}"
        _check(field, value)
        is_numbers = field.kind == Kind.SEQUENCE and field.base == "uint8"
        object.__setattr__(self, field_name, array("B", value) if is_numbers else value)

    return type(type_.name.replace("/", "_"), (), {"__init__": begin, "__setattr__": assign})


def _begin(type_: RosType, field: RosField) -> Any:
    if field.of is not None:
        return get_message(field.of.name)() if field.kind == Kind.ONE else []
    if field.base == "byte":
        return b"\0"
    value = DEFAULTS.get(type_.name, {}).get(field.name, default_of(field))
    if field.kind != Kind.ONE:
        return array("B") if field.base == "uint8" else list(value)
    return float(value) if field.base.startswith("float") else value


def _check(field: RosField, value: Any) -> None:
    for one in [value] if field.kind == Kind.ONE else value:
        if field.of is not None:
            assert type(one) is get_message(field.of.name), field
        elif field.base == "byte":
            assert isinstance(one, bytes), field
            assert len(one) == 1
        else:
            wanted = {"bool": bool, "string": str}.get(field.base, float if field.base.startswith("float") else int)
            assert isinstance(one, wanted), (field, one)


class Node:
    """A node that keeps what it publishes."""

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        self.published: dict[str, list[Any]] = {}
        self.profiles: dict[str, Any] = {}
        self.callbacks: dict[str, Any] = {}
        self.descriptors: dict[str, Any] = {}
        self.lines: list[tuple[str, str]] = []
        self.set_parameters: Any = None
        self._given = parameters or {}

    def create_publisher(self, class_: type, topic: str, profile: Any, *, qos_overriding_options: Any) -> Any:
        assert qos_overriding_options is not None
        self.profiles[topic] = profile
        kept = self.published.setdefault(topic, [])

        def publish(message: Any) -> None:
            assert type(message) in (class_, bytes)
            kept.append(message)

        return SimpleNamespace(publish=publish)

    def create_subscription(self, class_: type, topic: str, take: Any, profile: Any, **options: Any) -> Any:
        self.profiles[topic], self.callbacks[topic] = profile, take
        return SimpleNamespace()

    def declare_parameter(self, name: str, value: Any, descriptor: Any) -> Any:
        self.descriptors[name] = descriptor
        return SimpleNamespace(value=self._given.get(name, value))

    def add_on_set_parameters_callback(self, function: Any) -> None:
        self.set_parameters = function

    def get_logger(self) -> Any:
        levels = ("debug", "info", "warning", "error", "fatal")
        return SimpleNamespace(
            **{level: lambda text, level=level: self.lines.append((level, text)) for level in levels}
        )

    def get_name(self) -> str:
        return "base"

    def get_namespace(self) -> str:
        return "/robot1"

    def destroy_node(self) -> None:
        pass

    def spin(self) -> None:
        """Until the rover has said where it is."""
        while not self.published.get("/robot1/odom"):
            time.sleep(0.01)

    def get_clock(self) -> Any:
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=5_000_000_000))


def install(patch: pytest.MonkeyPatch) -> list[Node]:
    """Let the modules of rclpy be these. Nodes that `create_node` will give belong into the list."""
    nodes: list[Node] = []
    policies = SimpleNamespace(RELIABLE="reliable", BEST_EFFORT="best effort")
    durability = SimpleNamespace(TRANSIENT_LOCAL="transient local", VOLATILE="volatile")
    contents: dict[str, dict[str, Any]] = {
        "rclpy": {
            "init": lambda args: None,
            "create_node": lambda name: nodes.pop(),
            "spin": lambda node: node.spin(),
            "try_shutdown": lambda: None,
        },
        "rclpy.executors": {"ExternalShutdownException": type("ExternalShutdownException", (Exception,), {})},
        "rclpy.node": {"Node": Node},
        "rclpy.qos": {
            "QoSProfile": SimpleNamespace,
            "QoSReliabilityPolicy": policies,
            "QoSDurabilityPolicy": durability,
        },
        "rclpy.qos_overriding_options": {
            "QoSOverridingOptions": SimpleNamespace(with_default_policies=lambda: "all of them")
        },
        "rcl_interfaces": {},
        "rcl_interfaces.msg": dict.fromkeys(
            ("FloatingPointRange", "ParameterDescriptor", "SetParametersResult"), SimpleNamespace
        ),
        "rosidl_runtime_py": {},
        "rosidl_runtime_py.utilities": {"get_message": get_message},
    }
    for name, names in contents.items():
        module = ModuleType(name)
        vars(module).update(names)
        patch.setitem(sys.modules, name, module)
    return nodes
