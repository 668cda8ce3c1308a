"""Protocol Buffers in COBS frames with a CRC in native code: the host's side of a firmware that uses nanopb and COBS.

The messages are described at run time, with the fields and their order of the protocol file. A number of 8 or 16 bits
is a varint there, and a float has its four bytes; arrays are packed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from operator import attrgetter
from typing import Any

from cobs import cobs
from fastcrc import crc16
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from bench.peers.work import MESSAGES, Flat, Sample, layout

_Kind = descriptor_pb2.FieldDescriptorProto
_TYPES = {"f": _Kind.TYPE_FLOAT, "?": _Kind.TYPE_BOOL, "B": _Kind.TYPE_UINT32, "H": _Kind.TYPE_UINT32}


def _classes() -> dict[int, Any]:
    """A message class for each id."""
    file = descriptor_pb2.FileDescriptorProto(name="enterprize.proto", package="enterprize", syntax="proto3")
    for message in MESSAGES:
        described = file.message_type.add(name=message.name)
        for number, element in enumerate(layout(message), start=1):
            label = _Kind.LABEL_OPTIONAL if element.field.count is None else _Kind.LABEL_REPEATED
            described.field.add(name=element.field.name, number=number, type=_TYPES[element.code], label=label)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    types = (pool.FindMessageTypeByName(f"enterprize.{message.name}") for message in MESSAGES)
    return {m.id: message_factory.GetMessageClass(found) for m, found in zip(MESSAGES, types, strict=True)}


class Protobuf:
    name = "COBS + C CRC + protobuf"
    package = "protobuf"
    licence = "BSD-3-Clause"

    def __init__(self) -> None:
        self._classes = _classes()
        self._fields = {m.id: attrgetter(*(f.name for f in m.fields)) for m in MESSAGES}

    def stream(self, samples: Iterable[Sample]) -> bytes:
        return b"".join(self._frame(*sample) for sample in samples)

    def _frame(self, message: Any, values: dict[str, Any]) -> bytes:
        body = bytes((message.id,)) + self._classes[message.id](**values).SerializeToString()
        return b"\0" + cobs.encode(body + crc16.mcrf4xx(body).to_bytes(2, "little")) + b"\0"

    def _rows(self, stream: bytes) -> Iterator[tuple[int, tuple[Any, ...]]]:
        crc = crc16.mcrf4xx
        decode = cobs.decode
        readers = {
            message_id: (made.FromString, self._fields[message_id]) for message_id, made in self._classes.items()
        }
        for block in stream.split(b"\0"):
            if not block:
                continue
            try:
                body = decode(block)
            except cobs.DecodeError:
                continue
            if crc(body) == 0 and body[0] in readers:
                parse, fields = readers[body[0]]
                yield body[0], fields(parse(body[1:-2]))

    def columns(self, stream: bytes) -> dict[str, list[tuple[Any, ...]]]:
        rows: dict[int, list[tuple[Any, ...]]] = {m.id: [] for m in MESSAGES}
        for message_id, row in self._rows(stream):
            rows[message_id].append(row)
        return {m.name: list(zip(*rows[m.id], strict=True)) for m in MESSAGES if rows[m.id]}

    def flat(self, columns: dict[str, list[tuple[Any, ...]]]) -> Flat:
        flat: Flat = {m.name: [] for m in MESSAGES if m.name in columns}
        for message in MESSAGES:
            for element, column in zip(layout(message), columns.get(message.name, ()), strict=False):
                flat[message.name] += [column] if element.field.count is None else zip(*column, strict=True)
        return flat

    def messages(self, stream: bytes) -> int:
        messages = 0
        for _, row in self._rows(stream):
            messages += 1
            for _ in row:
                pass
        return messages
