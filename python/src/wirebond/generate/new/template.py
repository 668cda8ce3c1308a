"""The templates for a first protocol file, and how one becomes a user's own."""

from __future__ import annotations

import re
from pathlib import Path

from wirebond import paths
from wirebond.errors import UsageError
from wirebond.generate.new.write import protocol_name, write_new

# Name, and for whom it is.
TEMPLATES = {
    "native": "the recommended format: between zeros, stuffed with COBS, CRC-16; every service",
    "fixed": "frames of one size: magic, id, payload, check, tail",
    "length": "magic, length, id, payload, CRC-16",
}


def write_template(path: Path, template: str) -> None:
    """Write a commented first file, named after ``path``.

    :raises UsageError: no such template, or something lies there already.
    :raises OSError: the file cannot be written.
    """
    write_new(path, template_text(template, protocol_name(path)))


def template_text(template: str, name: str) -> str:
    """The template as a file of the protocol ``name``.

    :raises UsageError: no such template.
    """
    if template not in TEMPLATES:
        raise UsageError(f"there is no template '{template}'; there are {', '.join(TEMPLATES)}")
    return _renamed(_source(template).read_text(encoding="utf-8"), name)


def _source(template: str) -> Path:
    if template == "native":
        return paths.protocols() / "native.yaml"
    return Path(__file__).parent / "templates" / f"{template}.yaml"


def _renamed(text: str, name: str) -> str:
    return re.sub(r"^protocol: .*$", f"protocol: {name}", text, count=1, flags=re.MULTILINE)
