"""Measures how many lines of the code under test a target's inputs run, by replaying them."""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

from tests.fuzz.build import core_coverage, run
from tests.fuzz.campaign import corpora
from tests.fuzz.files import BUILD
from tests.shared import ROOT


def lines_reached(target: str, work: Path) -> tuple[int, int]:
    """Lines that the inputs run, kept ones and those in ``work``, and all lines there are."""
    folders = [*corpora(target), *([work / "corpus"] if (work / "corpus").is_dir() else [])]
    if target != "loader":
        return core_coverage(target, folders)
    with tempfile.TemporaryDirectory(dir=BUILD) as temporary:
        data, report = Path(temporary) / "data", Path(temporary) / "report.json"
        coverage = [sys.executable, "-m", "coverage"]
        source = ROOT / "python" / "src" / "wirebond" / "protocol"
        command = ["run", f"--source={source}", f"--data-file={data}", "-m", "tests.fuzz.replay_loader"]
        run([*coverage, *command, *map(str, folders)])
        run([*coverage, "json", f"--data-file={data}", "-o", str(report)])
        totals = json.loads(report.read_text())["totals"]
    return totals["covered_lines"], totals["num_statements"]


def sentence(target: str, work: Path) -> str:
    reached, of = lines_reached(target, work)
    what = {"loader": "wirebond.protocol", "fields": "core and generated code"}.get(target, "core")
    return f"{target}: coverage: {reached} of {of} lines of {what}"
