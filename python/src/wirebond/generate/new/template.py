"""The templates for a first protocol file, and how one becomes a user's own. A format that comes with the package is a
template, too."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from wirebond import paths
from wirebond.errors import UsageError
from wirebond.generate.new.write import protocol_name, write_new
from wirebond.generate.templates import environment
from wirebond.protocol.problems import quoted

# Name, and for whom it is.
TEMPLATES = {
    "native": "the recommended format: between zeros, stuffed with COBS, CRC-16",
    "length": "magic, length, id, payload, CRC-16",
    "fixed": "frames of one size: magic, id, payload, check, tail",
}
# What a robot may have: name, and which messages it gives.
PARTS = {
    "base": "wheels that are driven by a speed: a command, and odometry with its time stamp",
    "joints": "joints that are moved to a position, such as `joints=12`: a group of commands, and one of states",
    "imu": "accelerations and angular velocities, as arrays, with their time stamp",
    "battery": "voltage and current in the status",
}
USUAL = ("base", "imu", "battery")
MOST_JOINTS = 32
_JOINTS = 6  # where no number is given
_FOLDER = Path(__file__).parent / "templates"


def parts_of(text: str) -> dict[str, int]:
    """Read ``base,joints=12`` as a mapping: each part with its number, 1 or the given one.

    :raises UsageError: no such part, or no such number.
    """
    found: dict[str, int] = {}
    for word in filter(None, (word.strip() for word in text.split(","))):
        name, has_number, number = word.partition("=")
        if name not in PARTS:
            raise UsageError(f"a robot's parts are {', '.join(PARTS)}, and not {quoted(name)}; write them with commas")
        if has_number and (name != "joints" or not number.isdecimal() or not 1 <= int(number) <= MOST_JOINTS):
            raise UsageError(f"{quoted(word)} is not a number of joints; write `joints=12`, with 1 to {MOST_JOINTS}")
        found[name] = int(number) if has_number else _JOINTS if name == "joints" else 1
    return found


def shipped_formats() -> dict[str, Path]:
    """Return the protocol files that come with the package, by the names that ``wirebond identify`` prints. ``native``
    is left out: its template has a choice of parts."""
    return {path.stem: path for path in paths.protocol_files() if path.stem not in TEMPLATES}


def write_template(path: Path, template: str, parts: Mapping[str, int] | None = None) -> None:
    """Write a commented first file, named after ``path``.

    :param template: one of `TEMPLATES`, or of `shipped_formats`, of which the file is a copy.
    :param parts: what the robot has, as `parts_of` gives it; None: what is usual.
    :raises UsageError: no such template, or it has no choice of parts, or the file exists already.
    :raises OSError: the file cannot be written.
    """
    write_new(path, template_text(template, protocol_name(path), parts))


def template_text(template: str, name: str, parts: Mapping[str, int] | None = None) -> str:
    """Return the template as a file of the protocol ``name``.

    :param parts: as for `write_template`.
    :raises UsageError: no such template, or it has no choice of parts.
    """
    files = {"fixed": _FOLDER / "fixed.yaml", **shipped_formats()}
    if template not in TEMPLATES and template not in files:
        raise UsageError(
            f"there is no template {quoted(template)}; there are {', '.join(TEMPLATES)}, and the formats that "
            "`wirebond identify` knows, such as tfmini"
        )
    if template in files:
        if parts is not None:
            raise UsageError(f"the template {template} has no choice of parts; leave them out, or take native")
        return _renamed(files[template].read_text(encoding="utf-8"), name)
    chosen = dict.fromkeys(USUAL, 1) if parts is None else parts
    return (
        environment(_FOLDER)
        .get_template("robot.yaml")
        .render(
            template=template,
            name=name,
            parts=_in_words(chosen),
            **{part: chosen.get(part, 0) for part in PARTS},
        )
    )


def _in_words(parts: Mapping[str, int]) -> str:
    words = [f"{parts[name]} joints" if name == "joints" else f"a {name}" for name in PARTS if name in parts]
    words = ["an imu" if word == "a imu" else word for word in words]
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


def _renamed(text: str, name: str) -> str:
    return re.sub(r"^protocol: .*$", f"protocol: {name}", text, count=1, flags=re.MULTILINE)
