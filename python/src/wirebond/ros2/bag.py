"""A recording as a bag of ROS 2: MCAP with the schemas and the bytes of ROS. No link, no DDS."""

from __future__ import annotations

import os
import secrets
import shutil
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wirebond.errors import UsageError
from wirebond.protocol.model import End
from wirebond.ros2.cdr import encode
from wirebond.ros2.mapping import BridgeMapping
from wirebond.ros2.mapping.own_types import OwnTypes, own_topics
from wirebond.ros2.node import Qos, whole_topic
from wirebond.ros2.topics import Topics
from wirebond.ros2.types import MISSING, RosType

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.interfaces import Qos as BagQos
    from rosbags.rosbag2 import Writer

    from wirebond.recording import Recording

Progress = Callable[[int, int], object]
_TELL_EVERY = 1000  # messages


def write_bag(
    recording: Recording,
    folder: Path,
    mapping: BridgeMapping,
    message: str | None = None,
    *,
    force: bool = False,
    progress: Progress | None = None,
) -> list[str]:
    """Write a bag at ``folder``, or nothing. It has the topics of the mapping, and a topic of its own type for each
    message: ``/<node>/<message>`` for the MCU's, ``/<node>/<message>/sent`` for the host's.

    :param message: only this one; None: all.
    :param force: replace a bag that exists.
    :param progress: called as ``progress(done, size)``.
    :returns: sentences about what is not in it.
    :raises UsageError: what ROS 2 needs is not installed; there is such a folder; the recording has no message.
    :raises OSError: it cannot be written.
    """
    if os.path.lexists(folder):
        if not force:
            raise UsageError(
                f"{folder} exists already; nothing was written. Name another folder with -o, or replace with --force"
            )
        if not (folder / "metadata.yaml").is_file():
            raise UsageError(f"{folder} is not a bag, and is left as it is; remove it, or name another folder with -o")
    own = OwnTypes(recording.codec.model)
    with _unfinished(folder) as path, _Bag(path) as bag:
        faces = {End.MCU: _of_mcu(recording, bag, mapping, own), End.HOST: _of_host(recording, bag, mapping, own)}
        total = int(recording.duration * 1000)
        for number, (sender, received) in enumerate(recording.messages_of()):
            if progress is not None and number % _TELL_EVERY == 0:
                progress(int(received.t * 1000), total)
            if message not in (None, received.name):
                continue
            bag.at_ns = recording.wall_ns(received.t)
            stamp_ns = bag.at_ns if received.stamp is None else recording.wall_ns(received.stamp)
            faces[End(sender)].take([received], [stamp_ns])
        if not bag.count:
            raise UsageError("the recording has no such message" if message else "the recording has no message")
    return [f"{topic} lacks {count} messages: {why}" for (topic, why), count in bag.refused.items()]


def _of_mcu(recording: Recording, bag: _Bag, mapping: BridgeMapping, own: OwnTypes) -> Topics:
    model = recording.codec.model
    mapped = {outgoing.topic for outgoing in mapping.publish}
    more = tuple(one for one in own_topics(model, own, End.MCU, "~/{}") if one.topic not in mapped)
    return Topics(
        recording.codec,
        replace(mapping, publish=(*mapping.publish, *more), json_out=()),
        lambda topic, type_, qos: _BagTopic(bag, whole_topic(topic, mapping.namespace, mapping.node), type_, qos),
        bag.refuse,
    )


def _of_host(recording: Recording, bag: _Bag, mapping: BridgeMapping, own: OwnTypes) -> Topics:
    """Name topics of the host `sent`, not `send`: a bag that is played commands nothing."""
    return Topics(
        recording.codec,
        BridgeMapping(mapping.node, publish=own_topics(recording.codec.model, own, End.HOST, "~/{}/sent")),
        lambda topic, type_, qos: _BagTopic(bag, whole_topic(topic, mapping.namespace, mapping.node), type_, qos),
        bag.refuse,
    )


class _Bag:
    """The file while it is written.

    :ivar at_ns: the time of what is published next.
    :ivar refused: how often a topic had a value that it cannot hold, by topic and reason.
    """

    def __init__(self, path: Path) -> None:
        try:
            from rosbags.rosbag2 import StoragePlugin, Writer  # noqa: PLC0415 an extra: most installations lack it
            from rosbags.rosbag2.enums import CompressionFormat, CompressionMode  # noqa: PLC0415
        except ImportError:
            raise UsageError(MISSING) from None
        self.at_ns = 0
        self.count = 0
        self.refused: Counter[tuple[str, str]] = Counter()
        self._writer: Writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
        self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        self._connections: dict[str, Connection] = {}

    def __enter__(self) -> _Bag:
        self._writer.open()
        return self

    def __exit__(self, *_: object) -> None:
        self._writer.close()

    def refuse(self, topic: str, why: str) -> None:
        self.refused[topic, why] += 1

    def write(self, topic: _BagTopic, data: bytes) -> None:
        connection = self._connections.get(topic.name)
        if connection is None:
            connection = self._writer.add_connection(
                topic.name,
                topic.type.name,
                msgdef=topic.type.definition,
                rihs01=topic.type.hash,
                offered_qos_profiles=[_bag_qos(topic.qos)],
            )
            self._connections[topic.name] = connection
        self._writer.write(connection, self.at_ns, data)
        self.count += 1


class _BagTopic:
    """See ``node.Publisher``. A topic without messages is not in the bag."""

    def __init__(self, bag: _Bag, name: str, type_: RosType, qos: Qos) -> None:
        self.name = name
        self.type = type_
        self.qos = qos
        self._bag = bag

    def publish(self, values: Mapping[str, Any]) -> None:
        self.publish_encoded((encode(self.type, values),))

    def publish_encoded(self, messages: Iterable[bytes]) -> None:
        for data in messages:
            self._bag.write(self, data)


def _bag_qos(qos: Qos) -> BagQos:
    from rosbags.interfaces import (  # noqa: PLC0415 an extra: most installations lack it
        Qos as BagQos,
    )
    from rosbags.interfaces import QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime  # noqa: PLC0415

    forever = QosTime(9223372036, 854775807)
    return BagQos(
        QosHistory.KEEP_LAST,
        qos.depth,
        QosReliability.RELIABLE if qos.reliable else QosReliability.BEST_EFFORT,
        QosDurability.TRANSIENT_LOCAL if qos.latched else QosDurability.VOLATILE,
        forever,
        forever,
        QosLiveliness.AUTOMATIC,
        forever,
        avoid_ros_namespace_conventions=False,
    )


@contextmanager
def _unfinished(folder: Path) -> Iterator[Path]:
    """Yield a folder that does not exist yet; it becomes ``folder``, in place of one that exists, when the block ends
    without an exception."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    room = folder.parent / f".wirebond-{secrets.token_hex(6)}.tmp"
    room.mkdir()
    try:
        yield room / folder.name  # the files in it are named after it
        if folder.exists():
            folder.rename(room / "replaced")
        (room / folder.name).rename(folder)
    finally:
        shutil.rmtree(room, ignore_errors=True)
