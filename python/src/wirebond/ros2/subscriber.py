"""Takes the messages of one topic, for both adapters: fast if possible, else by their values."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from wirebond.ros2.cdr import decode
from wirebond.ros2.node import Quick
from wirebond.ros2.types import RosType


@dataclass(frozen=True)
class Subscriber:
    """See ``node.Node.subscribe``. One thread at a time.

    :ivar undecodable: called for each that is not a message of the type.
    """

    type: RosType
    take: Callable[[dict[str, Any]], None]
    undecodable: Callable[[], None]
    quick: Quick | None = None

    def give(self, messages: list[bytes]) -> None:
        """Give the samples that came, in this order."""
        first = 0
        while first < len(messages):
            if self.quick is not None:
                first += self.quick.take(messages, first)
                if first == len(messages):
                    break
            try:
                values = decode(self.type, messages[first])
            except ValueError:
                self.undecodable()
            else:
                self.take(values)
            first += 1

    def flush(self) -> None:
        """Note that no more messages have come for the moment."""
        if self.quick is not None:
            self.quick.flush()
