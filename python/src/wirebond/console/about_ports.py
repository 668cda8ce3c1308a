"""HTTP requests about ports: which there are, and which protocols may be spoken over them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from wirebond import paths
from wirebond.console.answers import guarded, worked
from wirebond.console.station import Station
from wirebond.ports.discovery import serial_ports
from wirebond.ports.facts import port_facts


class PortRequests:
    """:param station: what a port is connected to."""

    def __init__(self, station: Station) -> None:
        self._station = station

    def routes(self) -> list[BaseRoute]:
        """All of them."""
        return [Route("/api/ports", guarded(self._ports))]

    async def _ports(self, _: Request) -> Response:
        return await worked(lambda: {"ports": port_facts(serial_ports(Path("/"))), "protocols": self._protocols()})

    def _protocols(self) -> list[dict[str, Any]]:
        folder = paths.protocols()
        found = [*sorted(folder.glob("*.yaml")), *sorted((folder / "contrib").glob("*.yaml"))]
        return [{"path": str(path), "name": path.stem} for path in found]
