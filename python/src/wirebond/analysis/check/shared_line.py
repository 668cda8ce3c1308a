"""A line that both ends send on in turn (``link: echo: true``): who begins, and whether both fit."""

from __future__ import annotations

from wirebond.analysis.check.findings import Finding, Severity
from wirebond.analysis.check.fixed_end import is_fixed
from wirebond.analysis.check.line_budget import Budget
from wirebond.analysis.check.places import Places
from wirebond.analysis.check.wording import percent, seconds
from wirebond.protocol.model import End, Protocol

RULE = "shared-line"
_FULL = 1.0
_CROWDED = 0.7


def assess(protocol: Protocol, directions: list[Budget], places: Places) -> list[Finding]:
    if not protocol.link.echo:
        return []
    return [*_both_begin(protocol, places), *_too_much(directions, places)]


def _both_begin(protocol: Protocol, places: Places) -> list[Finding]:
    due = {
        end: [m for m in protocol.messages if m.every is not None and m.sent_by(end)] for end in End if end != End.BOTH
    }
    if not due[End.HOST] or not due[End.MCU]:
        return []
    first = due[End.MCU][0]
    host = due[End.HOST][0]
    place = places.at("messages", first.name, "every")
    return [
        Finding(
            RULE,
            Severity.WARNING,
            f"both ends begin to send by themselves: `{host.name}` is due every {seconds(host.every or 0)}, and "
            f"`{first.name}` every {seconds(first.every or 0)}",
            "`echo: true` is a line on which one end sends at a time; where both begin, frames collide and are lost",
            "set the device to answer only, if its manual has such a setting"
            if is_fixed(protocol, End.MCU)
            else f"let only the host begin: make `{first.name}` the `reply` of a request, and take its `every` away",
            place.line,
            place.column,
        )
    ]


def _too_much(directions: list[Budget], places: Places) -> list[Finding]:
    share = sum(budget.share for budget in directions)
    if share <= _CROWDED or any(budget.share > _CROWDED for budget in directions):
        return []  # the check of the line's budget reports one direction alone
    place = places.at("link", "echo")
    over = share > _FULL
    return [
        Finding(
            RULE,
            Severity.ERROR if over else Severity.WARNING,
            f"both directions together take {percent(share)} of the line",
            "`echo: true` is a line that carries one direction at a time, with a pause while an end turns from sending "
            "to listening",
            "raise the baud rate, send less often, or shorten the frames",
            place.line,
            place.column,
        )
    ]
