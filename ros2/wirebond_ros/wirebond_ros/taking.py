"""Subscriptions that one thread empties in a loop. rclpy's executor waits for each message alone: at about 9 000
messages a second it needs a whole core, and the loop a sixth of one.

The call `take_message` is what the executor itself uses, and is not documented. Where a version of rclpy lacks it, the
executor serves the subscriptions as it does all others.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.subscription import Subscription

from wirebond_ros.not_spun import NotSpun

_BUSY_WAIT = 0.0005  # seconds between two looks while messages come
_IDLE_WAIT = 0.002
_BUSY_FOR = 0.1  # seconds without a message until a look every `_IDLE_WAIT` is enough


@dataclass(frozen=True)
class Taken:
    """A subscription of rclpy, what takes its messages, and what is called when no more have come for the moment."""

    subscription: Any
    take: Callable[[bytes], None]
    flush: Callable[[], None] | None

    def next(self) -> bytes | None:
        """The next message that waits; None: there is none."""
        with self.subscription.handle:
            found = self.subscription.handle.take_message(self.subscription.msg_type, True)
        return None if found is None else bytes(found[0])


class TakeLoop:
    """The thread, and what it empties.

    :ivar group: for ``create_subscription``; None: the executor must serve them.
    """

    def __init__(self) -> None:
        self.group = NotSpun(Subscription) if _can_take() else None
        self._taken: list[Taken] = []
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name="ROS 2 topics", daemon=True)

    def add(self, taken: Taken) -> None:
        """Before ``start``."""
        self._taken.append(taken)

    def drop_waiting(self) -> None:
        """Forget what came until now."""
        if self.group is not None:
            for taken in self._taken:
                while taken.next() is not None:
                    pass

    def start(self) -> None:
        """Begin to call."""
        if self.group is not None and self._taken:
            self._thread.start()

    def close(self) -> None:
        """Nothing is called after this."""
        self._closed.set()
        if self._thread.is_alive() and threading.current_thread() is not self._thread:
            self._thread.join(5.0)

    def _run(self) -> None:
        busy_until = 0.0
        while not self._closed.is_set():
            found = False
            for taken in self._taken:
                has_some = False
                while (data := taken.next()) is not None:
                    has_some = True
                    taken.take(data)
                if has_some and taken.flush is not None:
                    taken.flush()
                found |= has_some
            now = time.monotonic()
            if found:
                busy_until = now + _BUSY_FOR
            self._closed.wait(_BUSY_WAIT if now < busy_until else _IDLE_WAIT)


def _can_take() -> bool:
    return hasattr(getattr(rclpy_implementation, "Subscription", None), "take_message")
