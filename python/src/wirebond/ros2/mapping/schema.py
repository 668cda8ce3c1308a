"""The JSON Schema of mapping files, for editors.

``python -m wirebond.ros2.mapping.schema > protocols/wirebond_ros2.schema.json`` brings the published copy up to date.
"""

from __future__ import annotations

import sys
from typing import Any

from wirebond.protocol.text.schema import schema_of, text_of
from wirebond.ros2.mapping.grammar import File


def json_schema() -> dict[str, Any]:
    """A new dict each time; the caller may change it."""
    return schema_of(File, "Wirebond mapping file for ROS 2")


def schema_text() -> str:
    """The published file's text."""
    return text_of(json_schema())


if __name__ == "__main__":
    sys.stdout.write(schema_text())
