"""The end of the process, and forks: every open link is closed with its safe values, and a child has none."""

from __future__ import annotations

import atexit
import os
import threading
import weakref
from typing import Protocol

from wirebond import _engine
from wirebond.errors import LinkDownError
from wirebond.link.engine import Engine
from wirebond.link.inbox import Inbox


class OpenLink(Protocol):
    """A link as the end of the program sees it."""

    _engine: Engine
    _inbox: Inbox

    def close(self) -> None: ...


HANDLERS_PATIENCE = 1.0  # seconds that `close` waits for handlers

_open_links: weakref.WeakSet[OpenLink] = weakref.WeakSet()
_open_links_lock = threading.RLock()  # another thread may open a link while the program ends
_is_ending = False


def is_ending() -> bool:
    """Return whether the interpreter ends."""
    return _is_ending


def forget(link: OpenLink) -> None:
    """Forget a link that is closed."""
    with _open_links_lock:
        _open_links.discard(link)


def refuse_at_the_end() -> None:
    if _is_ending:
        raise LinkDownError("the program is ending; a link cannot be opened any more")


def note_open(link: OpenLink) -> None:
    with _open_links_lock:
        if not _is_ending:
            _open_links.add(link)
            return
    link._engine.close()
    refuse_at_the_end()


def _close_all() -> None:
    """Close all links, because the interpreter ends: safe values leave. Threads that wait in a link do not return to
    Python, which no longer exists for them."""
    global _is_ending  # noqa: PLW0603 there is one end
    _engine.hold_waiting_threads()
    with _open_links_lock:
        _is_ending = True
        links = list(_open_links)
    for link in links:  # every lease ends before any close waits
        link._engine.begin_close()
    for link in links:
        link._inbox.handlers.stop(HANDLERS_PATIENCE)
        link.close()
    _engine.settle_threads()


def _leave_to_the_parent() -> None:
    """Give the ports' copies back in a forked child, and send nothing."""
    global _open_links_lock  # noqa: PLW0603 a thread that is not here may have held it
    _open_links_lock = threading.RLock()
    _engine.after_fork()
    for link in list(_open_links):
        link._engine.after_fork()
    _open_links.clear()


atexit.register(_close_all)
if hasattr(os, "register_at_fork"):  # Windows does not fork
    os.register_at_fork(after_in_child=_leave_to_the_parent)
