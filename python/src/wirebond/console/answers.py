"""Answers of the HTTP requests, and how their bodies are read."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import ParamSpec, TypeVar

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response

from wirebond.as_json import encode, plain
from wirebond.chinese import with_chinese
from wirebond.console.connector import HeldError
from wirebond.console.jobs import Worker, as_json
from wirebond.console.jobs.protocol_files import problems_of
from wirebond.console.library import NoPortError
from wirebond.console.station import Served, Station
from wirebond.errors import ProtocolFileError, WirebondError

MOST_BODY = 4 << 20  # bytes
_Body = TypeVar("_Body", bound=msgspec.Struct)
_P = ParamSpec("_P")
Work = Callable[[], object]
Handler = Callable[[Request], Awaitable[Response]]


class RefusedError(Exception):
    """A request that cannot be met."""

    def __init__(self, status: int, error: str, text: str) -> None:
        super().__init__(text)
        self.status = status
        self.error = error


def answer(value: object, status: int = 200) -> Response:
    """Answer with JSON."""
    return Response(encode(plain(value)), status, media_type="application/json")


def refusal(error: str, text: str, status: int, **more: object) -> Response:
    """Answer with a refusal: a word and a sentence."""
    return answer(with_chinese({"error": error, "text": text, **more}, "text"), status)


def served_by(station: Station) -> Served:
    """Return the link that is served now.

    :raises RefusedError: nothing.
    """
    served = station.served
    if served is None:
        raise RefusedError(404, "no_link", "the console has no port yet; connect it first")
    return served


def guarded(handler: Handler) -> Handler:
    """Return the same handler, with each foreseeable error as an answer."""

    async def wrapped(request: Request) -> Response:
        try:
            return await handler(request)
        except RefusedError as error:
            return refusal(error.error, str(error), error.status)
        except ProtocolFileError as error:
            return refusal("protocol", str(error), 422, problems=problems_of(error))
        except NoPortError as error:
            return refusal("no_link", str(error), 404)
        except HeldError as error:
            return refusal("not_in_control", str(error), 409)
        except WirebondError as error:
            return refusal("refused", str(error), 422)
        except OSError as error:
            return refusal("refused", f"{error.strerror or error}: {error.filename}", 422)

    return wrapped


async def body_of(request: Request, of: type[_Body]) -> _Body:
    """Return the request's JSON.

    :raises RefusedError: it is too long, or none.
    """
    data = bytearray()
    async for chunk in request.stream():
        data += chunk
        if len(data) > MOST_BODY:
            raise RefusedError(413, "too_long", f"the request has more than {MOST_BODY} bytes")
    try:
        return msgspec.json.decode(bytes(data), type=of)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise RefusedError(400, "not_understood", f"{error}; see docs/console-api.md") from None


async def worked(work: Work) -> Response:
    """Answer from a thread of its own, for work that takes a while."""
    return answer(await run_in_threadpool(work))


async def worked_by(worker: Worker, job: Callable[_P, object], *args: _P.args, **keywords: _P.kwargs) -> Response:
    """Answer from a process of its own, for work that takes long: the views go on."""
    data = await run_in_threadpool(worker.run, as_json, job, args, keywords)
    return Response(data, media_type="application/json")
