"""Runs a target: over its kept inputs, for a number of runs or a time, and keeps what it found."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests.fuzz.build import CORE, build_target
from tests.fuzz.files import BUILD, CORPUS, seed_files
from tests.shared import ROOT
from wirebond import _engine

TARGETS = ("deframer", "fields", "loader")
LONGEST_INPUT = {"deframer": 2048, "fields": 512, "loader": 8192}  # bytes
# libFuzzer limits the peak of its memory (ru_maxrss). A new process begins with the peak of the process that started
# it, which may be a test worker that once had gigabytes; so a shell starts it.
APART = ("sh", "-c", '"$@"; exit $?', "sh")
_LIMITS = ("-timeout=120", "-rss_limit_mb=2048")  # a hang or a leak is a finding, a slow machine is none
_TAIL = 60  # lines of a finding's report


@dataclass(frozen=True)
class Outcome:
    """``edges`` and ``of_edges``: of the target's code; 0 where the fuzzer does not say. ``finding``: a sentence with
    the command that reproduces it, and the report; empty if there is none."""

    runs: int
    edges: int
    of_edges: int
    finding: str = ""


def command_for(target: str, *, core: Path = CORE, package: Path | None = None) -> tuple[list[str], dict[str, str]]:
    """The program and its environment. ``core``, ``package``: other headers or another package than the project's."""
    if target != "loader":
        return [str(build_target(target, core=core))], {}
    site = _site(package or ROOT / "python" / "src" / "wirebond")
    path = os.pathsep.join([str(site), sysconfig.get_paths()["purelib"], str(ROOT)])
    # -S: the development install loads its modules in a way of its own, which cannot be instrumented.
    return [sys.executable, "-S", "-m", "tests.fuzz.loader_target"], {"PYTHONPATH": path, "PYTHONHASHSEED": "0"}


def corpora(target: str) -> list[Path]:
    """Folders with inputs to begin from: those that are kept, and the project's protocol files."""
    folders = [CORPUS / target]
    if target == "loader":
        seeds = BUILD / "protocol_files"
        seeds.mkdir(parents=True, exist_ok=True)
        for path in seed_files():
            shutil.copy(path, seeds / f"{path.parent.name}_{path.name}")
        folders.append(seeds)
    return folders


def fuzz(
    target: str,
    work: Path,
    *,
    runs: int = -1,
    seconds: int = 0,
    seed: int = 1,
    program: tuple[list[str], dict[str, str]] | None = None,
    say: Callable[[str], None] = lambda line: None,
) -> Outcome:
    """Run ``target`` for this many runs or seconds; new inputs go to ``work``/corpus, findings to ``work``/findings."""
    command, environment = program or command_for(target)
    found, findings = work / "corpus", work / "findings"
    found.mkdir(parents=True, exist_ok=True)
    findings.mkdir(parents=True, exist_ok=True)
    before = set(findings.iterdir())
    options = [f"-runs={runs}", f"-max_total_time={seconds}", f"-seed={seed}", f"-max_len={LONGEST_INPUT[target]}"]
    options += [*_LIMITS, "-print_final_stats=1", f"-artifact_prefix={findings}/"]
    process = subprocess.Popen(
        [*APART, *command, *options, str(found), *map(str, corpora(target))],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        env=os.environ | environment,
        cwd=ROOT,
    )
    assert process.stdout is not None
    lines = []
    for line in process.stdout:
        lines.append(line.rstrip())
        if "pulse" in line or "INITED" in line:
            say(f"{target}: {line.strip()}")
    code = process.wait()
    text = "\n".join(lines)
    outcome = Outcome(_number(r"number_of_executed_units: (\d+)", text), _number(r"cov: (\d+)", text), _edges(text))
    if code == 0:
        return outcome
    new = sorted(set(findings.iterdir()) - before)
    again = f"{Path(sys.executable)} -m tests.fuzz {target} {new[0]}" if new else " ".join([*command, *options])
    report = "\n".join(_report(lines))
    sentence = f"{target}: an invariant is broken or the program failed; see it again with: {again}\n{report}"
    return Outcome(outcome.runs, outcome.edges, outcome.of_edges, sentence)


def replay(target: str, inputs: list[Path]) -> str:
    """Run these files, and all in these folders. An empty text, or the report of the first that fails."""
    files = [str(path) for one in inputs for path in (sorted(one.iterdir()) if one.is_dir() else [one])]
    assert files, "without a file a fuzzer would begin to fuzz"
    command, environment = command_for(target)
    done = subprocess.run(
        [*APART, *command, *_LIMITS, *files], capture_output=True, text=True, errors="replace", check=False, cwd=ROOT,
        env=os.environ | environment,
    )  # fmt: skip
    return "" if done.returncode == 0 else "\n".join(_report((done.stdout + done.stderr).splitlines()))


def keep(target: str, work: Path) -> tuple[int, int]:
    """Put the smallest set of inputs that reaches what all reach into the kept corpus; its size before and after.

    What begins with ``finding-`` stays.
    """
    command, environment = command_for(target)
    kept = CORPUS / target
    before = len(list(kept.iterdir()))
    fresh = work / "kept"
    shutil.rmtree(fresh, ignore_errors=True)
    fresh.mkdir(parents=True)
    options = ["-set_cover_merge=1", "-use_counters=0", f"-max_len={LONGEST_INPUT[target]}", *_LIMITS]
    done = subprocess.run(
        [*APART, *command, *options, str(fresh), str(kept), str(work / "corpus")], capture_output=True, text=True,
        errors="replace", check=False, cwd=ROOT, env=os.environ | environment,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    for path in kept.iterdir():
        if not path.name.startswith("finding-"):
            path.unlink()
    shutil.copytree(fresh, kept, dirs_exist_ok=True)
    return before, len(list(kept.iterdir()))


def _site(package: Path) -> Path:
    """A folder with the package as it is on disk and the compiled engine in it, made once for each content."""
    engine = Path(str(_engine.__file__))
    files = sorted(path for path in package.rglob("*") if path.is_file() and path.suffix != ".pyc")
    content = hashlib.sha256(engine.read_bytes())
    for path in files:
        content.update(str(path.relative_to(package)).encode() + b"\0" + path.read_bytes())
    site = BUILD / f"site_{content.hexdigest()[:16]}"
    if not site.exists():
        BUILD.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=BUILD) as folder:
            made = Path(folder) / "site"
            shutil.copytree(package, made / "wirebond", ignore=shutil.ignore_patterns("__pycache__"))
            shutil.copy(engine, made / "wirebond")
            with contextlib.suppress(OSError):  # another process was first
                made.rename(site)
    return site


def _number(pattern: str, text: str) -> int:
    found = re.findall(pattern, text)
    return int(found[-1]) if found else 0


def _edges(text: str) -> int:
    return _number(r"Loaded 1 modules\s+\((\d+) inline", text)


def _report(lines: list[str]) -> list[str]:
    """From the first line that tells what is wrong; a fuzzer prints its progress before."""
    telling = ("broken invariant", "Uncaught Python exception", "ERROR: ", "runtime error")
    first = next((i for i, line in enumerate(lines) if any(word in line for word in telling)), max(0, len(lines) - 20))
    return [line[:400] for line in lines[first : first + _TAIL]]
