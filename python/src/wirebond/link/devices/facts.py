"""Serial ports as data, for programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from wirebond.link.devices.names import stable_name
from wirebond.link.devices.permission import permission
from wirebond.link.devices.serial_port import SerialPort


def port_facts(ports: Sequence[SerialPort], root: Path = Path("/")) -> list[dict[str, Any]]:
    """Return the facts of each port, its stable name, and whether this user may open it."""
    return [_facts(port, list(ports), root) for port in ports]


def _facts(port: SerialPort, ports: list[SerialPort], root: Path) -> dict[str, Any]:
    rights = permission(port.path, root)
    return asdict(port) | {
        "name": stable_name(port, ports),
        "group": None if rights is None else rights.group,
        "may_open": rights is not None and rights.refusal is None,
    }
