"""The events of a link or a recording as sentences, numbered, the oldest dropped first."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

from wirebond.chinese import with_chinese
from wirebond.link.tap import LinkEvent

MOST_KEPT = 2000


class Happenings:
    """One thread adds; others read.

    :param most: that are kept, the newest; None: all.
    """

    def __init__(self, most: int | None = MOST_KEPT) -> None:
        self._events: deque[tuple[int, dict[str, Any]]] = deque(maxlen=most)
        self.newest = 0  # the number of the newest one

    def add(self, event: LinkEvent) -> None:
        """Add an event."""
        self.newest += 1
        facts = dict(event.facts)
        told = {"t": event.t, "kind": event.kind, "text": sentence(event), **facts}
        self._events.append((self.newest, with_chinese(told, "why") if event.kind == "port_down" else told))

    def since(self, number: int, until: float | None = None) -> list[dict[str, Any]]:
        """Return those with a higher number; none that happened after ``until``."""
        return [e for n, e in list(self._events) if n > number and (until is None or e["t"] <= until)]


def sentence(event: LinkEvent) -> str:
    """Return the event in words."""
    facts = event.facts
    match event.kind:
        case "port_up":
            return "the port is there"
        case "port_down":
            return f"the port is away: {facts.get('why', '')}".rstrip(": ")
        case "port_settings":
            return "another program changed the settings of the port; they are as before"
        case "stopped":
            return "emergency stop"
        case "released":
            return "the emergency stop is released"
        case "deadline_struck":
            return f"{facts.get('action')}: its message stayed away"
        case "deadline_ended":
            return f"{facts.get('action')} has ended"
        case "lease_begun":
            return f"{facts.get('message')} is repeated"
        case "lease_ended":
            return f"{facts.get('message')} is not repeated any more: {_plain(facts.get('why', ''))}".rstrip(": ")
        case "control":
            holder = facts.get("holder")
            who = "nobody is in control" if holder is None else f"{holder} is in control"
            return f"{who} ({facts.get('why')})"
        case "log" | "mark":
            return str(facts.get("text", ""))
    return event.kind + _listed(facts)


def _plain(word: object) -> str:
    return str(word).replace("_", " ")


def _listed(facts: Mapping[str, Any]) -> str:
    return "".join(f", {name} {value}" for name, value in facts.items())
