"""Computes how long an urgent frame waits for a run of bytes that the sender's DMA has begun."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from wirebond.analysis.check.findings import Finding, Severity
from wirebond.analysis.check.fixed_end import is_fixed
from wirebond.analysis.check.line_budget import Budget
from wirebond.analysis.check.places import Places
from wirebond.analysis.check.wording import direction, seconds
from wirebond.protocol.model import End, Message, Protocol

RULE = "urgent-wait"
_HOST_RUN = 0.001  # seconds of line that the host hands over at once; at the MCU it is the file's `max_run`


@dataclass(frozen=True)
class UrgentWait:
    """A direction. A run that was begun leaves first: frames that take no longer than ``max_run_seconds``, or a
    single longer one."""

    sender: End
    max_run_seconds: float
    longest_frame_seconds: float

    @property
    def seconds(self) -> float:
        return max(self.max_run_seconds, self.longest_frame_seconds)

    def as_dict(self) -> dict[str, Any]:
        return {
            "seconds": self.seconds,
            "max_run_seconds": self.max_run_seconds,
            "longest_frame_seconds": self.longest_frame_seconds,
        }


def urgent_wait(protocol: Protocol, budget: Budget) -> UrgentWait:
    run = protocol.link.max_run if budget.sender == End.MCU else _HOST_RUN
    return UrgentWait(budget.sender, run, budget.longest_frame / budget.capacity)


def assess(protocol: Protocol, waits: list[UrgentWait], places: Places) -> list[Finding]:
    """Report a wait that is longer than the direction's shortest period, or than half of its shortest deadline."""
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
        waits_for_run = wait.max_run_seconds > wait.longest_frame_seconds
        if is_fixed(protocol, wait.sender) or (protocol.fixed is not None and not waits_for_run):
            continue  # neither its queue nor the size of a frame can be changed
        limit, why = min(limits)
        if wait.seconds <= limit:
            continue
        longest: Message = max(messages, key=lambda message: message.max_payload)
        if waits_for_run:
            place = places.at("link", "max_run")
            behind, rule = "the frames of a run", "a run that was begun is sent to its end"
            advice = "lower `link: max_run`"
        else:
            place = places.at("messages", longest.name)
            behind, rule = f"`{longest.name}`", "a frame that was begun is sent to its end"
            advice = f"shorten `{longest.name}`, send it in pieces, or raise the baud rate"
        found.append(
            Finding(
                RULE,
                Severity.WARNING,
                f"{direction(wait.sender)} an urgent frame waits up to {seconds(wait.seconds)} after {behind}",
                f"{rule}, and {why}",
                advice,
                place.line,
                place.column,
            )
        )
    return found
