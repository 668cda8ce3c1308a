"""Decides who may use the console: rules for the token and the headers Host and Origin. No socket."""

from __future__ import annotations

import contextlib
import hmac
import ipaddress
import socket
from urllib.parse import urlsplit

LOCAL_NAMES = ("localhost", "127.0.0.1", "::1")


class Guard:
    """:param port: that the console listens at.
    :param token: what a client must say.
    """

    def __init__(self, port: int, token: str) -> None:
        self.port = port
        self.token = token
        name = socket.gethostname().lower()
        self._names = {*LOCAL_NAMES, name, f"{name}.local"}

    def is_token(self, given: str) -> bool:
        """Compare in a time that does not depend on where they differ."""
        return hmac.compare_digest(given.encode(), self.token.encode())

    def refuses(self, host: str, origin: str | None) -> str | None:
        """Return why a request with these headers is refused; None if it is not.

        A page of another place may reach this port by a name of its own (DNS rebinding), or by a script. The first has
        a Host that is not an address of this computer, the second an Origin that is not Host.
        """
        name, port = _split(host)
        if port != self.port or not self._is_here(name):
            return (
                f"the request is for {host!r:.80}, which is not this console; use an address of this computer, or "
                "localhost, with its port"
            )
        if origin is None:
            return None
        parts = urlsplit(origin)
        if parts.scheme not in ("http", "https") or parts.netloc.lower() != host.lower():
            return f"the request comes from a page of {origin!r:.80}; only the console's own page may use it"
        return None

    def _is_here(self, name: str) -> bool:
        """Return whether the host is this computer. An address cannot be rebound; a name can, unless it is ours."""
        if name in self._names:
            return True
        with contextlib.suppress(ValueError):
            ipaddress.ip_address(name)
            return True
        return False


def _split(host: str) -> tuple[str, int]:
    try:
        parts = urlsplit(f"//{host}")
        return (parts.hostname or "").lower(), parts.port or 80
    except ValueError:
        return "", 0
