"""The HTTP request for the record of commands: who gave each one, and when."""

from __future__ import annotations

import time
from dataclasses import asdict
from typing import Any

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from wirebond.as_json import plain
from wirebond.console.answers import answer, guarded, served_by
from wirebond.console.station import Served, Station
from wirebond.server.command_log import Command


class CommandRequests:
    """:param station: whose server keeps the log."""

    def __init__(self, station: Station) -> None:
        self._station = station

    def routes(self) -> list[BaseRoute]:
        """Return the routes about commands."""
        return [Route("/api/log", guarded(self._log))]

    async def _log(self, request: Request) -> Response:
        served = served_by(self._station)
        log = served.server.log
        ahead = time.time() - time.monotonic()
        told = {"commands": [_told(served, one, ahead) for one in log.commands()], "dropped": log.dropped}
        response = answer(told)
        if "download" in request.query_params:
            name = f"{served.link.codec.name}-{time.strftime('%Y%m%d-%H%M%S')}-commands.json"
            response.headers["content-disposition"] = f'attachment; filename="{name}"'
        return response


def _told(served: Served, command: Command, ahead: float) -> dict[str, Any]:
    out = asdict(command)
    frame = out.pop("frame")
    if frame is not None:
        decoder = served.link.codec.decoder(served.link.role)
        found = [*decoder.feed(frame), *decoder.finish()]
        if found:
            out["fields"], out["header"] = found[0].fields, found[0].header or None
    return {**plain(out), "wall": command.t + ahead}
