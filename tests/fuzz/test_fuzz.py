"""The fuzz targets: every kept input, a short run of a fixed length, planted faults; the hour in `make prove`."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.fuzz import campaign, coverage
from tests.fuzz.build import CORE
from tests.fuzz.files import BUILD, CORPUS
from tests.shared import ROOT

pytestmark = pytest.mark.live

RUNS = {"deframer": 2500, "fields": 60_000, "loader": 250}  # about six seconds each, and half of it in a short run
LONG_SECONDS = int(os.environ.get("WIREBOND_FUZZ_SECONDS", "3600")) // len(campaign.TARGETS)

# A text of a source file, what stands there instead, and the target that must find out.
FAULTS = [
    pytest.param(
        *(
            "deframer",
            "deframer.hpp",
            "at += failed;\n      }\n      if constexpr",
            "at += failed + 1;\n      }\n      if constexpr",
        ),
        id="a byte that is skipped behind a false start",
    ),
    pytest.param(
        *("deframer", "deframer.hpp", "needed_ = 0;  // they will not come", "// they will not come"),
        marks=pytest.mark.long,
        id="a frame that is completed from memory",
    ),
    pytest.param(
        *("fields", "bits.hpp", "value >> (rest - taken)", "value >> rest"),
        marks=pytest.mark.long,
        id="bits that are stored beside their place",
    ),
    pytest.param(
        *(
            "loader",
            "protocol/meaning/draft.py",
            "if message is None:\n            continue\n        limit_of, limit = _limit(",
            "if False:\n            continue\n        limit_of, limit = _limit(",
        ),
        id="a message that is not there is asked for its size",
    ),
]


@pytest.mark.parametrize("target", campaign.TARGETS)
def test_every_kept_input_holds(target: str) -> None:
    report = campaign.replay(target, [CORPUS / target])
    assert report == ""


def test_a_fuzzer_does_not_count_the_memory_of_the_process_that_starts_it() -> None:
    large = b"x" * 300_000_000
    peak = [sys.executable, "-c", "import resource; print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"]
    found = subprocess.run([*campaign.APART, *peak], capture_output=True, text=True, check=True)
    assert int(found.stdout) * 1024 < len(large)


@pytest.mark.long
@pytest.mark.parametrize("target", campaign.TARGETS)
def test_a_short_run_finds_nothing(target: str, tmp_path: Path) -> None:
    outcome = campaign.fuzz(target, tmp_path, runs=RUNS[target] // 2)
    assert outcome.finding == "", outcome.finding
    assert outcome.runs >= RUNS[target] // 2
    print(f"{target}: {outcome.edges} edges reached in {outcome.runs} runs")


@pytest.mark.long
@pytest.mark.parametrize(("target", "file", "good", "bad"), FAULTS)
def test_a_planted_fault_is_found(target: str, file: str, good: str, bad: str, tmp_path: Path) -> None:
    is_package = target == "loader"
    source = ROOT / "python" / "src" / "wirebond" if is_package else CORE
    planted = tmp_path / "planted"
    shutil.copytree(source, planted)
    path = planted / file if is_package else planted / "wirebond" / file
    text = path.read_text(encoding="utf-8")
    assert text.count(good) == 1, "the text that is spoilt stands in the file once"
    path.write_text(text.replace(good, bad), encoding="utf-8")
    program = campaign.command_for(target, **({"package": planted} if is_package else {"core": planted}))
    outcome = campaign.fuzz(target, tmp_path, runs=RUNS[target], program=program)
    assert "see it again with: " in outcome.finding
    findings = list((tmp_path / "findings").iterdir())
    assert len(findings) == 1
    assert str(findings[0]) in outcome.finding


@pytest.mark.long
@pytest.mark.parametrize("target", campaign.TARGETS)
def test_an_hour_finds_nothing(target: str, capsys: pytest.CaptureFixture[str]) -> None:
    """`WIREBOND_FUZZ_SECONDS` is the time of all targets together."""
    work = BUILD / "work" / target

    def say(line: str) -> None:
        with capsys.disabled():
            print(line, flush=True)

    outcome = campaign.fuzz(target, work, seconds=LONG_SECONDS, say=say)
    assert outcome.finding == "", outcome.finding
    of = f" of {outcome.of_edges}" if outcome.of_edges else ""  # how many there are in Python nobody counts
    say(f"{target}: no finding in {outcome.runs} runs, {outcome.edges}{of} edges")
    say(coverage.sentence(target, work))
