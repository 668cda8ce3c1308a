"""The folders of the fuzzers' inputs and results."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from tests.shared import PROTOCOLS, ROOT

HERE = Path(__file__).parent
CORPUS = HERE / "corpus"
BUILD = ROOT / "build" / "fuzz"
SHAPES = ROOT / "tests" / "generate" / "code"


@cache
def seed_files() -> list[Path]:
    """The protocol files of the project, from which the loader's inputs begin."""
    folders = (PROTOCOLS, PROTOCOLS / "contrib", ROOT / "tests" / "formats", SHAPES)
    return [path for folder in folders for path in sorted(folder.glob("*.yaml"))]
