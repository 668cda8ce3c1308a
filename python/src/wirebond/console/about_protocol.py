"""HTTP requests about the protocol in force, and about protocol files in general."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from wirebond import paths
from wirebond.check import Places, lint
from wirebond.codec import Codec
from wirebond.console.answers import RefusedError, answer, body_of, guarded, problems_of, served_by, worked
from wirebond.console.connector import EDITED
from wirebond.console.protocol_form import protocol_form
from wirebond.console.station import Station
from wirebond.doc import markdown
from wirebond.errors import ProtocolFileError
from wirebond.link.raw import is_raw
from wirebond.protocol import loads
from wirebond.whole_file import write_whole


class _Check(msgspec.Struct):
    text: str


class ProtocolRequests:
    """:param station: whose protocol it is.
    :param may_save: the file that may be written; None: none.
    """

    def __init__(self, station: Station, may_save: Path | None) -> None:
        self._station = station
        self._may_save = may_save

    def routes(self) -> list[BaseRoute]:
        """All of them."""
        return [
            Route("/api/protocol", guarded(self._protocol)),
            Route("/api/document", guarded(self._document)),
            Route("/api/lint", guarded(self._lint)),
            Route("/api/schema", guarded(self._schema)),
            Route("/api/check", guarded(self._check), methods=["POST"]),
            Route("/api/save", guarded(self._save), methods=["POST"]),
        ]

    async def _protocol(self, _: Request) -> Response:
        served = served_by(self._station)
        link = served.link
        if is_raw(link.codec):
            raise RefusedError(404, "no_protocol", "the console has no protocol yet: it shows raw bytes")
        path = link.codec.model.path
        return answer(protocol_form(link.codec, served.source.history, path, link.port, link.baud))

    async def _document(self, _: Request) -> Response:
        codec = served_by(self._station).link.codec
        return await worked(lambda: {"markdown": markdown(codec)})

    async def _lint(self, _: Request) -> Response:
        codec = served_by(self._station).link.codec
        return await worked(lambda: lint(codec, Places.of_text(codec.model.text)).as_dict())

    async def _schema(self, _: Request) -> Response:
        schema = (paths.protocols() / "wirebond.schema.json").read_bytes()
        return Response(schema, media_type="application/schema+json")

    async def _save(self, request: Request) -> Response:
        """The file that the console was started with is written; what is in force stays until the port is connected."""
        text = (await body_of(request, _Check)).text
        path = self._may_save
        if path is None:
            raise RefusedError(
                422, "no_file", "the console was started without a protocol file; download the text instead"
            )
        loads(text, str(path))

        def work() -> dict[str, Any]:
            write_whole(path, text)
            return {"ok": None, "path": str(path)}

        return await worked(work)

    async def _check(self, request: Request) -> Response:
        text = (await body_of(request, _Check)).text
        return await worked(lambda: checked(text))


def checked(text: str) -> dict[str, Any]:
    """Is this text a protocol? What is wrong stands at its place."""
    try:
        codec = Codec(loads(text, EDITED))
    except ProtocolFileError as error:
        return {"ok": False, "problems": problems_of(error)}
    return {"ok": True, "problems": [], "protocol": codec.name, "hash": f"{codec.hash:016x}"}
