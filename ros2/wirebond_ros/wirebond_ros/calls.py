"""Services that one thread takes and others answer. An MCU may keep a call waiting for a second; rclpy's executor would
wait with it, and with it all other services and parameters of the process.

The call `service_take_request` is what the executor itself uses, and is not documented. Where a version of rclpy lacks
it, the executor serves the services as it does all others.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation

from wirebond.ros2.failure import Failure
from wirebond_ros.not_spun import NotSpun

_LOOK_EVERY = 0.02  # seconds
_AT_ONCE = 4  # calls that are answered at the same time


class CallLoop:
    """The threads, and the services that they answer.

    :ivar group: for ``create_service``; None: the executor must serve them.
    """

    def __init__(self, fail: Callable[[str], None], failure: Failure) -> None:
        """``fail``: takes the sentence for an answer that could not be made. ``failure``: makes the thread."""
        self.group = NotSpun() if _can_take() else None
        self._fail = fail
        self._services: list[Any] = []
        self._closed = threading.Event()
        self._thread = failure.thread("ROS 2 services", self._run)
        self._pool = ThreadPoolExecutor(_AT_ONCE, "ROS 2 answers")

    def add(self, service: Any) -> None:
        """Add a call, before ``start``."""
        self._services.append(service)

    def start(self) -> None:
        """Begin to answer."""
        if self.group is not None and self._services:
            self._thread.start()

    def close(self) -> None:
        """Close: no answer begins after this."""
        self._closed.set()
        if self._thread.is_alive() and threading.current_thread() is not self._thread:
            self._thread.join(5.0)
        self._pool.shutdown(wait=False, cancel_futures=True)

    def _run(self) -> None:
        while not self._closed.wait(_LOOK_EVERY):
            for service in self._services:
                while (asked := _next(service)) is not None:
                    self._pool.submit(self._answer, service, *asked)

    def _answer(self, service: Any, request: Any, header: Any) -> None:
        try:
            service.send_response(service.callback(request, service.srv_type.Response()), header)
        except Exception as error:
            if not self._closed.is_set():  # else its node is gone
                self._fail(f"a call of {service.srv_name} could not be answered: {error!r}")
                raise


def _next(service: Any) -> tuple[Any, Any] | None:
    """Return the next waiting request and its caller; None: there is none."""
    with service.handle:
        found = service.handle.service_take_request(service.srv_type.Request)
    return None if found is None or found[0] is None else (found[0], found[1])


def _can_take() -> bool:
    return hasattr(getattr(rclpy_implementation, "Service", None), "service_take_request")
