"""``wirebond schema``: the JSON Schema of protocol files, or of mapping files."""

from __future__ import annotations

from pathlib import Path

from wirebond.cli.output import write
from wirebond.protocol.text import schema as of_protocol
from wirebond.ros2.mapping import schema as of_mapping
from wirebond.whole_file import write_whole


def write_schema(mapping: bool, out: Path | None) -> None:
    """Write it to a file, or to stdout."""
    text = of_mapping.schema_text() if mapping else of_protocol.schema_text()
    if out is None:
        write(text)
    else:
        write_whole(out, text)
