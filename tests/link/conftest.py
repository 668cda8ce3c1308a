"""Fixtures that several tests of a link share."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

from tests.link.attached import attached_links
from tests.patient_servers import ages, real_ages  # noqa: F401 - fixtures of this folder
from tests.shared import ROOT
from wirebond.generate.code import generate_python
from wirebond.link import settings
from wirebond.protocol import load


@pytest.fixture(params=["engine", "python"])
def ports(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """The test runs with the engine's ports, and where it has none: `pytestmark = pytest.mark.usefixtures("ports")`.

    By `monkeypatch`, so that all changes of the setting are undone in the reverse order: a test may change it, too.
    """
    if request.param == "python":
        monkeypatch.setattr(settings, "HAS_ENGINE_PORTS", False)
    return str(request.param)


@pytest.fixture(params=["owned", "attached"])
def links(request: pytest.FixtureRequest) -> Iterator[str]:
    """The test runs with links of its own, and with links that are attached to a server:
    `pytestmark = pytest.mark.usefixtures("links")`."""
    with nullcontext() if request.param == "owned" else attached_links():
        yield request.param


@pytest.fixture
def diffdrive(tmp_path: Path) -> Iterator[Any]:
    """The generated module of diffdrive."""
    (path,) = generate_python(load(ROOT / "protocols" / "diffdrive.yaml"), tmp_path)
    spec = importlib.util.spec_from_file_location("generated_diffdrive", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]
