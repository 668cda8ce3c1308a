"""Publishes the state of the link and the robot as diagnostic_msgs/DiagnosticArray once a second."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from wirebond.errors import LinkDownError
from wirebond.protocol.model import Deadline, End
from wirebond.ros2.mapping.model import BridgeMapping, FlagsMapping
from wirebond.ros2.node import Node

if TYPE_CHECKING:
    from wirebond.link import Link
    from wirebond.ros2.commands import Commands
    from wirebond.ros2.held_back import HeldBack
    from wirebond.ros2.serial_topics import SerialTopics

OK, WARN, ERROR, STALE = 0, 1, 2, 3
_OF_STATE = {"up": OK, "stale": WARN, "down": ERROR}


class Diagnostics:
    """The diagnostics of one link. One thread at a time."""

    def __init__(
        self,
        link: Link,
        commands: Commands,
        mapping: BridgeMapping,
        node: Node,
        serial: SerialTopics | None,
        held_back: HeldBack | None,
    ) -> None:
        self._link = link
        self._commands = commands
        self._node = mapping.node
        self._flags = mapping.diagnostics
        self._unreadable = node.undecodable
        self._serial = serial
        self._held_back = held_back
        self._deadlines = [d for d in link.codec.model.deadlines if d.at == End.HOST]
        self._before: Counter[str] = Counter()  # counts at the message before

    def message(self, stamp: Mapping[str, int]) -> dict[str, Any]:
        """Return the message for now."""
        statuses = [self._of_link(), self._of_commands(), self._of_topics(), *map(self._of_flags, self._flags)]
        if self._serial is not None:
            statuses.append(self._of_serial(self._serial))
        if self._deadlines or self._held_back is not None:
            statuses.append(self._of_deadlines())
        return {"header": {"stamp": stamp}, "status": statuses}

    def _of_link(self) -> dict[str, Any]:
        state = self._link.state
        words = {"up": "messages come", "stale": "the port is open, and no message came for a second"}
        facts: dict[str, Any] = {"port": self._link.port, "tty": self._link.device}
        with contextlib.suppress(LinkDownError):  # the server is away, which has the counts
            stats = self._link.stats
            facts |= {
                "received frames": stats.receive.frames,
                "discarded bytes": sum(stats.receive.discarded_bytes.values()),
                "sent frames": stats.send.sent,
                "reconnects": stats.reconnects,
                "collisions": stats.collisions,
            }
        return self._status("link", _OF_STATE[state], words.get(state) or self._link.why, facts)

    def _of_commands(self) -> dict[str, Any]:
        counts = dict(self._commands.counts)
        new = self._new("refused", counts["refused"])
        why = [self._commands.why_stopped] if self._commands.why_stopped else []
        if self._held_back is not None:
            why += self._held_back.texts()
            counts["held back by the MCU"] = self._held_back.frames
        level = WARN if new or why else OK
        text = "; ".join(why) or (f"{new} refused in the last second" if new else "none refused")
        return self._status("commands", level, text, counts)

    def _of_topics(self) -> dict[str, Any]:
        counts = dict(self._unreadable)
        new = [topic for topic, count in counts.items() if self._new(topic, count)]
        text = f"a message on {', '.join(new)} was not of its type" if new else "all messages are of their types"
        facts = {f"{topic}: messages not of its type": count for topic, count in counts.items()}
        return self._status("topics", WARN if new else OK, text, facts)

    def _of_serial(self, serial: SerialTopics) -> dict[str, Any]:
        new = self._new("serial", serial.unknown_frames + sum(serial.undecodable.values()))
        name = self._link.codec.name
        text = f"in the last second bytes came that are not a frame of {name}" if new else "all bytes are frames"
        facts = {"frames": serial.frames, "frames with an unknown id": serial.unknown_frames}
        facts |= {f"bytes: {cause.replace('_', ' ')}": count for cause, count in serial.undecodable.items()}
        return self._status("serial_tx_data", WARN if new else OK, text, facts)

    def _new(self, what: str, count: int) -> int:
        """Return the growth of this count since the previous message."""
        before, self._before[what] = self._before[what], count
        return count - before

    def _of_flags(self, flags: FlagsMapping) -> dict[str, Any]:
        name = f"{flags.message} {flags.field}"
        latest = self._link.latest(flags.message)
        if latest is None:
            return self._status(name, STALE, f"no {flags.message} has come yet", {})
        there = latest.message.fields[flags.field]
        words = [flags.words.get(flag, f"bit {flag}") for flag in there]
        facts = {word: str(flag in there).lower() for flag, word in flags.words.items()}
        return self._status(name, ERROR if words else OK, ", ".join(words) or "no error", facts)

    def _of_deadlines(self) -> dict[str, Any]:
        struck = self._link.deadlines
        late = [deadline_words(d) for d in self._deadlines if struck[d.then]]
        facts = {d.then: "struck" if struck[d.then] else "waits" for d in self._deadlines}
        if self._held_back is not None:
            late += self._held_back.texts()
            facts |= self._held_back.facts()
        return self._status("deadlines", WARN if late else OK, "; ".join(late) or "all messages come in time", facts)

    def _status(self, what: str, level: int, text: str, facts: Mapping[str, Any]) -> dict[str, Any]:
        return {
            "level": level,
            "name": f"{self._node}: {what}",
            "message": text,
            "hardware_id": self._link.device,
            "values": [{"key": key, "value": str(value)} for key, value in facts.items()],
        }


def deadline_words(deadline: Deadline) -> str:
    """Return the words for a message that stays away."""
    return f"no {deadline.message} for {deadline.after:g} s"
