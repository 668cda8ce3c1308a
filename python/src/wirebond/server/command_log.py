"""Records each command, its sender and its time: bounded, the oldest go first. One thread adds; others read."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from wirebond.link.attached import words

MOST_KEPT = 10_000
_MOVES = words.Send | words.Repeat
_OTHERS = (
    words.StopRepeating | words.EndSafely | words.Take | words.Release | words.Stop | words.ReleaseStop
    | words.Recover | words.SetAddress
)  # fmt: skip


@dataclass
class Command:
    """A command, or the same one given again and again.

    :ivar t: when it came first, and ``last``: for the last time; seconds on ``time.monotonic()``.
    :ivar client: the number of the client that gave it, and ``name`` the name that it gives itself.
    :ivar do: the word, as ``send`` or ``take``.
    :ivar message: the message's name; empty where the command has none.
    :ivar fields: as they were given; None: ``frame`` has them.
    :ivar error: the word by which it was refused; empty: it was not.
    """

    t: float
    last: float
    count: int
    client: int
    name: str
    do: str
    message: str = ""
    fields: Mapping[str, Any] | None = None
    header: Mapping[str, Any] | None = None
    frame: bytes | None = None
    error: str = ""

    def is_again(self, other: Command) -> bool:
        """Check whether the other one is the same command."""
        mine = self.fields, self.header, self.frame, self.error
        return mine == (other.fields, other.header, other.frame, other.error)


class CommandLog:
    """A value that is sent again and again is one entry."""

    def __init__(self) -> None:
        self._commands: deque[Command] = deque()
        self._newest: dict[tuple[int, str, str], Command] = {}  # by client, word and message
        self.dropped = 0  # entries that made room

    def note(self, client: int, name: str, request: words.Request, error: str, now: float) -> None:
        """Note that a client asked for this at ``now``. Requests that only ask are not commands."""
        do = str(request.__struct_config__.tag)
        if isinstance(request, _MOVES):
            found = Command(now, now, 1, client, name, do, request.message, request.fields, request.header)
            found.frame, found.error = request.frame, error
        elif isinstance(request, _OTHERS):
            found = Command(now, now, 1, client, name, do, getattr(request, "message", ""), error=error)
        else:
            return
        key = client, do, found.message
        before = self._newest.get(key)
        if before is not None and before.is_again(found):
            before.last, before.count = now, before.count + 1
            return
        self._newest[key] = found
        self._commands.append(found)
        if len(self._commands) > MOST_KEPT:
            oldest = self._commands.popleft()
            self.dropped += 1
            key = oldest.client, oldest.do, oldest.message
            if self._newest.get(key) is oldest:
                del self._newest[key]

    def commands(self) -> list[Command]:
        """Return all kept commands, the oldest first."""
        return list(self._commands)
