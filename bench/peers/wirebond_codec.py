"""Wirebond itself, through its Python API: the format is read from the protocol file, no code is generated."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

import wirebond
from bench.collateral import PROTOCOL
from bench.peers.work import CHUNK, Flat, Sample
from wirebond.codec import Columns


class Wirebond:
    name = "Wirebond"
    package = "wirebond"
    licence = "MIT"

    def __init__(self) -> None:
        self._codec = wirebond.load(PROTOCOL)

    def stream(self, samples: Iterable[Sample]) -> bytes:
        return b"".join(self._codec.encode(message.name, values) for message, values in samples)

    def columns(self, stream: bytes) -> Columns:
        return self._codec.decode_columns(stream, threads=1)

    def flat(self, columns: Columns) -> Flat:
        return {
            name: [
                tuple(part.tolist()) for column in table.fields.values() for part in np.atleast_2d(np.asarray(column).T)
            ]
            for name, table in columns.items()
        }

    def messages(self, stream: bytes) -> int:
        decoder = self._codec.decoder()
        messages = 0
        for at in range(0, len(stream), CHUNK):
            for message in decoder.feed(stream[at : at + CHUNK]):
                messages += 1
                for _ in message.fields.values():
                    pass
        return messages
