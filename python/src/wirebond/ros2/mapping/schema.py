"""The JSON Schema of mapping files, for editors. ``wirebond schema --mapping`` prints it."""

from __future__ import annotations

from typing import Any

from wirebond.protocol.text.schema import schema_of, text_of
from wirebond.ros2.mapping.grammar import File


def json_schema() -> dict[str, Any]:
    """Return a new dict each time; the caller may change it."""
    return schema_of(File, "Wirebond mapping file for ROS 2")


def schema_text() -> str:
    """Return the schema as a file's text."""
    return text_of(json_schema())
