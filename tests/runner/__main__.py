"""Runs the tests as `make test` does: first all that do not depend on time, then the timed ones, one at a time.

    python -m tests.runner [--workers N] [--long]

A timed test that fails gets another chance only where the machine stalled for longer than the test tolerates: it is
repeated at most three times. If the machine stalled each time, the test is not judged; that fails the run only with
STRICT=1. Any other test that fails has failed. CONTRIBUTING.md has the reasons.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from tests.runner.kinds import timed_files
from tests.runner.results import Result, of_last_run, read_results, write_results

ROOT = Path(__file__).resolve().parents[2]
FILE = ROOT / "build" / "test-results.json"
MOST_REPEATS = 3
SLOWEST = 10
LONGEST_PROOF = 7200  # seconds
PASSED, FAILED, NO_TESTS = 0, 1, 5  # exit codes of pytest


class EndedEarlyError(Exception):
    """pytest did not come to its end: wrong arguments, Ctrl-C, or a test that hung. It has printed why."""


def compile_once() -> None:
    """Compile the package before hundreds of processes import it, some of which may write no whole file."""
    subprocess.run([sys.executable, "-m", "compileall", "-q", "-j", "0", "python/src"], cwd=ROOT, check=True)


def pytest(*arguments: str, may_be_empty: bool = False) -> list[Result]:
    """Run it and return the results. ``may_be_empty``: there may be no test to run.

    :raises EndedEarlyError:
    """
    FILE.unlink(missing_ok=True)
    command = [sys.executable, "-m", "pytest", "--results", str(FILE), *arguments]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    code = subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode
    if code == NO_TESTS and may_be_empty:
        return []
    if code not in (PASSED, FAILED) or not FILE.exists():
        raise EndedEarlyError(f"pytest ended early, with exit code {code}")
    results = read_results(FILE)
    if code == FAILED and all(result.has_passed for result in results):
        raise EndedEarlyError("pytest failed, and no test did")
    return results


@dataclass
class Verdicts:
    """The verdicts on the timed tests that failed at first."""

    failed: list[str] = field(default_factory=list)
    calm: list[str] = field(default_factory=list)  # they passed when they were repeated
    unjudged: dict[str, float] = field(default_factory=dict)  # the shortest of the stalls, in seconds


def judge(first: Result, repeat: Callable[[str], Result], verdicts: Verdicts) -> None:
    """Judge a timed test that failed. ``repeat`` runs it alone."""
    stalls: list[float] = []
    result = first
    while not result.has_passed:
        if result.stall <= result.tolerance:
            verdicts.failed.append(first.name)
            return
        stalls.append(result.stall)
        if len(stalls) > MOST_REPEATS:
            verdicts.unjudged[first.name] = min(stalls)
            return
        result = repeat(first.name)
    if stalls:
        verdicts.calm.append(first.name)


def repeat_alone(name: str) -> Result:
    print(f"\n{name} failed; it is repeated alone", flush=True)
    results = pytest("-n", "0", name)
    return results[0] if results else Result(name, has_passed=False)


def show(title: str, names: list[str]) -> None:
    if names:
        print(f"\n{title}:", *names, sep="\n  ", flush=True)


def run(workers: int, with_long: bool, is_strict: bool) -> int:
    began = time.monotonic()
    if FILE.exists():
        FILE.replace(of_last_run(FILE))
    compile_once()
    short = "" if with_long else " and not long"
    patience = ("-o", f"faulthandler_timeout={LONGEST_PROOF}") if with_long else ()
    results = pytest("-n", str(workers), "--dist", "worksteal", "-m", f"not timed{short}", *patience)
    print("\nThe timed tests, one at a time:", flush=True)
    timed = pytest("-n", "0", "-m", f"timed{short}", *patience, *map(str, timed_files()))
    verdicts = Verdicts()
    for result in timed:
        judge(result, repeat_alone, verdicts)

    every = [*results, *timed]
    write_results(FILE, every)
    slowest = sorted(every, key=lambda result: result.seconds, reverse=True)[:SLOWEST]
    show("the slowest tests", [f"{result.seconds:6.1f} s  {result.name}" for result in slowest])
    show("passed when repeated, after a stall of the machine", verdicts.calm)
    unjudged = [
        f"{name}: this machine stalls for {stall * 1000:.0f} ms or longer" for name, stall in verdicts.unjudged.items()
    ]
    show("not judged" + (", which STRICT=1 counts as failed" if is_strict else ""), unjudged)
    failed = [result.name for result in results if not result.has_passed] + verdicts.failed
    show("failed", failed)
    skipped = sum(result.is_skipped for result in every)
    counts = {
        "passed": len(every) - skipped - len(failed) - len(unjudged),
        "failed": len(failed),
        "skipped": skipped,
        "repeated": len(verdicts.calm),
        "not judged": len(unjudged),
    }
    told = ", ".join(f"{count} {what}" for what, count in counts.items() if count or what in ("passed", "failed"))
    print(f"\n{told} in {time.monotonic() - began:.0f} s", flush=True)
    return FAILED if failed or (is_strict and unjudged) else PASSED


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, default=2, help="processes for the tests that do not depend on time")
    parser.add_argument("--long", action="store_true", help="also the long proofs")
    chosen = parser.parse_args()
    try:
        return run(chosen.workers, chosen.long, os.environ.get("STRICT") == "1")
    except EndedEarlyError as error:
        print(f"\n{error}; what it printed last says why", flush=True)
        return FAILED


if __name__ == "__main__":
    sys.exit(main())
