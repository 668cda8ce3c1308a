"""Shows the findings of ``wirebond doctor`` to a person: by port, worst first, each command on its own line."""

from __future__ import annotations

import textwrap

from wirebond.cli.output import console, plain
from wirebond.link.devices.doctor.finding import Finding, Verdict

_STYLE = {
    Verdict.PROBLEM: "bold red",
    Verdict.WARNING: "bold yellow",
    Verdict.CANNOT_TELL: "bold cyan",
    Verdict.OK: "green",
}
_WORST_FIRST = list(Verdict)
_WIDTH = 80
_VERDICT, _CHECK = 11, 13  # widths of the columns, for the longest word of each


def print_findings(findings: list[Finding], descriptions: dict[str, str]) -> None:
    """Print the findings. `descriptions`: of the existing ports, by path."""
    for port in dict.fromkeys(finding.port for finding in findings):
        described = f"  {descriptions[port]}" if port in descriptions else ""
        title = "this machine" if port is None else f"{port}{described}"
        console.print(f"[bold]{plain(title)}[/]", soft_wrap=True)
        mine = [finding for finding in findings if finding.port == port]
        for finding in sorted(mine, key=lambda finding: _WORST_FIRST.index(finding.verdict)):
            _print(finding)
    console.print(_sum(findings), soft_wrap=True)


def _print(finding: Finding) -> None:
    indent = " " * (_VERDICT + _CHECK + 6)
    lines = textwrap.wrap(finding.sentence, _WIDTH - len(indent), break_long_words=False, break_on_hyphens=False)
    verdict = f"[{_STYLE[finding.verdict]}]{finding.verdict:<{_VERDICT}}[/]"
    console.print(f"  {verdict}  {finding.check:<{_CHECK}}  {plain(lines[0])}", soft_wrap=True)
    for line in lines[1:]:
        console.print(f"{indent}{plain(line)}", soft_wrap=True)
    for command in finding.cure:
        console.print(f"    [cyan]$ {plain(command)}[/]", soft_wrap=True)  # never broken: it is there to be copied
    if finding.then is not None:
        for line in textwrap.wrap(finding.then, _WIDTH - 4, break_on_hyphens=False):
            console.print(f"    {plain(line)}", soft_wrap=True)


def _sum(findings: list[Finding]) -> str:
    counts = {verdict: sum(finding.verdict is verdict for finding in findings) for verdict in Verdict}
    problems, warnings = counts[Verdict.PROBLEM], counts[Verdict.WARNING]
    if not problems and not warnings:
        return "nothing is in the way" if not counts[Verdict.CANNOT_TELL] else "nothing was found to be in the way"
    words = [f"{problems} problem{'s' * (problems != 1)}", f"{warnings} warning{'s' * (warnings != 1)}"]
    return ", ".join(words)
