"""FlySky's i-BUS against flyskyibus."""

from __future__ import annotations

import contextlib
import io
import struct

from tests.contrib.oracle import Case, Oracle
from tests.contrib.oracles.byte_port import BytePort
from wirebond.protocol.model import End

with contextlib.redirect_stdout(io.StringIO()):  # the library prints a path when it is imported
    from flySkyiBus import IBus


class Ibus(Oracle):
    def encode(self, case: Case) -> bytes | None:
        library = IBus.__new__(IBus)  # without opening a port
        library.serial = port = BytePort()
        library.write(list(case.wire[0]))
        return port.sent

    def decode(self, frame: bytes, sender: End) -> Case | None:
        library = IBus.__new__(IBus)
        try:
            if not library.validate(frame):
                return None
        except (ValueError, struct.error):  # not 32 bytes; a sum that its signed number cannot hold
            return None
        return Case("channels", sender, [list(library.unpack(frame)[2:-1])])
