"""Python's struct, numpy for columns, and CRCs in native code (fastcrc), as a careful engineer writes it by hand.

``StructCrc`` reads the enterprize format itself: it looks for the start byte, and takes a frame whose two checks hold.
``CobsStruct`` has COBS frames between zeros, with one check: the quickest framing that Python can do.
"""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
from cobs import cobs
from fastcrc import crc16
from numpy.typing import NDArray

from bench.peers.work import MESSAGES, Flat, Sample, elements, layout, struct_format

START = 0xAA
OUTSIDE = 7  # start, length, id, two checks of two bytes
LONGEST = max(m.max_payload for m in MESSAGES)
FORMATS = {m.id: struct.Struct(struct_format(m)) for m in MESSAGES}
DTYPES = {m.id: np.dtype([(e.field.name, f"<{e.code}", e.shape) for e in layout(m)]) for m in MESSAGES}
SIZES = {message_id: form.size for message_id, form in FORMATS.items()}
NAMES = {m.id: m.name for m in MESSAGES}

Columns = dict[int, NDArray[Any]]  # by id: an array with a named column for each field
Takes = Mapping[int, Callable[[bytes], object]]  # by id: what to do with a payload


class _Struct(ABC):
    """The common part of both: payloads that struct packs and unpacks."""

    def stream(self, samples: Iterable[Sample]) -> bytes:
        return b"".join(self.frame(m.id, FORMATS[m.id].pack(*elements(values))) for m, values in samples)

    def columns(self, stream: bytes) -> Columns:
        """Payloads of a message are joined and laid out by numpy: a step a message, not a step a value. It is quicker
        than struct's iter_unpack."""
        payloads: dict[int, list[bytes]] = {message_id: [] for message_id in FORMATS}
        self._find(stream, {message_id: found.append for message_id, found in payloads.items()})
        return {
            message_id: np.frombuffer(b"".join(found), DTYPES[message_id])
            for message_id, found in payloads.items()
            if found
        }

    def messages(self, stream: bytes) -> int:
        messages = 0

        def reader(unpack: Callable[[bytes], tuple[Any, ...]]) -> Callable[[bytes], None]:
            def take(payload: bytes) -> None:
                nonlocal messages
                messages += 1
                for _ in unpack(payload):
                    pass

            return take

        self._find(stream, {message_id: reader(form.unpack) for message_id, form in FORMATS.items()})
        return messages

    def flat(self, columns: Columns) -> Flat:
        return {
            NAMES[message_id]: [
                tuple(part.tolist()) for name in rows.dtype.names for part in np.atleast_2d(rows[name].T)
            ]
            for message_id, rows in columns.items()
        }

    @abstractmethod
    def frame(self, message_id: int, payload: bytes) -> bytes:
        """The payload on the wire."""

    @abstractmethod
    def _find(self, stream: bytes, takes: Takes) -> None:
        """Hand the payload of each good frame to what takes its id."""


class StructCrc(_Struct):
    name = "struct + C CRC"
    package = "fastcrc"
    licence = "MIT"

    def frame(self, message_id: int, payload: bytes) -> bytes:
        head = bytes((START, len(payload), message_id))
        frame = head + crc16.mcrf4xx(head).to_bytes(2, "little") + payload
        return frame + crc16.mcrf4xx(frame).to_bytes(2, "little")

    def _find(self, stream: bytes, takes: Takes) -> None:
        """A CRC without a final xor is 0 over bytes and their CRC: one comparison a check."""
        crc = crc16.mcrf4xx
        find = stream.find
        at = find(START)
        while at >= 0:
            head = stream[at : at + 5]
            if len(head) == 5 and head[1] <= LONGEST and crc(head) == 0:
                end = at + OUTSIDE + head[1]
                frame = stream[at:end]
                if crc(frame) == 0 and SIZES.get(head[2]) == len(frame) - OUTSIDE == head[1]:
                    takes[head[2]](frame[5:-2])
                    at = find(START, end)
                    continue
            at = find(START, at + 1)


class CobsStruct(_Struct):
    name = "COBS + C CRC + struct"
    package = "cobs"
    licence = "MIT"

    def frame(self, message_id: int, payload: bytes) -> bytes:
        body = bytes((message_id,)) + payload
        return b"\0" + cobs.encode(body + crc16.mcrf4xx(body).to_bytes(2, "little")) + b"\0"

    def _find(self, stream: bytes, takes: Takes) -> None:
        crc = crc16.mcrf4xx
        decode = cobs.decode
        for block in stream.split(b"\0"):
            if not block:
                continue
            try:
                body = decode(block)
            except cobs.DecodeError:
                continue
            if crc(body) == 0 and SIZES.get(body[0]) == len(body) - 3:
                takes[body[0]](body[1:-2])
