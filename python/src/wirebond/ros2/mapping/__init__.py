"""The file that says which message is which topic of ROS 2: read, looked up, and compared with both sides."""

from wirebond.ros2.mapping.model import BridgeMapping
from wirebond.ros2.mapping.reader import default_mapping, load_mapping, read_mapping

__all__ = ["BridgeMapping", "default_mapping", "load_mapping", "read_mapping"]
