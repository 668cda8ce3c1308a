"""HTTP requests about a device that no file describes yet: which format it speaks, and a first file for it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from wirebond.analysis.identify.formats import known_formats
from wirebond.analysis.identify.lines import Heard, Line, best_of, lines_for, search
from wirebond.console.about_bytes import bytes_of
from wirebond.console.answers import RefusedError, answer, body_of, guarded, served_by, worked, worked_by
from wirebond.console.connector import HeldError
from wirebond.console.jobs import Worker
from wirebond.console.jobs.protocol_files import imported
from wirebond.console.jobs.wire_bytes import candidates_dict, identified
from wirebond.console.station import Station
from wirebond.errors import UsageError
from wirebond.generate.new import PARTS, TEMPLATES, parts_of, template_text
from wirebond.generate.new.write import protocol_name
from wirebond.link.raw import listen_at
from wirebond.protocol.model import End

_MOST_BYTES = 1 << 16  # that are looked at: more makes no format likelier, and takes longer


class _Identify(msgspec.Struct):
    bytes: str | None = None
    live: float | None = None
    port: str | None = None
    seconds: Annotated[float, msgspec.Meta(gt=0, le=60)] = 1.0


class _New(msgspec.Struct):
    name: str
    template: Literal["native", "length", "fixed"] = "native"
    has: str | None = None


class _Import(msgspec.Struct):
    header: str
    name: str = "imported"


class DeviceRequests:
    """:param worker: does what takes long."""

    def __init__(self, station: Station, worker: Worker) -> None:
        self._station = station
        self._worker = worker

    def routes(self) -> list[BaseRoute]:
        """Return the routes about devices."""
        return [
            Route("/api/identify", guarded(self._identify), methods=["POST"]),
            Route("/api/templates", guarded(self._templates)),
            Route("/api/new", guarded(self._new), methods=["POST"]),
            Route("/api/import", guarded(self._import), methods=["POST"]),
        ]

    async def _identify(self, request: Request) -> Response:
        asked = await body_of(request, _Identify)
        if asked.port is not None:
            port = asked.port
            if self._station.served is not None:
                raise HeldError(
                    "the console is connected to a port; disconnect it, so that all baud rates can be tried"
                )
            return await worked(lambda: self._searched(port, asked.seconds))
        if asked.bytes is not None:
            data = bytes_of(asked.bytes)
        elif asked.live is None:
            raise RefusedError(422, "no_bytes", "give `bytes`, `port`, or `live` with the seconds to examine")
        else:
            data = served_by(self._station).source.kept(End.MCU, asked.live).data
        return await worked_by(self._worker, identified, data[-_MOST_BYTES:])

    def _searched(self, port: str, seconds: float) -> dict[str, Any]:
        """Try one setting of the line after the other, until one leaves no doubt."""
        known = known_formats()
        lines = lines_for(known.formats)
        heard: list[Heard] = []

        def listen(line: Line) -> Iterator[bytes]:
            return listen_at(port, line.settings(), seconds)

        try:
            for one in search(lines, listen, known.formats):
                heard.append(one)
                why = f"{len(heard)} of {len(lines)}: {one.line}: {one.size} bytes"
                self._station.connecting = {"port": port, "why": why}
        finally:
            self._station.connecting = None
        best = best_of(heard)
        return {
            "line": {"baud": best.line.baud, "parity": best.line.parity, "stop_bits": best.line.stop_bits},
            "settings_tried": [{"line": str(one.line), "bytes": one.size} for one in heard],
            **candidates_dict(best.candidates, best.size, len(known.formats)),
        }

    async def _templates(self, _: Request) -> Response:
        templates = [{"name": name, "text": text} for name, text in TEMPLATES.items()]
        return answer({"templates": templates, "parts": [{"name": n, "text": text} for n, text in PARTS.items()]})

    async def _new(self, request: Request) -> Response:
        asked = await body_of(request, _New)
        name = protocol_name(Path(asked.name))
        try:
            parts = None if asked.has is None else parts_of(asked.has)
            return answer({"name": name, "text": template_text(asked.template, name, parts)})
        except UsageError as error:
            raise RefusedError(422, "wrong_parts", str(error)) from None

    async def _import(self, request: Request) -> Response:
        asked = await body_of(request, _Import)
        name = protocol_name(Path(asked.name))
        return await worked_by(self._worker, imported, asked.header, name)
