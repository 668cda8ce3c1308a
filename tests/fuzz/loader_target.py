"""Fuzz target: protocol files as text. What is refused is refused in sentences; what loads, works.

    python -m tests.fuzz.loader_target [libFuzzer's options] FOLDERS…

README.md says what must hold.
"""

from __future__ import annotations

import random
import sys

import atheris

with atheris.instrument_imports(include=["wirebond.protocol", "wirebond.codec"]):
    from tests.fuzz import protocol_file

from tests.fuzz.text_mutation import mutated


def one_input(data: bytes) -> None:
    protocol_file.verify(data.decode("utf-8", errors="replace"))


def mutate(data: bytes, max_size: int, seed: int) -> bytes:
    """Mostly by lines and words of protocol files, at times by bytes."""
    source = random.Random(seed)
    if source.random() < 0.2:
        return bytes(atheris.Mutate(data, max_size))
    return mutated(data.decode("utf-8", errors="replace"), source).encode("utf-8", errors="replace")[:max_size]


def main() -> None:
    # When it merges inputs the fuzzer starts itself again, by a shell, with the first word as the program.
    arguments = [f"{sys.executable} -S -m {__spec__.name}", *sys.argv[1:]]
    atheris.Setup(arguments, one_input, custom_mutator=mutate)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
