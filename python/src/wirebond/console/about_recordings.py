"""HTTP requests about the server's recordings: the list, the files, and messages of them as CSV."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import FileResponse, Response, StreamingResponse
from starlette.routing import BaseRoute, Route

from wirebond.chinese import with_chinese
from wirebond.console.answers import RefusedError, answer, guarded
from wirebond.console.library import Library
from wirebond.recording.export import csv_of
from wirebond.recording.recording import Recording


class RecordingRequests:
    """:param library: where the files are."""

    def __init__(self, library: Library) -> None:
        self._library = library

    def routes(self) -> list[BaseRoute]:
        """Return the routes about recordings."""
        return [
            Route("/api/recordings", guarded(self._list)),
            Route("/api/recordings/{name:str}", guarded(self._file)),
        ]

    async def _list(self, _: Request) -> Response:
        folder, found = await run_in_threadpool(self._library.list)
        told = [with_chinese(each, "error") for each in msgspec.to_builtins(found)]
        return answer({"folder": None if folder is None else str(folder), "recordings": told})

    async def _file(self, request: Request) -> Response:
        name = request.path_params["name"]
        is_csv = name.endswith(".csv")
        path = self._library.path(name.removesuffix(".csv"))
        if not is_csv:
            return FileResponse(path, media_type="application/octet-stream", filename=path.name)
        message = request.query_params.get("message", "")
        recording = await run_in_threadpool(lambda: Recording(path, self._library.codec_for(path)))
        names = [m.name for m in recording.codec.model.messages]
        if message not in (*names, "unknown"):
            raise RefusedError(422, "no_message", f"give ?message=NAME, one of {', '.join(names)}")
        sender = request.query_params.get("sender")
        rows: Iterator[bytes] = await run_in_threadpool(csv_of, recording, message, sender)
        headers = {"content-disposition": f'attachment; filename="{path.stem}-{message}.csv"'}
        return StreamingResponse(rows, media_type="text/csv; charset=utf-8", headers=headers)
