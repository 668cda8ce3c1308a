"""A node in memory: what is published is kept, and what subscribers would get is given by hand."""

from __future__ import annotations

import threading
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

from tests import processes
from tests.waiting import PATIENCE
from wirebond.ros2.cdr import decode, encode
from wirebond.ros2.failure import Failure
from wirebond.ros2.node import Answer, Parameter, Qos, Quick
from wirebond.ros2.stalls import Stalls
from wirebond.ros2.subscriber import Subscriber
from wirebond.ros2.types import RosType, ServiceType


class FakePublisher:
    def __init__(self, node: FakeNode, topic: str, type_: RosType) -> None:
        self._node = node
        self._topic = topic
        self._type = type_

    def publish(self, values: Mapping[str, Any]) -> None:
        """As a subscriber gets it: through its bytes."""
        self.publish_encoded((encode(self._type, values),))

    def publish_encoded(self, messages: Iterable[bytes]) -> None:
        received = [decode(self._type, data) for data in messages]
        with self._node.changed:
            self._node.published[self._topic] += received
            self._node.changed.notify_all()


class FakeNode:
    """See ``node.Node``."""

    def __init__(self) -> None:
        self.published: defaultdict[str, list[dict[str, Any]]] = defaultdict(list)
        self.qos: dict[str, Qos] = {}
        self.types: dict[str, str] = {}
        self.take: dict[str, Callable[[dict[str, Any]], None]] = {}
        self.undecodable: Counter[str] = Counter()
        self.answer: dict[str, Answer] = {}  # of services
        self.failure = Failure()
        self.now = 0.0  # seconds, of the clock that finds stalls
        self.stalls = Stalls(lambda: self.now)
        self.parameters: dict[str, Parameter] = {}
        self.lines: list[tuple[str, str]] = []
        self.cancelled: list[str] = []
        self.changed = threading.Condition()
        self.is_started = threading.Event()

    def publisher(self, topic: str, type_: RosType, qos: Qos) -> FakePublisher:
        self.qos[topic], self.types[topic] = qos, type_.short
        return FakePublisher(self, topic, type_)

    def subscribe(
        self,
        topic: str,
        type_: RosType,
        qos: Qos,
        take: Callable[[dict[str, Any]], None],
        quick: Quick | None = None,
    ) -> None:
        """``quick`` is asked first, as an adapter with bytes does."""

        def note_undecodable() -> None:
            self.undecodable[topic] += 1

        subscriber = Subscriber(type_, take, note_undecodable, quick)

        def give(values: dict[str, Any]) -> None:
            subscriber.give([encode(type_, values)])
            subscriber.flush()

        self.qos[topic], self.types[topic], self.take[topic] = qos, type_.short, give

    def serve(self, service: str, type_: ServiceType, answer: Answer) -> None:
        """As a caller gets it: through its bytes."""

        def call(request: dict[str, Any]) -> dict[str, Any]:
            response = answer(decode(type_.request, encode(type_.request, request)))
            return decode(type_.response, encode(type_.response, response))

        self.types[service], self.answer[service] = type_.name, call

    def declare(self, parameter: Parameter) -> None:
        with self.changed:
            self.parameters[parameter.name] = parameter
            self.changed.notify_all()

    def update(self, name: str, value: float) -> None:
        with self.changed:
            self.parameters[name] = replace(self.parameters[name], value=value)
            self.changed.notify_all()

    def canceller(self, action: str) -> Callable[[], None]:
        return lambda: self.cancelled.append(action)

    def log(self, level: str, text: str) -> None:
        with self.changed:
            self.lines.append((level, text))
            self.changed.notify_all()

    def now_ns(self) -> int:
        return 1_000_000_000_000

    def start(self) -> None:
        self.is_started.set()

    def close(self) -> None:
        pass

    def newest(self, topic: str) -> dict[str, Any] | None:
        """Return the newest message of a topic. None: none was published yet, which a wait must allow for."""
        published = self.published[topic]
        return published[-1] if published else None

    def wait(self, what: Callable[[], Any]) -> Any:
        """Until this is true; what it gave."""
        with self.changed:
            found = self.changed.wait_for(what, timeout=PATIENCE)
        if not found:
            published = {topic: len(messages) for topic, messages in self.published.items()}
            error = AssertionError(f"waited {PATIENCE:g} s in vain; published {published}, logged {self.lines}")
            error.add_note(processes.account())
            raise error
        return found
