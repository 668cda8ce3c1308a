"""Other nodes that have another type on a topic of this node: DDS keeps them apart, and says nothing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription
from cyclonedds.domain import DomainParticipant

from wirebond.ros2.node import type_mismatch
from wirebond.ros2.types import RosType

_AT_ONCE = 256  # endpoints


class TypeWatch:
    """Reads the endpoints that were discovered since the last call."""

    def __init__(self, participant: DomainParticipant, tell: Callable[[str], None]) -> None:
        self._tell = tell
        self._writers: Any = BuiltinDataReader(participant, BuiltinTopicDcpsPublication)
        self._readers: Any = BuiltinDataReader(participant, BuiltinTopicDcpsSubscription)
        self._told: set[bytes] = set()

    def look(self, published: Mapping[str, RosType], expected: Mapping[str, RosType]) -> None:
        """Look at ``published`` and ``expected``, the types of this node's topics."""
        for found, own, is_publisher in ((self._readers, published, True), (self._writers, expected, False)):
            for endpoint in found.take(_AT_ONCE):
                name = endpoint.topic_name or ""  # None: it has left
                topic = name.removeprefix("rt")
                type_ = own.get(topic) if name != topic else None
                if type_ is None or endpoint.type_name == type_.dds_name or endpoint.key.bytes in self._told:
                    continue
                self._told.add(endpoint.key.bytes)
                theirs = endpoint.type_name.replace("::msg::dds_::", "/").removesuffix("_")
                self._tell(type_mismatch(topic, theirs, type_.short, is_publisher=is_publisher))
