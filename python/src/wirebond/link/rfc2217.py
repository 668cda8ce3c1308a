"""pyserial's client of an RFC 2217 server, with what a link needs beside it."""

from __future__ import annotations

import contextlib
import os
import socket

from serial.rfc2217 import Serial


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
        """In a forked child: close its copy of the socket, without a word to the server."""
        with contextlib.suppress(OSError):
            os.close(self._socket.fileno())

    def _telnet_read_loop(self) -> None:
        """In pyserial's thread, which would print what it raises."""
        try:
            super()._telnet_read_loop()
        except (OSError, ValueError):
            self._read_buffer.put(None)
        finally:
            self.was_lost = self.is_open  # else it was closed here


def open_rfc2217(url: str, *, baudrate: int, bytesize: int, parity: str, stopbits: int, timeout: float) -> Rfc2217Port:
    """As ``serial.serial_for_url``.

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
