"""The HTTP requests of the console that are not the page's files."""

from __future__ import annotations

from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from wirebond.console.as_json import encode
from wirebond.console.protocol_form import protocol_form
from wirebond.console.station import Station


def answer(value: object, status: int = 200) -> Response:
    """JSON."""
    return Response(encode(value), status, media_type="application/json")


def refusal(status: int, error: str, text: str) -> Response:
    """A word and a sentence."""
    return answer({"error": error, "text": text}, status)


def routes(station: Station) -> list[BaseRoute]:
    """All of them."""
    return [Route("/api/protocol", _Protocol(station).get)]


class _Protocol:
    def __init__(self, station: Station) -> None:
        self._station = station

    def get(self, _: Request) -> Response:
        served = self._station.served
        if served is None:
            return refusal(404, "no_link", "the console has no port yet; connect it first")
        link = served.link
        model = link.codec.model
        return answer(protocol_form(link.codec, served.source.history, model.path, link.port, link.baud))
