"""Programs of soaks are compiled once for all tests of a process."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.shared import QUICK_CXXFLAGS


@pytest.fixture(scope="session")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def _compiled_once(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And quickly: it runs three times as long, which is not a time."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    monkeypatch.setenv("CXXFLAGS", QUICK_CXXFLAGS)
