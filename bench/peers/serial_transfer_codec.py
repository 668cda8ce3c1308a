"""pySerialTransfer: its own framing (COBS-like, CRC-8), its own reading of a port. The payload is packed by struct."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from pySerialTransfer import pySerialTransfer

from bench.peers.struct_codec import FORMATS, NAMES
from bench.peers.work import Flat, Sample, elements


class _Memory:
    """A port whose bytes have all come already."""

    is_open = True

    def __init__(self, content: bytes = b"") -> None:
        self._content = content
        self._at = 0
        self.written = bytearray()

    @property
    def in_waiting(self) -> int:
        return len(self._content) - self._at

    def read(self, size: int = 1) -> bytes:
        found = self._content[self._at : self._at + size]
        self._at += len(found)
        return found

    def write(self, content: bytes) -> int:
        self.written += bytes(content)
        return len(content)


class SerialTransfer:
    name = "pySerialTransfer"
    package = "pySerialTransfer"
    licence = "MIT"

    @staticmethod
    def _link(port: _Memory) -> Any:
        link = pySerialTransfer.SerialTransfer("memory", restrict_ports=False, debug=False)
        link.connection = port
        return link

    def stream(self, samples: Iterable[Sample]) -> bytes:
        port = _Memory()
        link = self._link(port)
        for message, values in samples:
            payload = FORMATS[message.id].pack(*elements(values))
            link.tx_buff[: len(payload)] = list(payload)
            link.send(len(payload), packet_id=message.id)
        return bytes(port.written)

    def _rows(self, stream: bytes) -> Iterable[tuple[int, tuple[Any, ...]]]:
        port = _Memory(stream)
        link = self._link(port)
        while port.in_waiting:
            size = link.available()
            if size and link.id_byte in FORMATS:
                yield link.id_byte, FORMATS[link.id_byte].unpack(bytes(link.rx_buff[:size]))

    def columns(self, stream: bytes) -> dict[int, list[tuple[Any, ...]]]:
        rows: dict[int, list[tuple[Any, ...]]] = {message_id: [] for message_id in FORMATS}
        for message_id, row in self._rows(stream):
            rows[message_id].append(row)
        return {message_id: list(zip(*found, strict=True)) for message_id, found in rows.items() if found}

    def flat(self, columns: dict[int, list[tuple[Any, ...]]]) -> Flat:
        return {NAMES[message_id]: found for message_id, found in columns.items()}

    def messages(self, stream: bytes) -> int:
        messages = 0
        for _, row in self._rows(stream):
            messages += 1
            for _ in row:
                pass
        return messages
