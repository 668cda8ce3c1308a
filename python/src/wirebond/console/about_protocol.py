"""HTTP requests about the protocol in force, and about protocol files in general."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from wirebond.console.answers import RefusedError, answer, body_of, guarded, served_by, worked, worked_by
from wirebond.console.connector import Options
from wirebond.console.jobs import Worker
from wirebond.console.jobs.protocol_files import checked, document, findings
from wirebond.console.library import Library
from wirebond.console.protocol_form import protocol_form
from wirebond.console.station import Station
from wirebond.generate.new.write import protocol_name, write_new
from wirebond.link.raw import is_raw
from wirebond.protocol import loads
from wirebond.protocol.model import Protocol
from wirebond.protocol.text.schema import schema_text
from wirebond.whole_file import write_whole


class _Check(msgspec.Struct):
    text: str


class _Save(msgspec.Struct):
    text: str
    name: str | None = None


class ProtocolRequests:
    """:param station: whose protocol it is.
    :param library: of the recordings, which have protocols of their own.
    :param options: which files may be written.
    :param worker: does what takes long.
    """

    def __init__(self, station: Station, library: Library, options: Options, worker: Worker) -> None:
        self._station = station
        self._library = library
        self._options = options
        self._worker = worker
        self._first: set[Path] = set()  # files that the page made

    def routes(self) -> list[BaseRoute]:
        """Return the routes about the protocol."""
        return [
            Route("/api/protocol", guarded(self._protocol)),
            Route("/api/document", guarded(self._document)),
            Route("/api/lint", guarded(self._lint)),
            Route("/api/schema", guarded(self._schema)),
            Route("/api/check", guarded(self._check), methods=["POST"]),
            Route("/api/save", guarded(self._save), methods=["POST"]),
        ]

    async def _protocol(self, request: Request) -> Response:
        name = request.query_params.get("recording")
        if name is not None:
            return await worked(lambda: self._recorded(name))
        served = served_by(self._station)
        link = served.link
        if is_raw(link.codec):
            raise RefusedError(404, "no_protocol", "the console has no protocol yet: it shows raw bytes")
        path = link.codec.model.path
        return answer(protocol_form(link.codec, served.source.history, path, link.port, link.baud))

    def _recorded(self, name: str) -> dict[str, Any]:
        source = self._library.open(name).source
        model = source.codec.model
        return protocol_form(source.codec, source.history, model.path, "", model.link.baud)

    async def _model(self, request: Request) -> Protocol:
        """Return the protocol of the link, or of the requested recording."""
        name = request.query_params.get("recording")
        if name is None:
            return served_by(self._station).link.codec.model
        return (await run_in_threadpool(self._library.open, name)).source.codec.model

    async def _document(self, request: Request) -> Response:
        model = await self._model(request)
        return await worked_by(self._worker, document, model.text, model.path)

    async def _lint(self, request: Request) -> Response:
        model = await self._model(request)
        return await worked_by(self._worker, findings, model.text, model.path)

    async def _schema(self, _: Request) -> Response:
        return Response(schema_text(), media_type="application/schema+json")

    async def _save(self, request: Request) -> Response:
        """Save the file. The current protocol stays until the port is connected."""
        asked = await body_of(request, _Save)
        path = self._own_file() if asked.name is None else self._new_file(asked.name)
        loads(asked.text, str(path))

        def work() -> dict[str, Any]:
            if asked.name is None or path in self._first:
                write_whole(path, asked.text)
            else:
                write_new(path, asked.text)
                self._first.add(path)
            return {"ok": None, "path": str(path)}

        return await worked(work)

    def _own_file(self) -> Path:
        """Return the file in force where the page made it, else the one that the console was started with."""
        served = self._station.served
        if served is not None and (path := Path(served.link.codec.model.path)) in self._first:
            return path
        if self._options.may_save is None:
            raise RefusedError(
                422, "no_file", "the console was started without a protocol file; download the text instead"
            )
        return self._options.may_save

    def _new_file(self, name: str) -> Path:
        """Choose a new file in the folder of the server, where `/api/ports` finds it. A file that the page did not make
        is not replaced."""
        if not self._options.may_connect:
            raise RefusedError(422, "no_file", "this console shows the link of one program; download the text instead")
        return (Path.cwd() / f"{protocol_name(Path(name))}.yaml").resolve()

    async def _check(self, request: Request) -> Response:
        text = (await body_of(request, _Check)).text
        return await worked_by(self._worker, checked, text)
