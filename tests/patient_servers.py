"""Servers, attached links and pages of a test take nothing for too late: a pause of the machine changes nothing.

A conftest that imports both fixtures has such servers for all tests of its folder.
"""

from __future__ import annotations

import pytest

from tests.waiting import PATIENCE
from wirebond.link.attached.attached_link import AttachedLink
from wirebond.server import control

_FOREVER = 3600.0  # seconds


def be_patient(patch: pytest.MonkeyPatch) -> None:
    """For those of this process."""
    for place in ("server.control.OLDEST_COMMAND", "server.control.SILENCE", "link.attached.words.OLDEST_COMMAND"):
        patch.setattr(f"wirebond.{place}", _FOREVER)
    patch.setattr("wirebond.server.control._TICKS_KEPT", 1_000_000)
    for module in ("attaching", "attached_link"):
        patch.setattr(f"wirebond.link.attached.{module}.PATIENCE", PATIENCE)
    patch.setattr(AttachedLink._exchange, "__defaults__", (0, PATIENCE))


def are_patient() -> bool:
    """Return whether the servers of this process are patient."""
    return control.SILENCE == _FOREVER


@pytest.fixture
def real_ages() -> None:
    """For tests of what is late or silent: the times of the product."""


@pytest.fixture(autouse=True)
def ages(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if "real_ages" not in request.fixturenames:
        be_patient(monkeypatch)
