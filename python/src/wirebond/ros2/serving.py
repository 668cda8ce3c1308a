"""A bridge beside a server: it attaches to the server's link as any other program does, and needs no ROS."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from wirebond.codec import Codec
from wirebond.errors import UsageError
from wirebond.link import open_link
from wirebond.link.attached.attaching import attached_as
from wirebond.ros2.bridge import Bridge
from wirebond.ros2.mapping import BridgeMapping, default_mapping, load_mapping
from wirebond.ros2.node import whole_topic
from wirebond.ros2.types import MISSING

_PATIENCE = 5.0  # seconds that the bridge has to end


def mapping_for(codec: Codec, path: Path | None) -> BridgeMapping:
    """Return the mapping of this file; without one, of the file of the protocol's name in the folder ``ros2`` beside
    the protocol; without that, the default.

    :raises ProtocolFileError: the file is wrong.
    """
    beside = Path(codec.model.path).parent / "ros2" / Path(codec.model.path).name
    found = path or (beside if beside.is_file() else None)
    return default_mapping(codec.model) if found is None else load_mapping(found, codec.model)


@contextmanager
def bridge_to(address: str, mapping: BridgeMapping) -> Iterator[Bridge]:
    """Run a bridge in a thread of its own until the block ends.

    :param address: of a server, such as ``wirebond://diffdrive``.
    :raises UsageError: what ROS 2 needs is not installed.
    """
    try:
        from wirebond.ros2.dds import DdsNode  # noqa: PLC0415 an extra: most installations lack it
    except ImportError:
        raise UsageError(MISSING) from None
    with attached_as(f"ROS node {whole_topic(mapping.node, mapping.namespace, '')}"):
        link = open_link(address)
    with link:
        node = DdsNode(mapping.node, mapping.namespace)
        bridge = Bridge(link, node, mapping)
        thread = bridge.start()
        try:
            yield bridge
        finally:
            bridge.close()
            thread.join(_PATIENCE)
            node.close()
