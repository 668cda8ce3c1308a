"""HTTP requests about a device that no file describes yet: which format it speaks, and a first file for it."""

from __future__ import annotations

import asyncio
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from wirebond.console.about_bytes import bytes_of
from wirebond.console.answers import RefusedError, answer, body_of, guarded, served_by, worked
from wirebond.console.connector import HeldError
from wirebond.console.station import Station
from wirebond.errors import HeaderFileError
from wirebond.identify.formats import known_formats
from wirebond.identify.lines import Heard, Line, best_of, lines_for, search
from wirebond.identify.ranking import Candidate, rank
from wirebond.import_ import import_header
from wirebond.link.raw import listen_at
from wirebond.new.template import TEMPLATES, template_text
from wirebond.new.write import protocol_name
from wirebond.protocol.model import End

_MOST_BYTES = 1 << 16  # that are looked at: more makes no format likelier, and takes longer
_MOST_SHOWN = 8


class _Identify(msgspec.Struct):
    bytes: str | None = None
    live: float | None = None
    port: str | None = None
    seconds: Annotated[float, msgspec.Meta(gt=0, le=60)] = 1.0


class _New(msgspec.Struct):
    name: str
    template: Literal["native", "fixed", "length"] = "native"


class _Import(msgspec.Struct):
    header: str
    name: str = "imported"


class DeviceRequests:
    """:param turn: what takes long waits for it."""

    def __init__(self, station: Station, turn: asyncio.Lock) -> None:
        self._station = station
        self._turn = turn

    def routes(self) -> list[BaseRoute]:
        """All of them."""
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
            async with self._turn:
                return await worked(lambda: self._searched(port, asked.seconds))
        if asked.bytes is not None:
            data = bytes_of(asked.bytes)
        elif asked.live is None:
            raise RefusedError(422, "no_bytes", "give `bytes`, `live`, the seconds that are looked at, or `port`")
        else:
            data = served_by(self._station).source.kept(End.MCU, asked.live).data
        async with self._turn:
            return await worked(lambda: identified(data[-_MOST_BYTES:]))

    def _searched(self, port: str, seconds: float) -> dict[str, Any]:
        """One setting of the line after the other, until one leaves no doubt."""
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
            **_told(best.candidates, best.size, len(known.formats)),
        }

    async def _templates(self, _: Request) -> Response:
        return answer({"templates": [{"name": name, "text": text} for name, text in TEMPLATES.items()]})

    async def _new(self, request: Request) -> Response:
        asked = await body_of(request, _New)
        name = protocol_name(Path(asked.name))
        return answer({"name": name, "text": template_text(asked.template, name)})

    async def _import(self, request: Request) -> Response:
        asked = await body_of(request, _Import)
        return await worked(lambda: _imported(asked))


def identified(data: bytes) -> dict[str, Any]:
    """Which known formats these bytes are of, the best first."""
    known = known_formats()
    return _told(rank(data, known.formats), len(data), len(known.formats))


def _told(candidates: Sequence[Candidate], size: int, tried: int) -> dict[str, Any]:
    fitting = [one for one in candidates if one.fits][:_MOST_SHOWN]
    matches = [
        {
            "name": one.format.name,
            "path": one.format.model.path,
            "share": one.frame_share,
            "frames": one.frames,
            "messages": one.messages,
            "evidence_bits": round(one.evidence, 1),
            "text": one.format.model.text,
        }
        for one in fitting
    ]
    return {"bytes": size, "formats_tried": tried, "matches": matches}


def _imported(asked: _Import) -> dict[str, Any]:
    name = protocol_name(Path(asked.name))
    with tempfile.TemporaryDirectory(prefix="wirebond-import-") as folder:
        header = Path(folder) / f"{name}.h"
        header.write_text(asked.header, encoding="utf-8")
        try:
            found = import_header(header, name)
        except HeaderFileError as error:
            text = str(error).replace(f"{folder}/", "")
            raise RefusedError(422, "header", text) from None
    return {"name": name, "text": found.text, "notes": list(found.notes), "messages": found.messages}
