"""Deadlines at the MCU that hold commands back: which have struck by what the link sent, and how ROS ends them.

An MCU in such a state receives commands and does not act. It seldom says so, and the link refuses nothing. But the rule
is in the protocol file, and this end knows when it was silent.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from wirebond.errors import WirebondError
from wirebond.protocol.model import Deadline, End, Protocol, Recover, Start
from wirebond.recording.history.mcu_deadlines import McuDeadlines
from wirebond.ros2.commands import RefusedError
from wirebond.ros2.throttle import Log, Throttle

if TYPE_CHECKING:
    from wirebond.codec import Message
    from wirebond.link import Link
    from wirebond.link.tap import Tap
    from wirebond.ros2.commands import Commands

_TAP_BYTES = 1 << 20  # that wait for the next read: 2 s of both directions at 2 Mbaud


def can_hold_back(model: Protocol) -> bool:
    """Check whether the MCU has a deadline that ends only by an explicit message or call."""
    return bool(_explicit(model))


class HeldBack:
    """Watches what a link sends. One thread at a time; only ``recover`` may be called by any.

    :ivar topic: the whole name of the topic that ends these deadlines; empty: the file does not say what ends them.
    :ivar frames: how many commands were sent that the MCU held back.
    """

    def __init__(self, link: Link, commands: Commands, log: Log, topic: str) -> None:
        self._link = link
        self._commands = commands
        self._log = log
        self._throttle = Throttle(log)
        model = link.codec.model
        self._rules = _explicit(model)
        found = [rule.recover_by for rule in self._rules.values() if rule.recover_by is not None]
        self._enders = [ender for index, ender in enumerate(found) if ender not in found[:index]]
        self.topic = topic if self._enders else ""
        self.frames = 0
        self._watch = McuDeadlines(model)
        self._known = {rule.message for rule in self._rules.values()} | {ender.message for ender in self._enders}
        self._tap: Tap | None = None
        self._sent = link.codec.decoder(sender="host")
        self._struck: dict[int, float] = {}  # since when, by the deadline's place in the file
        self._unknown = set(self._rules)  # none of its messages was sent yet

    def look(self) -> None:
        """Take what was sent since the last call, and log the changes."""
        messages = self._messages()
        self._note(messages)
        before, self._struck = self._struck, {}
        for state in self._watch.states(time.monotonic()):
            index, since = state["deadline"], state["since"]
            if index not in self._rules:
                continue
            rule = self._rules[index]
            if state["unknown"] and rule.start == Start.HELD:
                since = 0.0  # from the MCU's start on
            if index in self._unknown and not state["unknown"]:
                self._unknown.discard(index)
                self._log("info", f"it is not known whether the MCU was in {rule.then} already; {self._how(rule)}")
            if index in before and before[index] != since:
                self._log("info", f"{rule.then} is over: the MCU acts on {rule.message} again")
            if since is not None:
                self._struck[index] = since
                held = sum(message.name == rule.message and message.t >= since for message in messages)
                self.frames += held
                if held or before.get(index) != since:
                    self._throttle.say("warning", rule.then, self._text(rule, since))

    def texts(self) -> list[str]:
        """Return a sentence for each deadline that holds commands back now."""
        return [self._text(self._rules[index], since) for index, since in self._struck.items()]

    def facts(self) -> dict[str, str]:
        """Return the state of each deadline, as values for diagnostics."""
        return {
            f"{rule.then} (MCU)": "struck"
            if index in self._struck
            else "unknown"
            if index in self._unknown
            else "waits"
            for index, rule in self._rules.items()
        }

    def recover(self) -> None:
        """Send what ends these deadlines. What is refused is counted and logged as for any command."""
        for ender in self._enders:
            try:
                self._commands.tell(ender.message, ender.fields, header=dict(ender.header) or None)
            except RefusedError:
                continue

    def _messages(self) -> list[Message]:
        """Return the messages sent since the last call. If the server restarted, its tap is gone, and a new one is
        opened."""
        try:
            if self._tap is None:
                self._tap = self._link.tap(_TAP_BYTES)
                self._sent = self._link.codec.decoder(sender="host")
            pieces = self._tap.take().pieces
        except WirebondError:
            self._tap = None
            return []
        return [
            message
            for piece in pieces
            if getattr(piece, "direction", "") == "sent"
            for message in self._sent.feed(getattr(piece, "bytes", b""), t=piece.t)
            if message.name in self._known
        ]

    def _note(self, messages: list[Message]) -> None:
        by_name: dict[str, list[Message]] = {}
        for message in messages:
            by_name.setdefault(message.name, []).append(message)
        tables: dict[str, Any] = {name: {"t": np.array([m.t for m in of])} for name, of in by_name.items()}
        if tables:
            self._watch.sent(tables, lambda name, row: by_name[name][row].fields)

    def _text(self, rule: Deadline, since: float) -> str:
        if since == 0.0:
            return (
                f"the MCU starts in {rule.then} (`start: held`) and ignores {rule.message} unless somebody ended that; "
                f"{self._how(rule)}"
            )
        return (
            f"no {rule.message} was sent for {rule.after:g} s: the MCU is in {rule.then} and ignores {rule.message}; "
            f"{self._how(rule)}"
        )

    def _how(self, rule: Deadline) -> str:
        if rule.recover_by is None:
            return f"the protocol file does not say which message ends {rule.then} (`recover_by`)"
        return f"to end {rule.then}: ros2 topic pub --once {self.topic} std_msgs/msg/Empty"


def _explicit(model: Protocol) -> dict[int, Deadline]:
    """Return these deadlines by their places in the file."""
    return {
        index: rule
        for index, rule in enumerate(model.deadlines)
        if rule.at == End.MCU and rule.recover == Recover.EXPLICIT
    }
