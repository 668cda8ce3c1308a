"""The receiver of a topic's messages: quick where it can be, and in the order of arrival."""

from __future__ import annotations

from typing import Any

from wirebond.ros2.cdr import encode
from wirebond.ros2.subscriber import Subscriber
from wirebond.ros2.topics import known

NUMBER = known("std_msgs/UInt8")


class Even:
    """Takes even numbers alone."""

    def __init__(self, taken: list[Any]) -> None:
        self._taken = taken

    def take(self, messages: list[bytes], first: int) -> int:
        count = 0
        for data in messages[first:]:
            if data[-1] % 2:
                break
            self._taken.append(data[-1])
            count += 1
        return count

    def flush(self) -> None:
        self._taken.append("flush")


def test_messages_that_are_not_taken_quickly_keep_their_place() -> None:
    taken: list[Any] = []
    subscriber = Subscriber(NUMBER, taken.append, lambda: taken.append("none"), Even(taken))
    numbers = [encode(NUMBER, {"data": number}) for number in (2, 4, 5, 7, 8)]
    subscriber.give([*numbers, b"\x00\x01\x00\x01", numbers[0]])
    subscriber.flush()
    assert taken == [2, 4, {"data": 5}, {"data": 7}, 8, "none", 2, "flush"]


def test_without_a_quick_way_all_go_by_their_values() -> None:
    taken: list[Any] = []
    subscriber = Subscriber(NUMBER, taken.append, lambda: None)
    subscriber.give([encode(NUMBER, {"data": number}) for number in (1, 2)])
    subscriber.flush()
    assert taken == [{"data": 1}, {"data": 2}]
