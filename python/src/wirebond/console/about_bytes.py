"""HTTP requests about bytes: what they mean, under the protocol in force, or under another file."""

from __future__ import annotations

import asyncio
import re
from typing import Any, Literal

import msgspec
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route

from wirebond.codec import Codec
from wirebond.console.answers import RefusedError, body_of, guarded, served_by, worked
from wirebond.console.connector import EDITED
from wirebond.console.library import Library
from wirebond.console.station import Station
from wirebond.console.tables import message_dict
from wirebond.explain import explain
from wirebond.explain.data import explanation_dict
from wirebond.history.source import ENDS, Source
from wirebond.protocol import loads
from wirebond.protocol.model import End
from wirebond.recording.recording import Reads, Recording

_ROWS = 50
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
    """What takes long waits for its turn: one at a time, so that the link has the rest of the computer."""

    def __init__(self, station: Station, library: Library, turn: asyncio.Lock) -> None:
        self._station = station
        self._library = library
        self._turn = turn

    def routes(self) -> list[BaseRoute]:
        """All of them."""
        return [
            Route("/api/explain", guarded(self._explain), methods=["POST"]),
            Route("/api/decode", guarded(self._decode), methods=["POST"]),
        ]

    async def _explain(self, request: Request) -> Response:
        asked = await body_of(request, _Explain)
        data = bytes_of(asked.bytes)
        if not data:
            raise RefusedError(422, "no_bytes", "there are no bytes to explain; give some, as `AA 55 01`")
        model = served_by(self._station).link.codec.model if asked.text is None else loads(asked.text, EDITED)
        sender = None if asked.sender is None else End(asked.sender)
        async with self._turn:
            return await worked(lambda: explanation_dict(explain(model, data, sender)))

    async def _decode(self, request: Request) -> Response:
        asked = await body_of(request, _Decode)
        if (asked.recording is None) == (asked.live is None):
            raise RefusedError(422, "no_bytes", "give `recording` or `live`, the seconds that are looked at")
        async with self._turn:
            return await worked(lambda: self._decoded(asked))

    def _decoded(self, asked: _Decode) -> dict[str, Any]:
        edited = Codec(loads(asked.text, EDITED))
        if asked.recording is not None:
            path = self._library.path(asked.recording)
            own = Recording(path)
            codec, role, idle = own.codec, End(own.role), own.idle
            bytes_now = {end: own.reads(end) for end in ENDS}
            again = Recording(path, edited)  # which reply is meant depends on the file
            bytes_then = {end: again.reads(end) for end in ENDS}
        else:
            source = served_by(self._station).source
            codec, role, idle = source.codec, source.role, source.codec.model.idle_seconds
            bytes_now = bytes_then = {end: source.kept(end, asked.live or 10.0) for end in ENDS}
        before = _source(codec, role, idle, bytes_now)
        after = _source(edited, role, edited.model.idle_seconds, bytes_then)
        rows = [
            {"t": entry.t, "sender": end.value, "name": entry.name, "bytes": entry.bytes}
            | ({} if message is None else message_dict(message))
            for end, entry, message in after.entries(_ROWS, None, False)
        ]
        return {"before": _account(before), "after": _account(after), "rows": rows}


def _source(codec: Codec, role: End, idle: float, reads: dict[End, Reads]) -> Source:
    source = Source(codec, role, idle, most=None, keep=None)
    for end in ENDS:
        of = reads[end]
        source.feed_whole(end, of.data, of.ends, of.times, of.breaks, of.expected)
    return source


def _account(source: Source) -> dict[str, Any]:
    """Of both ends together."""
    out: dict[str, Any] = {"bytes": 0, "frames": 0, "unknown_frames": 0, "discarded_bytes": {}, "messages": {}}
    for end in ENDS:
        stats = source.streams[end].stats()
        for key in ("bytes", "frames", "unknown_frames"):
            out[key] += stats[key]
        for key in ("discarded_bytes", "messages"):
            for name, count in stats[key].items():
                if count:
                    out[key][name] = out[key].get(name, 0) + count
    return out


def bytes_of(text: str) -> bytes:
    """Hexadecimal digits, as people write them.

    :raises RefusedError: they are none.
    """
    digits = _SEPARATORS.sub("", text)
    if not _HEX.fullmatch(digits):
        raise RefusedError(422, "no_bytes", "these are no bytes; give pairs of hexadecimal digits, as `AA 55 01`")
    return bytes.fromhex(digits)
