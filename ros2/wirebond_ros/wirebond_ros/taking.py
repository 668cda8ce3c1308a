"""Subscriptions and events that one thread serves in a loop. rclpy's executor waits for each message alone: at about
9 000 messages a second it needs a whole core, and the loop a sixth of one. With Fast DDS the events of a subscription
wake the executor for each of its messages, too, so they are looked at here.

The loop uses calls of rclpy that its executor uses, and that are not documented. Where a version of rclpy lacks them,
the executor serves all.
"""

from __future__ import annotations

import threading
import time
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation

from wirebond.ros2.failure import Failure
from wirebond.ros2.pace import Pace
from wirebond.ros2.stalls import Stalls
from wirebond.ros2.subscriber import Subscriber
from wirebond_ros.not_spun import NotSpun

_AT_ONCE = 256  # messages of one subscription before the next one's turn
_GATHER = 0.001  # seconds that messages may wait for others at a high rate
_BUSY_FOR = 0.005  # seconds without a message until the thread sleeps until one comes
_WAKE_NS = 100_000_000  # how long the end of the node may have to wait
_LOOK_EVERY = 1.0  # seconds between two checks for events while messages come


@dataclass(frozen=True)
class Taken:
    """A subscription of rclpy, and what takes its messages."""

    subscription: Any
    subscriber: Subscriber

    def take(self) -> list[bytes]:
        """Return the waiting messages, in their order."""
        taken: list[bytes] = []
        handle, type_ = self.subscription.handle, self.subscription.msg_type
        with handle:
            while len(taken) < _AT_ONCE and (found := handle.take_message(type_, True)) is not None:
                taken.append(bytes(found[0]))
        return taken


class TakeLoop:
    """The thread, and what it serves.

    :ivar group: for ``create_subscription`` and ``create_publisher``; None: the executor must serve them.
    """

    def __init__(self, context: Any, failure: Failure, stalls: Stalls) -> None:
        self.group = NotSpun() if _can_take() else None
        self._context = context
        self._stalls = stalls
        self._taken: list[Taken] = []
        self._events: list[Any] = []
        self._closed = threading.Event()
        self._thread = failure.thread("ROS 2 topics", self._run)

    def add(self, taken: Taken) -> None:
        """Add a subscription, before ``start``."""
        self._taken.append(taken)

    def add_events(self, entity: Any) -> None:
        """Add the events of a publisher or a subscription, before ``start``."""
        self._events += entity.event_handlers

    def drop_waiting(self) -> None:
        """Forget what came until now."""
        if self.group is not None:
            for taken in self._taken:
                while taken.take():
                    pass

    def start(self) -> None:
        """Begin to call."""
        if self.group is not None:
            self._thread.start()

    def close(self) -> None:
        """Close: nothing is called after this."""
        self._closed.set()
        if self._thread.is_alive() and threading.current_thread() is not self._thread:
            self._thread.join(5.0)

    def _run(self) -> None:
        pace = Pace(_GATHER)
        busy_until = next_look = 0.0
        while not self._closed.is_set():
            pace.wait()
            self._stalls.look()
            found = False
            for taken in self._taken:
                if messages := taken.take():
                    found = True
                    taken.subscriber.give(messages)
            now = time.monotonic()
            if found:
                busy_until = now + _BUSY_FOR
                for taken in self._taken:
                    taken.subscriber.flush()
            if now >= busy_until or now >= next_look:
                next_look = now + _LOOK_EVERY
                self._wait(_WAKE_NS if now >= busy_until else 0)

    def _wait(self, timeout_ns: int) -> None:
        """Wait until a message comes, or an event of a publisher or a subscription, which is reported."""
        with ExitStack() as used:
            for each in (self._context.handle, *(taken.subscription.handle for taken in self._taken), *self._events):
                used.enter_context(each)
            waits = rclpy_implementation.WaitSet(len(self._taken), 0, 0, 0, 0, len(self._events), self._context.handle)
            waits.clear_entities()
            for taken in self._taken:
                waits.add_subscription(taken.subscription.handle)
            for event in self._events:
                event.add_to_wait_set(waits)
            waits.wait(timeout_ns)
            happened = [(event, event.take_data()) for event in self._events if event.is_ready(waits)]
        for event, data in happened:
            if data is not None:
                event.callback(data)


def _can_take() -> bool:
    return hasattr(getattr(rclpy_implementation, "Subscription", None), "take_message") and hasattr(
        rclpy_implementation, "WaitSet"
    )
