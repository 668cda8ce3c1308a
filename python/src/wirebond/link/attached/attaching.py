"""Connecting to the server that owns a link: address, token, its answer, and sentences for what can go wrong."""

from __future__ import annotations

import contextlib
import os
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextvars import ContextVar
from typing import Any, Literal

import msgspec

from wirebond.codec import Codec
from wirebond.errors import PortError
from wirebond.link.attached import words
from wirebond.link.attached.address import ServerAddress
from wirebond.link.attached.whose_server import ForeignServerError, check_peer, check_place
from wirebond.link.attached.words import Welcome
from wirebond.protocol.loader import loads
from wirebond.system import need_unix_sockets, unix_socket

LOOPBACK = ("127.0.0.1", "::1", "localhost")
PATIENCE = 2.0  # seconds that the server has for an answer
LOOKS = 8  # for an answer, in that time

_program: ContextVar[str] = ContextVar("program", default="")


@contextlib.contextmanager
def attached_as(name: str) -> Iterator[None]:
    """Name the links that this block opens at a server, such as the node of ROS that drives. Without it a link has the
    name of the program's file."""
    token = _program.set(name)
    try:
        yield
    finally:
        _program.reset(token)


def name_of_program() -> str:
    """Return the name by which a link that is opened now is known to other clients of the server."""
    name = _program.get() or os.path.basename(sys.argv[0] or "python")  # noqa: PTH119 may be no path
    return f"{name} ({os.getpid()})"


def comes(event: threading.Event, seconds: float) -> bool:
    """Wait so long for it. Time in which this process was suspended counts as one check: the answer may have come
    in that time, and the thread that reads it has had none."""
    return any(event.wait(seconds / LOOKS) for _ in range(LOOKS))


class Accepted(msgspec.Struct):
    """The server's answer to a client that it takes."""

    ok: Welcome
    t: float  # seconds on its clock
    tick: int


def codec_of_server(address: ServerAddress) -> Codec:
    """Return the protocol that a server speaks.

    :raises PortError: it cannot be reached, or refuses.
    """
    found, accepted, _, _ = attach(address, "none", asks=False, name=name_of_program())
    found.close()
    welcome = accepted.ok
    return Codec(loads(welcome.text, f"{address.text} ({welcome.protocol})"))


def attach(
    address: ServerAddress, messages: Literal["frames", "none"], asks: bool, name: str
) -> tuple[socket.socket, Accepted, words.Splitter, list[tuple[int, bytes]]]:
    """Connect to the server. Return the connection, its answer, and the bytes after that.

    :param name: of this program, for other clients of the server.
    :raises PortError: it cannot be reached, refuses, or belongs to another user.
    :raises UsageError: it has a name or a path, and this system has no Unix sockets.
    """
    if address.path:
        need_unix_sockets()
    found = None
    try:
        if address.path:
            found = unix_socket()
            found.settimeout(PATIENCE)
            check_place(address.path)
            _connect_unix(found, address.path)
            check_peer(found, address.path)  # nothing was sent yet
        else:
            found = socket.create_connection((address.host, address.port), PATIENCE)
            found.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        request = words.Attach(id=1, token=address.token, name=name, messages=messages, asks=asks)
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # it has refused already, and says why
            found.sendall(words.json_message(request))
        splitter = words.Splitter(words.MOST_TO_CLIENT)
        answer, rest = _first(found, splitter)
        accepted = None if "error" in answer else msgspec.convert(answer, Accepted)
    except (OSError, ValueError, RecursionError, ForeignServerError) as error:
        if found is not None:
            found.close()
        raise _no_server(address, error) from None
    if accepted is None:
        found.close()
        raise PortError(f"{address.text}: {answer.get('text', answer['error'])}", None, address.text)
    return found, accepted, splitter, rest


def _connect_unix(found: socket.socket, path: str) -> None:
    """Connect, and retry if the server's queue is full because many programs attach at once."""
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
    if isinstance(error, ForeignServerError):
        what = str(error)
    elif isinstance(error, FileNotFoundError | ConnectionRefusedError):
        what = f"no server runs at {text}; start one with `wirebond serve FILE PORT`"
    elif isinstance(error, socket.gaierror):
        what = f"the name of {text} cannot be found ({error.strerror}); check its spelling"
    elif isinstance(error, PermissionError):
        what = f"no permission to attach to {text}; only the user that started the server can"
    elif isinstance(error, TimeoutError):
        what = f"{text} does not answer within {PATIENCE:g} s; check that a Wirebond server runs there"
    elif isinstance(error, OSError):
        what = f"cannot attach to {text}: {error.strerror or error}; check its address"
    else:
        what = f"{text} is not a Wirebond server: it sent {error}; check the address"
    return PortError(what, code, text)


def _first(found: socket.socket, splitter: words.Splitter) -> tuple[dict[str, Any], list[tuple[int, bytes]]]:
    """Return the server's answer to the first message, and the bytes after it."""
    while True:
        data = found.recv(1 << 16)
        if not data:
            raise ValueError("nothing, and closed the connection")
        messages = list(splitter.feed(data))
        if messages:
            kind, body = messages[0]
            answer = msgspec.json.decode(body) if kind == words.JSON else None
            if not isinstance(answer, dict) or answer.get("re") != 1:
                raise ValueError("something other than an answer")
            return answer, messages[1:]
