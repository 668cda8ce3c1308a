"""The engine's WebAssembly module in Node, for tests: JavaScript passes bytes on, and does nothing else."""

from __future__ import annotations

import itertools
import json
import struct
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from tests.shared import ROOT
from wirebond import Codec, MessageError
from wirebond.protocol.model import End
from wirebond.protocol.tables import session_table

MODULE = ROOT / "build" / "wasm" / "engine.wasm"
_DRIVER = Path(__file__).with_name("driver.mjs")
_SIZES = struct.Struct("<II")


class Module:
    """One instance. Every answer of the engine with `error` is an exception."""

    def __init__(self) -> None:
        command = ["node", str(_DRIVER), str(MODULE)]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.close()
        self._process.wait()
        self._process.stdout.close()

    def raw(self, name: str, *args: float, data: bytes = b"") -> tuple[Any, bytes]:
        """Return the result of a function, and the bytes that it may point to."""
        head = json.dumps({"name": name, "args": args}).encode()
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(_SIZES.pack(len(head), len(data)) + head + data)
        self._process.stdin.flush()
        sizes = _SIZES.unpack(self._process.stdout.read(_SIZES.size))
        return json.loads(self._process.stdout.read(sizes[0])), self._process.stdout.read(sizes[1])

    def call(self, name: str, *args: float, data: bytes = b"") -> Any:
        """The value that a function answers with.

        :raises MessageError: a value is refused.
        """
        _, result = self.raw(name, *args, data=data)
        answer = msgspec.msgpack.decode(result)
        if "ok" in answer:
            return answer["ok"]
        if answer["error"] == "message":
            raise MessageError(answer["text"])
        raise AssertionError(answer["text"])

    def follow(self, end: End, reads: list[tuple[float, bytes]]) -> list[int]:
        """The words that describe the rows of these reads; each with its time in microseconds."""
        ends = itertools.accumulate(len(data) for _, data in reads)
        numbers = np.array([*(time for time, _ in reads), *ends], np.float64)
        data = numbers.tobytes() + b"".join(data for _, data in reads)
        return np.frombuffer(self.raw("follow", sender_number(end), len(reads), data=data)[1], np.uint32).tolist()

    def numbers(self, address: int, count: int) -> NDArray[np.float64]:
        return np.frombuffer(self.raw("numbers", address, count)[1], np.float64)

    def open(self, codec: Codec) -> None:
        self.call("open", data=session_table(codec.model))

    def encode(
        self, codec: Codec, message: str, fields: Mapping[str, Any], header: Mapping[str, Any], end: End
    ) -> bytes:
        asked = (codec.tables.indices[message], fields, header)
        return bytes(self.call("encode", sender_number(end), data=msgspec.msgpack.encode(asked)))


def sender_number(end: End | None) -> int:
    """As module.cpp numbers the senders."""
    return 2 if end is None else [End.MCU, End.HOST].index(end)
