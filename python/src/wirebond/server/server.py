"""A server of a link, as programs use it."""

from __future__ import annotations

import os
import socket
from typing import TYPE_CHECKING, Self

from wirebond.server.command_log import CommandLog
from wirebond.server.owner import Owner
from wirebond.server.recordings import Recordings

if TYPE_CHECKING:
    from wirebond.link import Link


class Server:
    """Serves a link to programs that attach. Starts at once; ends with ``close``, or a ``with`` block.

    It closes the link's clients, not the link.

    :param link: the link that is served; the server takes all its messages.
    :param path: of a Unix socket to listen at. Only this user may attach there.
    :param tcp: host and port to listen at; the port may be 0: any.
    :param token: what clients at TCP must say. None: one is made. Loopback needs it too: every user of a computer
        reaches it.
    :param recordings: a folder for recordings that clients ask for; it is made if need be. None: clients can only
        record at their own computers.
    :raises PortError: it cannot listen there.
    :raises UsageError: the folder cannot be written to; neither ``path`` nor ``tcp``; or no such host.
    """

    def __init__(
        self,
        link: Link,
        path: str | os.PathLike[str] | None = None,
        *,
        tcp: tuple[str, int] | None = None,
        token: str | None = None,
        recordings: str | os.PathLike[str] | None = None,
    ) -> None:
        self._owner = Owner(link, path, tcp=tcp, token=token, recordings=recordings)

    @property
    def link(self) -> Link:
        """The link that is served."""
        return self._owner.link

    @property
    def path(self) -> str | None:
        """The Unix socket that it listens at, or None."""
        return self._owner.path

    @property
    def port(self) -> int | None:
        """The TCP port that it listens at, or None."""
        return self._owner.port

    @property
    def token(self) -> str | None:
        """The token that TCP clients must send; None: the server does not listen on TCP, and needs none."""
        return self._owner.token

    @property
    def recordings(self) -> Recordings:
        """The recordings for all clients: ``start``, ``stop``, ``list``, ``mark``, ``annotate``. Any thread; they wait
        for the disk."""
        return self._owner.recordings

    @property
    def log(self) -> CommandLog:
        """The log of commands: which client, what, and when. Any thread."""
        return self._owner.log

    @property
    def holder(self) -> str | None:
        """The name of the client in control, or None. Any thread."""
        return self._owner.holder

    @property
    def stopped_by(self) -> str | None:
        """The name of the program whose emergency stop holds, or None. It outlives the server: it is kept in a file
        beside ``path``, and the next server there holds it from its start. Any thread."""
        return self._owner.stopped_by

    @property
    def client_count(self) -> int:
        """The number of attached clients. Any thread."""
        return self._owner.client_count

    def connect(self) -> socket.socket:
        """Attach within this process: the other end of this connection is a client's, as at the path. Any thread.

        :returns: a connected socket.
        :raises PortError: the server is closed.
        """
        return self._owner.connect()

    def close(self) -> None:
        """End every connection; the leases of the client in control end with their safe values. The link stays open. A
        second call does nothing."""
        self._owner.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
