"""What ``wirebond ports`` does: the serial ports of this machine, for a person or as JSON."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

from wirebond.cli.output import write
from wirebond.cli.values import to_json
from wirebond.ports.discovery import can_list_ports, serial_ports
from wirebond.ports.names import stable_name
from wirebond.ports.permission import permission
from wirebond.ports.serial_port import SerialPort
from wirebond.ports.view import print_ports


def list_ports(as_json: bool, root: Path = Path("/")) -> int:
    """1 where there is no port that could be opened, else 0."""
    ports = serial_ports(root)
    rows = [_facts(port, ports, root) for port in ports]
    if as_json:
        write(to_json({"ports": rows}) + "\n")
    else:
        print_ports(rows, can_list_ports(root))
    return 0 if any(port.has_device for port in ports) else 1


def _facts(port: SerialPort, ports: list[SerialPort], root: Path) -> dict[str, Any]:
    rights = permission(port.path, root)
    return asdict(port) | {
        "name": stable_name(port, ports),
        "group": None if rights is None else rights.group,
        "may_open": rights is not None and rights.refusal is None,
    }
