"""Shared by the tests of generated code: protocols, generated folders, compilers."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from wirebond.generate.code import generate_cpp
from wirebond.protocol.loader import load
from wirebond.protocol.model import Protocol

HERE = Path(__file__).parent
ROOT = HERE.parents[2]
FILES = [*sorted((ROOT / "protocols").glob("*.yaml")), HERE / "every_type.yaml", HERE / "every_shape.yaml"]
STRICT = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-Wshadow", "-Wpedantic"]


@pytest.fixture(scope="session")
def protocols() -> list[Protocol]:
    return [load(path) for path in FILES]


@pytest.fixture(scope="session")
def generated(protocols: list[Protocol], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One folder with the headers of all protocols."""
    folder = tmp_path_factory.mktemp("generated")
    for protocol in protocols:
        generate_cpp(protocol, folder)
    return folder


@pytest.fixture(scope="session")
def strict() -> list[str]:
    return STRICT


def run(command: list[str]) -> str:
    """Return the output of a program. The test fails if the program fails or is missing."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{' '.join(command)}\n{done.stdout}{done.stderr}"
    return done.stdout


@pytest.fixture(scope="session")
def shell() -> object:
    return run
