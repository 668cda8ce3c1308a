"""What several tests of a link need."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

from tests.host_link.attached import attached_links
from tests.host_link.drivers import no_engine_ports
from tests.shared import ROOT
from wirebond.gen import generate_python
from wirebond.protocol import load


@pytest.fixture(params=["engine", "python"])
def ports(request: pytest.FixtureRequest) -> Iterator[str]:
    """The test runs with the engine's ports, and where it has none: `pytestmark = pytest.mark.usefixtures("ports")`."""
    with nullcontext() if request.param == "engine" else no_engine_ports():
        yield request.param


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
