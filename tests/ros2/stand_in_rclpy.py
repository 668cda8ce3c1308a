"""What the package `wirebond_ros` uses of rclpy, in memory: for machines without ROS 2. It has rclpy's names and its
types of values, and no network."""

from __future__ import annotations

import sys
import time
from contextlib import nullcontext
from functools import cache
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from wirebond.ros2.cdr import decode
from wirebond.ros2.types import ros_type, type_names


@cache
def get_message(name: str) -> type:
    """What stands for a class of messages: the adapter gives and takes bytes."""
    return type(name.replace("/", "_"), (), {"ros_name": name})


class Subscription:
    """What waits for its subscriber, and the calls by which it is taken."""

    def __init__(self, class_: Any) -> None:
        self.msg_type = class_
        self.handle = self
        self.event_handlers: list[Any] = []
        self.waiting: list[bytes] = []

    def take_message(self, class_: Any, raw: bool) -> tuple[bytes, None] | None:
        assert (class_, raw) == (self.msg_type, True)
        return (self.waiting.pop(0), None) if self.waiting else None

    def __enter__(self) -> None:
        pass

    def __exit__(self, *_: object) -> None:
        pass


class WaitSet:
    """Waits a little, whatever comes."""

    def __init__(self, *_: Any) -> None:
        pass

    def clear_entities(self) -> None:
        pass

    def add_subscription(self, _: Any) -> None:
        pass

    def wait(self, timeout_ns: int) -> None:
        time.sleep(min(timeout_ns * 1e-9, 0.002))


class Node:
    """A node that keeps what it publishes."""

    def __init__(self, parameters: dict[str, Any] | None = None) -> None:
        self.published: dict[str, list[Any]] = {}
        self.profiles: dict[str, Any] = {}
        self.callbacks: dict[str, Any] = {}
        self.subscriptions: dict[str, Subscription] = {}
        self.descriptors: dict[str, Any] = {}
        self.lines: list[tuple[str, str]] = []
        self.set_parameters: Any = None
        self.services: set[str] = set()  # that other nodes serve
        self.asked: list[str] = []
        self.served: dict[str, Any] = {}
        self.context = SimpleNamespace(handle=nullcontext(), ok=lambda: True)
        self._given = parameters or {}

    def create_publisher(self, class_: Any, topic: str, profile: Any, **options: Any) -> Any:
        assert set(options) == {"callback_group", "event_callbacks", "qos_overriding_options"}
        self.profiles[topic] = profile
        kept = self.published.setdefault(topic, [])

        def publish(message: Any) -> None:
            assert isinstance(message, bytes)
            type_ = ros_type(class_.ros_name)
            assert type_ is not None
            kept.append(decode(type_, message))

        return SimpleNamespace(publish=publish, event_handlers=[])

    def create_subscription(self, class_: Any, topic: str, take: Any, profile: Any, **options: Any) -> Any:
        assert options["raw"]
        self.profiles[topic], self.callbacks[topic] = profile, take
        subscription = Subscription(class_)
        self.subscriptions[topic] = subscription
        return subscription

    def create_service(self, class_: Any, name: str, answer: Any, callback_group: Any) -> Any:
        self.served[name] = lambda: answer(class_.Request(), class_.Response())
        return SimpleNamespace()

    def declare_parameter(self, name: str, value: Any, descriptor: Any) -> Any:
        self.descriptors[name] = descriptor
        return SimpleNamespace(value=self._given.get(name, value))

    def add_on_set_parameters_callback(self, function: Any) -> None:
        self.set_parameters = function

    def create_client(self, class_: Any, name: str) -> Any:
        ready, asked = self.services, self.asked
        return SimpleNamespace(service_is_ready=lambda: name in ready, call_async=lambda _: asked.append(name))

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


class Executor:
    """Spins each of its nodes in turn, and then ROS has ended."""

    has_ended = False

    def __init__(self) -> None:
        self._nodes: list[Node] = []

    def add_node(self, node: Node) -> None:
        self._nodes.append(node)

    def spin_once(self, timeout_sec: float) -> None:
        assert timeout_sec > 0
        for node in self._nodes:
            node.spin()
        Executor.has_ended = True


def install(patch: pytest.MonkeyPatch, *, has_take: bool = True) -> list[Node]:
    """Let the modules of rclpy be these. Nodes that `create_node` will give belong into the list.

    :param has_take: whether this rclpy has the call that a take loop needs.
    """
    Executor.has_ended = False
    implementation = {"Subscription": Subscription if has_take else object, "WaitSet": WaitSet}
    nodes: list[Node] = []
    policies = SimpleNamespace(RELIABLE="reliable", BEST_EFFORT="best effort")
    durability = SimpleNamespace(TRANSIENT_LOCAL="transient local", VOLATILE="volatile")
    contents: dict[str, dict[str, Any]] = {
        "rclpy": {
            "init": lambda args: None,
            "create_node": lambda name: nodes.pop(),
            "try_shutdown": lambda: None,
            "ok": lambda: not Executor.has_ended,
        },
        "rclpy.executors": {
            "ExternalShutdownException": type("ExternalShutdownException", (Exception,), {}),
            "SingleThreadedExecutor": Executor,
        },
        "rclpy.utilities": {"remove_ros_args": lambda args: args},
        "rclpy.node": {"Node": Node},
        "rclpy.parameter": {"Parameter": lambda name, value: SimpleNamespace(name=name, value=value)},
        "rclpy.callback_groups": {"CallbackGroup": object},
        "rclpy.impl": {},
        "rclpy.impl.implementation_singleton": {"rclpy_implementation": SimpleNamespace(**implementation)},
        "rclpy.qos": {
            "QoSProfile": SimpleNamespace,
            "QoSReliabilityPolicy": policies,
            "QoSDurabilityPolicy": durability,
            "qos_policy_name_from_kind": str,
        },
        "rclpy.event_handler": dict.fromkeys(
            ("PublisherEventCallbacks", "SubscriptionEventCallbacks"), SimpleNamespace
        ),
        "rclpy.qos_overriding_options": {
            "QoSOverridingOptions": SimpleNamespace(with_default_policies=lambda: "all of them")
        },
        "action_msgs": {},
        "action_msgs.srv": {"CancelGoal": SimpleNamespace(Request=SimpleNamespace)},
        "std_srvs": {},
        "std_srvs.srv": {"Trigger": SimpleNamespace(Request=SimpleNamespace, Response=SimpleNamespace)},
        "rcl_interfaces": {},
        "rcl_interfaces.msg": dict.fromkeys(
            ("FloatingPointRange", "ParameterDescriptor", "SetParametersResult"), SimpleNamespace
        ),
    }
    for name in type_names():
        package, last = name.split("/")
        contents.setdefault(package, {})
        contents.setdefault(f"{package}.msg", {})
        if package != "rcl_interfaces":  # a node's parameters are made of those, and the adapter publishes none
            contents[f"{package}.msg"][last] = get_message(f"{package}/msg/{last}")
    for name, names in contents.items():
        module = ModuleType(name)
        vars(module).update(names)
        patch.setitem(sys.modules, name, module)
    return nodes
