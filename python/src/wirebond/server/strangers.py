"""Rules for connections that have not authenticated. No socket, no clock.

Anyone who reaches a port can open silent connections, or try tokens. They must not keep out a program that
has the token, and they must not be many: each takes a file descriptor, and the serial port needs one, too.
"""

from __future__ import annotations

from typing import Generic, TypeVar

MOST = 128  # connections of strangers at a time: more than are accepted before the first of them is read
WITHIN = 2.0  # seconds in which a stranger must say something
LOOKS = 8  # at those who say nothing, in that time. Time in which the server itself stood still counts as one of them
DELAY = 1.0  # seconds that a token waits for its answer, after a wrong one from the same address
LONG = 20  # characters of a token that cannot be guessed, however many attempts a second are made
_REMEMBER = 60.0  # seconds that a wrong token counts
_MOST_ADDRESSES = 1024

_T = TypeVar("_T")


class Strangers(Generic[_T]):
    """The connections of strangers, by the time of their last activity.

    A program that has the token shows it at once, and so is among the newest. Where there are too many, the oldest
    goes.
    """

    def __init__(self, most: int = MOST) -> None:
        self._most = most
        # In the order of activity. True: is never displaced; False: is displaced first.
        self._stay: dict[_T, bool | None] = {}

    def __len__(self) -> int:
        return len(self._stay)

    def __contains__(self, who: _T) -> bool:
        return who in self._stay

    def enter(self, who: _T) -> _T | None:
        """Note a connection, or its activity. Returns the one that must be closed for it, which may be itself."""
        self._stay[who] = self._stay.pop(who, None)
        if len(self._stay) <= self._most:
            return None
        goes = min(self._stay, key=lambda other: {False: 0, None: 1, True: 2}[self._stay[other]])
        if self._stay[goes]:
            goes = who
        del self._stay[goes]
        return goes

    def wait(self, who: _T, *, makes_way: bool) -> None:
        """Wait for the token's answer. Without ``makes_way`` it is never displaced; otherwise by any other."""
        if who in self._stay:
            self._stay[who] = not makes_way

    def leave(self, who: _T) -> None:
        """Forget a connection that has ended, or has shown the token."""
        self._stay.pop(who, None)


class WrongTokens:
    """The delay of the answer to a wrong token.

    The first token of an address is answered at once. After a wrong one each wrong one waits. If the server's token is
    short, so that it could be guessed, the right one waits, too, and each that waits keeps one of the few connections
    of strangers: this limits guesses, however they are spread over connections. If it is long, a flood of wrong tokens
    must keep nobody out: the right one does not wait, and wrong ones make way.

    :param token: the right one; None: every one is right.
    """

    def __init__(self, token: str | None) -> None:
        self.is_short = token is not None and len(token) < LONG
        self._last: dict[str, float] = {}  # by address, in the order of time

    def delay(self, address: str, now: float, *, is_right: bool) -> float:
        """Return how many seconds a token from there has to wait."""
        if is_right and not self.is_short:
            return 0.0
        last = self._last.get(address)
        return DELAY if last is not None and now - last < _REMEMBER else 0.0

    def note(self, address: str, now: float) -> None:
        """Note a wrong token from there."""
        self._last.pop(address, None)
        self._last[address] = now
        if len(self._last) > _MOST_ADDRESSES:
            del self._last[next(iter(self._last))]
