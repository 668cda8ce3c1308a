"""What ``wirebond doctor`` does: the checks of this machine, for a person or as JSON."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from wirebond.cli.output import write
from wirebond.cli.values import to_json
from wirebond.ports.doctor.examine import examine
from wirebond.ports.doctor.finding import Verdict
from wirebond.ports.doctor.machine import Machine
from wirebond.ports.doctor.view import print_findings


def examine_machine(port: str | None, as_json: bool, root: Path = Path("/")) -> int:
    """1 if a check found a problem, else 0."""
    machine = Machine(root)
    findings = examine(machine, port)
    ok = not any(finding.verdict is Verdict.PROBLEM for finding in findings)
    if as_json:
        write(to_json({"ok": ok, "findings": [asdict(finding) for finding in findings]}) + "\n")
    else:
        print_findings(findings, {known.path: known.description for known in machine.ports})
    return 0 if ok else 1
