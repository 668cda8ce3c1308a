"""``wirebond ports``: lists the serial ports of this machine, for a person or as JSON."""

from __future__ import annotations

from pathlib import Path

from wirebond.cli.commands.ports_view import print_ports
from wirebond.cli.output import write
from wirebond.cli.values import to_json
from wirebond.link.devices.discovery import can_list_ports, serial_ports
from wirebond.link.devices.facts import port_facts


def list_ports(as_json: bool, root: Path = Path("/")) -> int:
    """List the ports. Returns 1 if there is no port that could be opened, otherwise 0."""
    ports = serial_ports(root)
    rows = port_facts(ports, root)
    if as_json:
        write(to_json({"ports": rows}) + "\n")
    else:
        print_ports(rows, can_list_ports(root))
    return 0 if any(port.has_device for port in ports) else 1
