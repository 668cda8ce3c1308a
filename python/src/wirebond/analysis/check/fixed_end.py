"""Advice for a link one of whose ends cannot change: the frame format is given, and the other end's owner reads."""

from __future__ import annotations

from dataclasses import replace

from wirebond.analysis.check.findings import Finding, Severity
from wirebond.protocol.model import End, Protocol

# What can be done where the format cannot change; None: nothing, so that the finding is no use to anybody.
_WITH_A_GIVEN_FORMAT: dict[str, str | None] = {
    "check-strength": "give every field a `range`, and act on no single message that could do harm",
    "uncovered-part": "give every field a `range`, and act on no single message that could do harm",
    "false-frames": "give every field a `range`, and wait for a second message before you act on the first",
    "inserted-zero": "give every field a `range`, and act on no single message that could do harm",
    "cut-frame": "give the fields that can be such a byte a `range` without it, or repeat the messages that must "
    "arrive",
    "frequent-magic": None,
    "shared-id": "name the `--sender` when you decode a recording of both directions",
}


def suited(protocol: Protocol, findings: list[Finding]) -> list[Finding]:
    """Return the findings with remedies for the owner of the end that can change. What cannot be changed is a
    note."""
    if protocol.fixed is None:
        return findings
    found = []
    for finding in findings:
        if finding.rule == "hold-back":
            if finding.severity != Severity.NOTE:  # a note is about the other end's parser
                remedy = "lower `max_payload` to the largest message that you need"
                found.append(replace(finding, remedy=remedy))
        elif finding.rule in _WITH_A_GIVEN_FORMAT:
            given = _WITH_A_GIVEN_FORMAT[finding.rule]
            if given is not None:
                found.append(replace(finding, remedy=given, severity=Severity.NOTE))
        else:
            found.append(finding)
    return found


def is_fixed(protocol: Protocol, end: End) -> bool:
    return protocol.fixed in (end, End.BOTH)
