"""How long an urgent frame waits behind a run of bytes that the sender's DMA has begun."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from wirebond.lint.findings import Finding, Severity
from wirebond.lint.line_budget import Budget
from wirebond.lint.places import Places
from wirebond.lint.wording import direction, seconds
from wirebond.protocol.model import End, Message, Protocol

RULE = "urgent-wait"
MAX_RUN = 0.001  # seconds of line in one run; a longer frame is a run of its own


@dataclass(frozen=True)
class UrgentWait:
    """One direction. ``seconds``: the longer of ``MAX_RUN`` and the longest frame's time on the line."""

    sender: End
    seconds: float
    longest_frame_seconds: float

    def as_dict(self) -> dict[str, Any]:
        return {"seconds": self.seconds, "longest_frame_seconds": self.longest_frame_seconds}


def urgent_wait(budget: Budget) -> UrgentWait:
    frame = budget.longest_frame / budget.capacity
    return UrgentWait(budget.sender, max(MAX_RUN, frame), frame)


def judge(protocol: Protocol, waits: list[UrgentWait], places: Places) -> list[Finding]:
    """A wait that is longer than the direction's shortest period, or than half of its shortest deadline."""
    found = []
    for wait in waits:
        messages = [message for message in protocol.messages if message.sent_by(wait.sender)]
        limits = [(m.every, f"`{m.name}` is due every {seconds(m.every)}") for m in messages if m.every is not None]
        limits += [
            (d.after / 2, f"`{d.message}` is missed after {seconds(d.after)}")
            for d in protocol.deadlines
            if d.at != wait.sender
        ]
        if not limits:
            continue
        limit, why = min(limits)
        if wait.seconds <= limit:
            continue
        longest: Message = max(messages, key=lambda message: message.max_payload)
        place = places.at("messages", longest.name)
        found.append(
            Finding(
                RULE,
                Severity.WARNING,
                f"{direction(wait.sender)} an urgent frame waits up to {seconds(wait.seconds)} behind `{longest.name}`",
                f"a frame that was begun is sent to its end, and {why}",
                f"shorten `{longest.name}`, send it in pieces, or raise the baud rate",
                place.line,
                place.column,
            )
        )
    return found
