"""pyserial's client of an RFC 2217 server, with what a link needs beside it."""

from __future__ import annotations

import contextlib
import os
import queue
import socket
from collections.abc import Callable

from serial import SerialException
from serial.rfc2217 import DO, DONT, IAC, SB, SE, WILL, WONT, Serial

_MOST_CHUNKS = 64  # that wait to be read; then the server has to wait
_CHUNK = 16384  # bytes
_LONGEST_OPTION = 1024  # bytes of a server's answer about one option
_LOOK = 0.1  # seconds between two checks whether the port was closed


class Rfc2217Port(Serial):  # type: ignore[misc]  # pyserial has no types
    """Open it with ``open``, once ``port`` is its URL."""

    was_lost = False  #: the connection ended, perhaps while it was opened

    def cancel_read(self) -> None:
        """Shut the connection down: a thread that reads or writes does not wait any more."""
        connection = self._socket
        if connection is not None:
            with contextlib.suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)

    def leave_to_parent(self) -> None:
        """Close the socket's copy in a forked child, without a message to the server."""
        with contextlib.suppress(OSError):
            os.close(self._socket.fileno())

    def read(self, size: int = 1) -> bytes:  # noqa: ARG002 pyserial's face
        """Return the bytes that arrived together, whatever ``size`` is. Empty after the port's timeout.

        :raises SerialException: the connection has ended, and all that came before was read.
        """
        is_reading = self._thread is not None and self._thread.is_alive()
        try:
            return bytes(self._read_buffer.get(timeout=self._timeout))
        except queue.Empty:
            if not is_reading:
                raise SerialException("the connection has ended") from None
            return b""

    def _telnet_read_loop(self) -> None:
        """Read in pyserial's thread, instead of its own loop: that one takes byte by byte without a limit, dies of a
        server that breaks the rules, and forgets the last bytes."""
        telnet = Telnet(self._telnet_negotiate_option, self._telnet_process_subnegotiation)
        try:
            while self.is_open:
                with contextlib.suppress(TimeoutError):
                    received = self._socket.recv(_CHUNK)
                    if not received:
                        return
                    self._hand_over(telnet.feed(received))
        except Exception:  # noqa: S110 whatever a server makes of pyserial: the connection is of no use
            pass
        finally:
            self.was_lost = self.is_open  # else it was closed here

    def _telnet_process_subnegotiation(self, suboption: bytes) -> None:
        """Ignore answers to questions that were not asked yet: pyserial would compare them with nothing."""
        with contextlib.suppress(TypeError):
            super()._telnet_process_subnegotiation(suboption)

    def _hand_over(self, data: bytes) -> None:
        self._read_buffer.maxsize = _MOST_CHUNKS
        while data and self.is_open:
            with contextlib.suppress(queue.Full):
                self._read_buffer.put(data, timeout=_LOOK)
                return


class Telnet:
    """Received bytes in; data out, and what the server says of options to the two functions.

    :param negotiate: called with DO, DONT, WILL or WONT and the option.
    :param settle: called with the bytes between SB and SE.
    """

    def __init__(self, negotiate: Callable[[bytes, bytes], object], settle: Callable[[bytes], object]) -> None:
        self._negotiate = negotiate
        self._settle = settle
        self._before = b""  # IAC, or the command for the option that follows
        self._option: bytearray | None = None  # within SB and SE

    def feed(self, received: bytes) -> bytes:
        """Return the data in these bytes.

        :raises ValueError: an option without an end.
        """
        if not self._before and self._option is None and IAC not in received:
            return received
        data = bytearray()
        for value in received:
            self._take(bytes((value,)), data)
        return bytes(data)

    def _take(self, byte: bytes, data: bytearray) -> None:
        before, self._before = self._before, b""
        if before == b"":
            if byte == IAC:
                self._before = IAC
            else:
                self._keep(byte, data)
        elif before != IAC:
            self._negotiate(before, byte)
        elif byte == IAC:
            self._keep(IAC, data)
        elif byte == SB:
            self._option = bytearray()
        elif byte == SE:
            option, self._option = self._option, None
            if option is not None:
                self._settle(bytes(option))
        elif byte in (DO, DONT, WILL, WONT):
            self._before = byte

    def _keep(self, byte: bytes, data: bytearray) -> None:
        if self._option is None:
            data += byte
            return
        self._option += byte
        if len(self._option) > _LONGEST_OPTION:
            raise ValueError("an option without an end")


def open_rfc2217(url: str, *, baudrate: int, bytesize: int, parity: str, stopbits: int, timeout: float) -> Rfc2217Port:
    """Open a port, as ``serial.serial_for_url``.

    :raises ConnectionAbortedError: the server closed the connection while it was opened.
    :raises OSError: it does not answer, or knows no RFC 2217.
    :raises ValueError: it refused a setting.
    """
    port = Rfc2217Port(None, baudrate=baudrate, bytesize=bytesize, parity=parity, stopbits=stopbits, timeout=timeout)
    port.port = url
    try:
        port.open()
    except OSError as error:
        if port.was_lost:
            raise ConnectionAbortedError(str(error)) from None
        raise
    return port
