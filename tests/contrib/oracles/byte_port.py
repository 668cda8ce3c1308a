"""Ports that are byte strings, for libraries that insist on one."""

from __future__ import annotations


class BytePort:
    """Replaces pyserial's port for a library that only reads and writes; it never waits."""

    def __init__(self, received: bytes = b"") -> None:
        self.received = received
        self.sent = b""

    def read(self, size: int = 1) -> bytes:
        piece, self.received = self.received[:size], self.received[size:]
        return piece

    def write(self, data: bytes) -> int:
        self.sent += bytes(data)
        return len(data)

    def reset_input_buffer(self) -> None:
        """Nothing lies in it that was not meant to be read."""


class ServoPort:
    """Replaces the port handler of ROBOTIS' library, and of Feetech's, which follows it."""

    def __init__(self, received: bytes = b"") -> None:
        self.received = received
        self.sent = b""
        self.is_using = False

    def clearPort(self) -> None:  # noqa: N802
        pass

    def writePort(self, packet: list[int]) -> int:  # noqa: N802
        self.sent += bytes(packet)
        return len(packet)

    def readPort(self, size: int) -> bytes:  # noqa: N802
        piece, self.received = self.received[: max(size, 0)], self.received[max(size, 0) :]
        return piece

    def setPacketTimeout(self, size: int) -> None:  # noqa: N802
        pass

    def isPacketTimeout(self) -> bool:  # noqa: N802
        return not self.received
