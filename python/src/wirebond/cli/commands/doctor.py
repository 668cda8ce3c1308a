"""``wirebond doctor``: checks this machine, for a person or as JSON."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from wirebond.cli.commands.doctor_view import print_findings
from wirebond.cli.output import write
from wirebond.cli.values import to_json
from wirebond.link.devices.doctor.examine import examine
from wirebond.link.devices.doctor.finding import Verdict
from wirebond.link.devices.doctor.machine import Machine


def examine_machine(port: str | None, as_json: bool, root: Path = Path("/")) -> int:
    """Examine the machine. Returns 1 if a check found a problem, otherwise 0."""
    machine = Machine(root)
    findings = examine(machine, port)
    ok = not any(finding.verdict is Verdict.PROBLEM for finding in findings)
    if as_json:
        write(to_json({"ok": ok, "findings": [asdict(finding) for finding in findings]}) + "\n")
    else:
        print_findings(findings, {known.path: known.description for known in machine.ports})
    return 0 if ok else 1
