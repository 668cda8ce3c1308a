"""HTTP requests about ports: which there are, to connect to one, and what a device at one may be."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import msgspec
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from wirebond.console.answers import body_of, guarded, worked
from wirebond.console.connector import SIMULATORS, Connector
from wirebond.link.devices.discovery import serial_ports
from wirebond.link.devices.facts import port_facts


class _Connect(msgspec.Struct):
    port: str
    baud: Annotated[int, msgspec.Meta(ge=1, le=100_000_000)] | None = None
    protocol: str | None = None
    text: str | None = None
    over: bool = False


class _Disconnect(msgspec.Struct):
    over: bool = False


class PortRequests:
    """:param connector: what opens and closes links."""

    def __init__(self, connector: Connector) -> None:
        self._connector = connector

    def routes(self) -> list[BaseRoute]:
        """Return the routes about ports."""
        return [
            Route("/api/ports", guarded(self._ports)),
            Route("/api/connect", guarded(self._connect), methods=["POST"]),
            Route("/api/disconnect", guarded(self._disconnect), methods=["POST"]),
        ]

    async def _ports(self, _: Request) -> Response:
        return await worked(
            lambda: {
                "ports": port_facts(serial_ports(Path("/"))),
                "simulators": [{"name": name, "text": text} for name, text in SIMULATORS],
                "protocols": [{"path": str(path), "name": path.stem} for path in self._connector.choices()],
            }
        )

    async def _connect(self, request: Request) -> Response:
        asked = await body_of(request, _Connect)

        def work() -> dict[str, Any]:
            self._connector.connect(asked.port, asked.baud, asked.protocol, asked.text, over=asked.over)
            return {"ok": None}

        return await worked(work)

    async def _disconnect(self, request: Request) -> Response:
        asked = await body_of(request, _Disconnect)

        def work() -> dict[str, Any]:
            self._connector.disconnect(over=asked.over)
            return {"ok": None}

        return await worked(work)
