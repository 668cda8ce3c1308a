"""Connecting to the server that owns a link: address, token, its answer, and sentences for what can go wrong."""

from __future__ import annotations

import contextlib
import os
import socket
import sys
import time
from typing import Any, Literal

import msgspec

from wirebond.attach import words
from wirebond.attach.address import ServerAddress
from wirebond.attach.words import Welcome
from wirebond.codec import Codec
from wirebond.errors import PortError
from wirebond.protocol.loader import loads

LOOPBACK = ("127.0.0.1", "::1", "localhost")
PATIENCE = 2.0  # seconds that the server has for an answer


def codec_of_server(address: ServerAddress) -> Codec:
    """The protocol that a server speaks.

    :raises PortError: it cannot be reached, or refuses.
    """
    found, answer, _, _ = attach(address, "none", asks=False)
    found.close()
    welcome = msgspec.convert(answer["ok"], Welcome)
    return Codec(loads(welcome.text, f"{address.text} ({welcome.protocol})"))


def attach(
    address: ServerAddress, messages: Literal["frames", "none"], asks: bool
) -> tuple[socket.socket, dict[str, Any], words.Splitter, list[tuple[int, bytes]]]:
    """A connection to the server, its answer, and what came behind that.

    :raises PortError: it cannot be reached, or refuses.
    """
    found = None
    try:
        if address.path:
            found = socket.socket(socket.AF_UNIX)
            found.settimeout(PATIENCE)
            _connect_unix(found, address.path)
        else:
            found = socket.create_connection((address.host, address.port), PATIENCE)
            found.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        name = f"{os.path.basename(sys.argv[0] or 'python')} ({os.getpid()})"  # noqa: PTH119 may be no path
        request = words.Attach(id=1, token=address.token, name=name, messages=messages, asks=asks)
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # it has refused already, and says why
            found.sendall(words.json_message(request))
        splitter = words.Splitter(words.MOST_TO_CLIENT)
        answer, rest = _first(found, splitter)
    except (OSError, ValueError) as error:
        if found is not None:
            found.close()
        raise _no_server(address, error) from None
    if "error" in answer:
        found.close()
        raise PortError(f"{address.text}: {answer['text']}", None, address.text)
    return found, answer, splitter, rest


def _connect_unix(found: socket.socket, path: str) -> None:
    """Where many programs attach at once, the server's queue may be full for a moment."""
    until = time.monotonic() + PATIENCE
    while True:
        try:
            found.connect(path)
        except BlockingIOError:
            if time.monotonic() > until:
                raise TimeoutError from None
            time.sleep(0.01)
        else:
            return


def _no_server(address: ServerAddress, error: Exception) -> PortError:
    text = address.text
    code = error.errno if isinstance(error, OSError) else None
    if isinstance(error, FileNotFoundError | ConnectionRefusedError):
        what = f"no server runs at {text}; start one with `wirebond serve FILE PORT`"
    elif isinstance(error, socket.gaierror):
        what = f"the name of {text} cannot be found ({error.strerror}); check its spelling"
    elif isinstance(error, PermissionError):
        what = f"no permission to attach to {text}; only the user who started the server may"
    elif isinstance(error, TimeoutError):
        what = f"{text} does not answer within {PATIENCE:g} s; check that a Wirebond server runs there"
    elif isinstance(error, OSError):
        what = f"cannot attach to {text}: {error.strerror or error}; check its address"
    else:
        what = f"{text} is no Wirebond server: it sent {error}; check the address"
    return PortError(what, code, text)


def _first(found: socket.socket, splitter: words.Splitter) -> tuple[dict[str, Any], list[tuple[int, bytes]]]:
    """The server's answer to the first message, and what came behind it."""
    while True:
        data = found.recv(1 << 16)
        if not data:
            raise ValueError("nothing, and closed the connection")
        messages = list(splitter.feed(data))
        if messages:
            kind, body = messages[0]
            answer = msgspec.json.decode(body) if kind == words.JSON else None
            if not isinstance(answer, dict) or answer.get("re") != 1:
                raise ValueError("something else than an answer")
            return answer, messages[1:]
