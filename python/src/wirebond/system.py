"""Differences between operating systems: what Windows and macOS do not have, in one place.

The type checker knows each system (`mypy --platform win32`), so conditions are on `sys.platform`, which it understands.
"""

from __future__ import annotations

import os
import signal
import socket
import struct
import subprocess
import sys
from typing import Any

from wirebond.errors import UsageError

# For os.open. A system without a flag has none of the danger, such as a terminal that takes control of the program.
NOT_A_LINK: int = getattr(os, "O_NOFOLLOW", 0)
WITHOUT_WAITING: int = getattr(os, "O_NONBLOCK", 0)
NOT_OUR_TERMINAL: int = getattr(os, "O_NOCTTY", 0)
BINARY: int = getattr(os, "O_BINARY", 0)  # Windows changes ends of lines without it

HAS_UNIX_SOCKETS = hasattr(socket, "AF_UNIX")
NO_UNIX_SOCKETS = (
    "Python on this system has no Unix sockets, so servers have no names here; use TCP: "
    "`wirebond serve FILE PORT --tcp 127.0.0.1:7000` prints the address to attach to"
)

# Arguments of subprocess.Popen for a process that does not get the terminal's Ctrl-C.
APART: dict[str, Any]
if sys.platform == "win32":
    APART = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
else:
    APART = {"start_new_session": True}


def no_ptys(what: str) -> UsageError:
    """Return the error of a command that Windows cannot do.

    :param what: the subject of its sentence.
    """
    return UsageError(f"{what} needs a pty, and Windows has none; run it on Linux, or on this computer in WSL")


def need_unix_sockets() -> None:
    """Refuse the name or the path of a server.

    :raises UsageError: this system has no Unix sockets.
    """
    if not HAS_UNIX_SOCKETS:
        raise UsageError(NO_UNIX_SOCKETS)


def is_unix_socket(found: socket.socket) -> bool:
    """Return whether it is a Unix socket.

    :param found: any socket.
    """
    return getattr(socket, "AF_UNIX", None) == found.family


def unix_socket() -> socket.socket:
    """Return a new Unix socket.

    :raises UsageError: this system has none.
    """
    need_unix_sockets()
    return socket.socket(getattr(socket, "AF_UNIX"))  # noqa: B009 the type checker knows none on Windows


def is_trusted(user: int) -> bool:
    """Return whether this is the user of this process, or root, who can read and change everything anyway. On Windows
    files have no such numbers, and the system keeps other users out of the folders that Wirebond uses.

    :param user: the number of a user.
    """
    return sys.platform == "win32" or user in (os.geteuid(), 0)


def user_name(user: int) -> str | None:
    """Return the name of a user; None: there is none.

    :param user: the number of the user.
    """
    if sys.platform == "win32":
        return None
    import pwd  # noqa: PLC0415 Windows has none

    try:
        return pwd.getpwuid(user).pw_name
    except KeyError:
        return None


def peer_user(connected: socket.socket) -> int:
    """Return the number of the user who began to listen at the other end of a Unix socket.

    :param connected: a Unix socket.
    :raises OSError: the system does not say.
    """
    if sys.platform == "linux":
        credentials = struct.Struct("=iII")  # struct ucred of unix(7): process, user, group
        data = connected.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, credentials.size)
        return int(credentials.unpack(data)[1])
    credentials = struct.Struct("=II")  # the beginning of struct xucred of macOS, unix(4): version, user
    of_local, peer_credentials = 0, 1  # SOL_LOCAL, LOCAL_PEERCRED
    return int(credentials.unpack_from(connected.getsockopt(of_local, peer_credentials, 76))[1])


def interrupt(process: subprocess.Popen[Any]) -> None:
    """Do to a process what Ctrl-C would; on Windows, where that reaches no process apart, end it.

    :param process: one that may be ended at any moment.
    """
    if sys.platform == "win32":
        process.terminate()
    else:
        process.send_signal(signal.SIGINT)


def give_way(steps: int) -> None:
    """Let other programs have the processor first, where the system has such a number.

    :param steps: more is less processor.
    """
    if sys.platform != "win32":
        os.nice(steps)
