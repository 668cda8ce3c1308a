"""Whose server listens at a Unix socket: checked before a program sends it anything.

In a folder that several users share, such as /tmp, another user can create the folder or the socket first. A server
there could read every command and invent every answer. Only a server of this user, or of root, is believed.
"""

from __future__ import annotations

import socket
import stat
from pathlib import Path

from wirebond.system import is_trusted, peer_user, user_name


class ForeignServerError(Exception):
    """The server, its socket or its folder belongs to someone else. The text is a sentence."""


def check_place(path: str) -> None:
    """Check the owners of the socket and of its folder.

    :raises ForeignServerError: one of them belongs to another user, or another user can replace the socket.
    :raises OSError: one of them does not exist.
    """
    folder = Path(path).parent
    of_folder, of_socket = folder.stat(), Path(path).lstat()
    for what, found in ((folder, folder.lstat()), (folder, of_folder), (path, of_socket)):
        if not is_trusted(found.st_uid):
            raise ForeignServerError(
                f"{what} belongs to {_name(found.st_uid)}, so a server there is not yours; {_advice(found.st_uid)}"
            )
    if of_folder.st_mode & stat.S_IWOTH and not of_folder.st_mode & stat.S_ISVTX:
        raise ForeignServerError(
            f"every user can replace the socket in {folder}, so a server there cannot be trusted; remove the others' "
            f"permission to write (`chmod o-w {folder}`), or choose a folder of yours"
        )


def check_peer(connected: socket.socket, path: str) -> None:
    """Check the user of the process at the other end.

    :raises ForeignServerError: it is another user.
    """
    user = peer_user(connected)
    if not is_trusted(user):
        raise ForeignServerError(f"the server at {path} runs as {_name(user)}, so it is not yours; {_advice(user)}")


def _name(user: int) -> str:
    name = user_name(user)
    return f"user number {user}" if name is None else f"the user {name}"


def _advice(user: int) -> str:
    return (
        f"remove it and start your own server, or run this program as {_name(user)}, "
        "or attach by TCP with that server's token"
    )
