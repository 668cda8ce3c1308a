"""``python -m tests.fuzz TARGET [INPUT…] [--seconds N] [--keep]``: fuzz, look at one input again, keep inputs."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tests.fuzz import campaign, coverage
from tests.fuzz.files import BUILD


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("target", choices=campaign.TARGETS)
    parser.add_argument("inputs", nargs="*", type=Path, help="files to run once each, instead of fuzzing")
    parser.add_argument("--seconds", type=int, default=60, help="how long to fuzz (60)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", action="store_true", help="then put what is new into the kept corpus, minimised")
    options = parser.parse_args()
    missing = [path for path in options.inputs if not path.is_file()]
    if missing:
        parser.error(f"there is no file {missing[0]}; findings lie in {BUILD}")
    if options.inputs:
        report = campaign.replay(options.target, options.inputs)
        print(report or f"{options.target}: every invariant holds for {len(options.inputs)} inputs")
        return 1 if report else 0
    work = BUILD / "work" / options.target
    outcome = campaign.fuzz(
        options.target, work, seconds=options.seconds, seed=options.seed, say=lambda line: print(line, flush=True)
    )
    print(outcome.finding or f"{options.target}: no finding in {outcome.runs} runs")
    if options.keep and not outcome.finding:
        before, after = campaign.keep(options.target, work)
        print(f"{options.target}: {before} kept inputs before, {after} now")
    print(coverage.sentence(options.target, work))
    return 1 if outcome.finding else 0


if __name__ == "__main__":
    sys.exit(main())
