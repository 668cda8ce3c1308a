"""``wirebond check``: the file's problems or the lint's report, for a person or as JSON."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from wirebond.analysis.check import Places, Severity, lint
from wirebond.cli.commands.check_view import print_report
from wirebond.cli.commands.layout_view import layout_json, print_layouts
from wirebond.cli.given_file import load_given
from wirebond.cli.output import write
from wirebond.cli.values import to_json
from wirebond.errors import ProtocolFileError


def check_file(path: Path, as_json: bool, traffic: str | None, thorough: bool, strict: bool, layout: bool) -> int:
    """Check a file. Returns 1 if it is wrong or the lint finds an error (with ``strict`` also a warning), otherwise 0.
    With ``layout`` it shows the layout of payloads, and no lint runs."""
    try:
        codec, path = load_given(path)
    except ProtocolFileError as error:
        if as_json:
            rows = [vars(problem) for problem in error.problems]
            write(to_json({"file": error.problems[0].path, "ok": False, "problems": rows}) + "\n")
            return 1
        raise
    model = codec.model
    facts: dict[str, Any] = {"file": str(path), "ok": True, "protocol": model.name, "hash": f"{codec.hash:016x}"}
    if layout:
        if as_json:
            write(to_json(facts | {"layout": {m.name: layout_json(m.layout) for m in model.messages}}) + "\n")
        else:
            print_layouts(path, codec)
        return 0
    report = lint(codec, Places.of_text(model.text), traffic=traffic, thorough=thorough)
    failed = report.number_of(Severity.ERROR) or (strict and report.number_of(Severity.WARNING))
    if as_json:
        facts |= {
            "ok": not failed,
            "messages": {
                m.name: {"id": m.id, "sender": m.sender, "bytes": model.max_wire_bytes(m.max_payload)}
                for m in model.messages
            },
            **report.as_dict(),
        }
        write(to_json(facts) + "\n")
    else:
        print_report(path, codec, report)
    return 1 if failed else 0
