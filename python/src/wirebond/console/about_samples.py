"""The HTTP request for the samples of plotted fields."""

from __future__ import annotations

import math
import time

from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response, StreamingResponse
from starlette.routing import BaseRoute, Route

from wirebond.console.answers import RefusedError, guarded, served_by
from wirebond.console.library import Library
from wirebond.console.samples import csv_of_samples
from wirebond.console.station import Station
from wirebond.console.wants import MOST_FIELDS


class SampleRequests:
    """Serves samples of the link, or of a recording.

    :param station: whose link it is.
    :param library: of the recordings.
    """

    def __init__(self, station: Station, library: Library) -> None:
        self._station = station
        self._library = library

    def routes(self) -> list[BaseRoute]:
        """Return the routes about samples."""
        return [Route("/api/samples.csv", guarded(self._samples))]

    async def _samples(self, request: Request) -> Response:
        query = request.query_params
        fields = [name for name in query.get("fields", "").split(",") if name]
        if not 0 < len(fields) <= MOST_FIELDS:
            raise RefusedError(422, "no_field", f"give ?fields=message.field,…: 1 to {MOST_FIELDS} of them")
        begin, end = _time(query.get("from"), -math.inf), _time(query.get("to"), math.inf)
        name = query.get("recording")
        if name is None:
            source, zero = served_by(self._station).source, time.time() - time.monotonic()
        else:
            replay = await run_in_threadpool(self._library.open, name)
            source, zero = replay.source, replay.started
        rows = await run_in_threadpool(
            csv_of_samples, source, fields, begin, end, zero, counts_from_start=name is not None
        )
        headers = {"content-disposition": 'attachment; filename="samples.csv"'}
        return StreamingResponse(rows, media_type="text/csv; charset=utf-8", headers=headers)


def _time(text: str | None, otherwise: float) -> float:
    if text is None:
        return otherwise
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise RefusedError(422, "no_time", f"{text!r:.40} is not a time; give seconds, as the views have them")
    return value
