"""HTTP requests about bytes: what they mean, under the protocol in force, or under another file."""

from __future__ import annotations

import re
from typing import Literal

import msgspec
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from wirebond.console.answers import RefusedError, body_of, guarded, served_by, worked_by
from wirebond.console.jobs import Worker
from wirebond.console.jobs.protocol_files import EDITED
from wirebond.console.jobs.wire_bytes import decoded_reads, decoded_recording, explained
from wirebond.console.library import Library
from wirebond.console.station import Station
from wirebond.protocol.model import End
from wirebond.recording.history.source import ENDS

_MOST_EXPLAINED = 1 << 16  # bytes
_HEX = re.compile(r"(?:[0-9a-fA-F]{2})*")
_SEPARATORS = re.compile(r"0[xX]|[\s,:;]")


class _Explain(msgspec.Struct):
    bytes: str
    sender: Literal["host", "mcu"] | None = None
    text: str | None = None


class _Decode(msgspec.Struct):
    text: str
    recording: str | None = None
    live: float | None = None


class ByteRequests:
    """:param worker: does what takes long."""

    def __init__(self, station: Station, library: Library, worker: Worker) -> None:
        self._station = station
        self._library = library
        self._worker = worker

    def routes(self) -> list[BaseRoute]:
        """Return the routes about bytes."""
        return [
            Route("/api/explain", guarded(self._explain), methods=["POST"]),
            Route("/api/decode", guarded(self._decode), methods=["POST"]),
        ]

    async def _explain(self, request: Request) -> Response:
        asked = await body_of(request, _Explain)
        data = bytes_of(asked.bytes)
        if not data:
            raise RefusedError(422, "no_bytes", "there are no bytes to explain; give some, such as `AA 55 01`")
        if len(data) > _MOST_EXPLAINED:
            raise RefusedError(422, "too_long", f"these are {len(data)} bytes; give at most {_MOST_EXPLAINED}")
        sender = None if asked.sender is None else End(asked.sender)
        if asked.text is not None:
            return await worked_by(self._worker, explained, asked.text, EDITED, data, sender)
        model = served_by(self._station).link.codec.model
        return await worked_by(self._worker, explained, model.text, model.path, data, sender)

    async def _decode(self, request: Request) -> Response:
        asked = await body_of(request, _Decode)
        if asked.recording is not None and asked.live is None:
            path = self._library.path(asked.recording)
            codec = self._library.codec_for(path)
            own = None if codec is None else (codec.model.text, codec.model.path)
            return await worked_by(self._worker, decoded_recording, asked.text, path, own)
        if asked.live is None or asked.recording is not None:
            raise RefusedError(422, "no_bytes", "give `recording`, or `live` with the seconds to examine")
        source = served_by(self._station).source
        reads = {end: source.kept(end, asked.live) for end in ENDS}
        model = source.codec.model
        return await worked_by(self._worker, decoded_reads, asked.text, (model.text, model.path), source.role, reads)


def bytes_of(text: str) -> bytes:
    """Read hexadecimal digits, as people write them.

    :raises RefusedError: they are not bytes.
    """
    digits = _SEPARATORS.sub("", text)
    if not _HEX.fullmatch(digits):
        raise RefusedError(422, "no_bytes", "these are not bytes; give pairs of hexadecimal digits, as `AA 55 01`")
    return bytes.fromhex(digits)
