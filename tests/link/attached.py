"""The links of a test are attached ones: behind each `wirebond.open` is a server that owns the port."""

from __future__ import annotations

import itertools
import os
import tempfile
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import wirebond
from tests.patient_servers import be_patient
from wirebond.link import Link, open_link
from wirebond.server import Server

_numbers = itertools.count()


@contextmanager
def attached_links() -> Iterator[None]:
    """`wirebond.open` opens the port with a server, and gives a link that is attached to it. Closing that one closes
    the others."""
    patch = pytest.MonkeyPatch()
    be_patient(patch)
    opened: list[tuple[Server, Link]] = []
    with tempfile.TemporaryDirectory() as folder:

        def open_attached(protocol: Any, port: str | os.PathLike[str], *args: Any, **options: Any) -> Link:
            own = open_link(protocol, port, *args, **options)
            path = Path(folder) / f"{next(_numbers)}.sock"
            server = Server(own, path)
            link = open_link(
                own.codec, f"wirebond://{path}", own.baud, role=own.role, listen=options.get("listen", "own")
            )
            opened.append((server, own))
            weakref.finalize(link, end, server, own)
            close = link.close

            def close_all() -> None:
                close()
                end(server, own)

            link.close = close_all  # type: ignore[method-assign]
            return link

        patch.setattr(wirebond, "open", open_attached)
        try:
            yield
        finally:
            patch.undo()
            for server, own in opened:
                end(server, own)


def end(server: Server, own: Link) -> None:
    server.close()
    own.close()
