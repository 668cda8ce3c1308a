"""Decides which client is in control: one at a time may command motion. No socket, no thread, no clock: time is an
argument.

A client is in control from its first command, or from ``take``, until it releases it, goes, is silent for 0.3 s, is
taken over, or an emergency stop. One that lost control against its will does not get it back by its next command: a
program that a person has stopped does not drive on because it never looked.

After the release of an emergency stop nobody is in control, and the program that released it goes first. Until
somebody is in control again, the others that were there get it only by ``take`` with ``over``: a program that asks in a
loop must not win by chance.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Literal

from wirebond.link.attached.words import OLDEST_COMMAND, SILENCE, TICK_EVERY

_TICKS_KEPT = 64  # times of the newest ticks: a command with an older one is late anyway
Why = Literal["taken", "taken over", "released", "gone", "silent", "emergency stop", "stop released"]


@dataclass
class _Client:
    name: str
    asks: bool  # its commands do not take control by themselves
    waits: bool = field(default=False, kw_only=True)  # it must say `over`: another program released an emergency stop
    beat: float  # when it last showed that it runs and hears


@dataclass
class Ticks:
    """The server's ticks and their times."""

    newest: int = 0
    _times: dict[int, float] = field(default_factory=dict)

    def next(self, now: float) -> int:
        """Count one more tick."""
        if self.newest == 0:
            self._times[0] = now  # for clients that attached before the first tick
        self.newest += 1
        self._times[self.newest] = now
        self._times.pop(self.newest - _TICKS_KEPT, None)
        return self.newest

    def age(self, tick: int, now: float) -> float:
        """Return the seconds since the tick after this one was due: its sender's state was at least that old.

        The time when that tick was really made says nothing: while the server is stalled, it makes none.
        """
        if tick > self.newest:
            return float("inf")  # it never was
        if self.newest == 0:
            return 0.0
        made = self._times.get(tick)
        return float("inf") if made is None else max(0.0, now - made - TICK_EVERY)


class ControlBook:
    """One thread at a time. Clients are any values that compare."""

    def __init__(self) -> None:
        self.ticks = Ticks()
        self.holder: Hashable | None = None
        self.released_by: str | None = None  # the program that ended the emergency stop, until somebody takes control
        self._clients: dict[Hashable, _Client] = {}

    def add(self, client: Hashable, name: str, asks: bool, now: float) -> None:
        """Add a client that has attached."""
        self._clients[client] = _Client(name, asks, now)

    def remove(self, client: Hashable) -> bool:
        """Remove a client that is gone. True: it was in control."""
        was = self.holder == client
        if was:
            self.holder = None
        self._clients.pop(client, None)
        return was

    @property
    def name(self) -> str | None:
        """The name of the client in control."""
        return None if self.holder is None else self._clients[self.holder].name

    def beat(self, client: Hashable, tick: int, now: float) -> None:
        """Note that the client runs, and has seen this tick. Ticks that were under way for long show nothing."""
        if self.ticks.age(tick, now) <= OLDEST_COMMAND:
            self._clients[client].beat = now

    def late(self, tick: int, now: float) -> str | None:
        """Return why a request with this tick comes too late; None if it does not."""
        if self.ticks.age(tick, now) <= OLDEST_COMMAND:
            return None
        return (
            f"the command was under way for more than {OLDEST_COMMAND:g} s (it had seen tick {tick}, and the "
            f"server is at {self.ticks.newest}); check the network, and send it again if it is still wanted"
        )

    def refuses(self, client: Hashable, tick: int, now: float) -> tuple[str, str] | None:
        """Return why this client may not command at this moment: a word and a sentence. None: it may, and is in
        control."""
        late = self.late(tick, now)
        if late is not None:
            return "late", late
        if self.holder == client:
            return None
        if self.holder is not None:
            return "not_in_control", (
                f"{self.name} is in control of the robot; wait until it releases it, or take over with "
                "take_control(over=True)"
            )
        if self._waits(client):
            return "not_in_control", self._after_release()
        if self._clients[client].asks:
            return "not_in_control", (
                "this program has lost control of the robot and no program has it; call take_control() to have it again"
            )
        self._take(client, now)
        return None

    def take(self, client: Hashable, over: bool | str, now: float) -> str | None:
        """Take control. Returns why it does not get it; None: it has it. If there is another holder, call ``give_up``
        first."""
        if self.holder not in (None, client) and isinstance(over, str) and over != self.name:
            return f"{self.name} is in control of the robot by now, not {over}; decide again, and name that one"
        if self.holder not in (None, client) and not over:
            return f"{self.name} is in control of the robot; take over with take_control(over=True)"
        if self.holder is None and self._waits(client) and over not in (True, self.released_by):
            return self._after_release()
        self._take(client, now)
        return None

    def _take(self, client: Hashable, now: float) -> None:
        self.holder = client
        self.released_by = None
        self._clients[client].asks = False
        self._clients[client].beat = now

    def give_up(self, against_its_will: bool) -> Hashable | None:
        """End the holder's control; return the holder."""
        was, self.holder = self.holder, None
        if was is not None and against_its_will:
            self._clients[was].asks = True
        return was

    def all_must_ask(self) -> None:
        """Require an explicit request for control from now on: a program that sends without pause would win by
        chance."""
        self.released_by = None
        for client in self._clients.values():
            client.asks = True

    def released(self, name: str, by: Hashable | None) -> None:
        """Note that an emergency stop was released.

        :param name: of the program that released it.
        :param by: the client that released it, which goes first: its own user ended the stop. None: no client did.
        """
        self.all_must_ask()
        self.released_by = name
        for key, client in self._clients.items():
            client.waits = key != by
            client.asks = key != by

    def may_take_by_command(self, client: Hashable) -> None:
        """Allow its next command to take control if no client has it: it released control itself."""
        self._clients[client].asks = False

    def _waits(self, client: Hashable) -> bool:
        return self.released_by is not None and self._clients[client].waits

    def _after_release(self) -> str:
        return (
            f"{self.released_by} released the emergency stop, and no program has been in control since; look at the "
            "robot, then take control with take_control(over=True)"
        )

    def silent(self, now: float) -> bool:
        """Check whether the holder has been silent for too long."""
        return self.holder is not None and now - self._clients[self.holder].beat > SILENCE
