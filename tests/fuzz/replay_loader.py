"""Run the loader's invariants over files, without a fuzzer: ``python -m tests.fuzz.replay_loader FOLDER…``."""

from __future__ import annotations

import sys
from pathlib import Path

from tests.fuzz import protocol_file


def main() -> None:
    for folder in sys.argv[1:]:
        for path in sorted(Path(folder).iterdir()):
            protocol_file.verify(path.read_bytes().decode("utf-8", errors="replace"))


if __name__ == "__main__":
    main()
