"""Leaves tests out that would begin too late: a plugin of pytest for `make check`, which has a minute."""

from __future__ import annotations

import time

import pytest

LEFT_OUT = "left out"  # a property of the reports


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--until", type=float, help="time of time.monotonic() from which on no test begins")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    until = item.config.getoption("--until")
    if until is not None and time.monotonic() > until:
        item.user_properties.append((LEFT_OUT, True))
        pytest.skip("there is no time left for it")
