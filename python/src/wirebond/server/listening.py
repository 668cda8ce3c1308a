"""Opens the sockets at which a server listens: a Unix socket of its owner's, or an address of this computer."""

from __future__ import annotations

import contextlib
import ipaddress
import os
import socket
from pathlib import Path

from wirebond import system
from wirebond.errors import PortError

_WAITING = 1024  # connections that the system keeps until they are accepted


def is_loopback(host: str) -> bool:
    """Check whether only this computer reaches the host by this name."""
    if host == "localhost":
        return True
    with contextlib.suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return False


class _Listener(socket.socket):
    """asyncio has one number for how many connections wait, and for how many it accepts at once. Many may wait: where
    there is no room TCP tries again only after a second, and a flood of strangers would cost the driver that."""

    def listen(self, _backlog: int = _WAITING, /) -> None:
        super().listen(_WAITING)


def unix_socket(path: str) -> socket.socket:
    found = _Listener(fileno=system.unix_socket().detach())
    try:
        if _is_served(path):
            raise PortError(f"another server listens at {path}; end that one, or choose another name", None, path)
        with contextlib.suppress(FileNotFoundError):
            if Path(path).is_socket():  # of a server that was killed
                Path(path).unlink()
        before = os.umask(0o177)
        try:
            found.bind(path)
        finally:
            os.umask(before)
        found.listen()
    except OSError as error:
        found.close()
        if isinstance(error, PortError):
            raise
        raise PortError(
            f"cannot listen at {path}: {error.strerror or error}; choose a path in a folder that you may write to",
            error.errno,
            path,
        ) from None
    return found


def _is_served(path: str) -> bool:
    with contextlib.suppress(OSError), system.unix_socket() as probe:
        probe.settimeout(1.0)
        probe.connect(path)
        return True
    return False


def tcp_socket(host: str, port: int) -> socket.socket:
    """Return a socket that listens there.

    :raises PortError: it cannot.
    """
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        return _Listener(fileno=socket.create_server((host, port), family=family, backlog=_WAITING).detach())
    except OSError as error:
        raise PortError(
            f"cannot listen at {host}:{port}: {error.strerror or error}; choose an address of this computer and a port "
            "that no other program has",
            error.errno,
            f"{host}:{port}",
        ) from None
