"""Who is in control: one client at a time may command what moves. No socket, no thread, no clock: time is an argument.

A client is in control from its first command, or from ``take``, until it releases it, goes, is silent for 0.3 s, is
taken over, or an emergency stop. One that lost control against its will does not get it back by its next command: a
program that a person has stopped does not drive on because it never looked.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Literal

from wirebond.attach.words import OLDEST_COMMAND, SILENCE

_TICKS_KEPT = 64  # times of the newest ticks: a command with an older one is late anyway
Why = Literal["taken", "taken over", "released", "gone", "silent", "emergency stop"]


@dataclass
class _Client:
    name: str
    asks: bool  # its commands do not take control by themselves
    beat: float  # when it last showed that it runs and hears


@dataclass
class Ticks:
    """The server's ticks and their times."""

    newest: int = 0
    _times: dict[int, float] = field(default_factory=dict)

    def next(self, now: float) -> int:
        """One more tick."""
        self.newest += 1
        self._times[self.newest] = now
        self._times.pop(self.newest - _TICKS_KEPT, None)
        return self.newest

    def age(self, tick: int, now: float) -> float:
        """Seconds since the tick after this one: at least so long ago was what its sender had seen."""
        if tick > self.newest:
            return float("inf")  # it never was
        if tick == self.newest:
            return 0.0
        after = self._times.get(tick + 1)
        return float("inf") if after is None else now - after


class ControlBook:
    """One thread at a time. Clients are any values that compare."""

    def __init__(self) -> None:
        self.ticks = Ticks()
        self.holder: Hashable | None = None
        self._clients: dict[Hashable, _Client] = {}

    def add(self, client: Hashable, name: str, asks: bool, now: float) -> None:
        """It attached."""
        self._clients[client] = _Client(name, asks, now)

    def remove(self, client: Hashable) -> bool:
        """It is gone. True: it was in control."""
        was = self.holder == client
        if was:
            self.holder = None
        self._clients.pop(client, None)
        return was

    @property
    def name(self) -> str | None:
        """Of the client in control."""
        return None if self.holder is None else self._clients[self.holder].name

    def beat(self, client: Hashable, tick: int, now: float) -> None:
        """It runs, and has seen this tick. What was under way for long shows nothing."""
        if self.ticks.age(tick, now) <= OLDEST_COMMAND:
            self._clients[client].beat = now

    def refuses(self, client: Hashable, tick: int, now: float) -> tuple[str, str] | None:
        """Why this client may not command at this moment: a word and a sentence. None: it may, and is in control."""
        age = self.ticks.age(tick, now)
        if age > OLDEST_COMMAND:
            return "late", (
                f"the command was under way for more than {OLDEST_COMMAND:g} s (it had seen tick {tick}, and the "
                f"server is at {self.ticks.newest}); look at the network, and send it again if it is still meant"
            )
        if self.holder == client:
            return None
        if self.holder is not None:
            return "not_in_control", (
                f"{self.name} is in control of the robot; wait until it releases it, or take over with "
                "take_control(over=True)"
            )
        if self._clients[client].asks:
            return "not_in_control", (
                "this program has lost control of the robot and no program has it; call take_control() to have it again"
            )
        self._take(client, now)
        return None

    def take(self, client: Hashable, over: bool, now: float) -> str | None:
        """Why it does not get control; None: it has it. Of another holder, call ``give_up`` first."""
        if self.holder not in (None, client) and not over:
            return f"{self.name} is in control of the robot; take over with take_control(over=True)"
        self._take(client, now)
        return None

    def _take(self, client: Hashable, now: float) -> None:
        self.holder = client
        self._clients[client].asks = False
        self._clients[client].beat = now

    def give_up(self, against_its_will: bool) -> Hashable | None:
        """The holder is in control no more; who it was."""
        was, self.holder = self.holder, None
        if was is not None and against_its_will:
            self._clients[was].asks = True
        return was

    def may_take_by_command(self, client: Hashable) -> None:
        """Its next command takes control where nobody has it: its own user ended the emergency stop."""
        self._clients[client].asks = False

    def silent(self, now: float) -> bool:
        """Has the holder not shown for too long that it runs?"""
        return self.holder is not None and now - self._clients[self.holder].beat > SILENCE
