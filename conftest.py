"""For all tests: correctness depends neither on how fast the machine is nor on how the run was started."""

import atexit
import os
import shutil
import signal
import tempfile
from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, settings
from tests.waiting import PATIENCE

import wirebond.link.settings as settings_of_links
from wirebond.link.aio import Aio
from wirebond.link.parameters import Parameters
from wirebond.link.receiving import Receiving
from wirebond.protocol.problems import Place, Problems

pytest_plugins = ["tests.runner.kinds", "tests.runner.limit", "tests.runner.results"]

settings.register_profile("any_speed", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any_speed")

# A shell ignores Ctrl-C for what it starts in the background, and children would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Servers keep their sockets and unreleased emergency stops in this folder. Each run has its own, so that a run that was
# killed cannot affect the next one.
os.environ["XDG_RUNTIME_DIR"] = tempfile.mkdtemp(prefix="wirebond_")
atexit.register(shutil.rmtree, os.environ["XDG_RUNTIME_DIR"], ignore_errors=True)

# Who asks a robot without saying how long it may take waits a second: for a busy machine that is nothing.
ASKING = (
    Receiving.request,
    Aio.request,
    *(getattr(Parameters, name) for name in ("list", "get", "set", "set_all", "save", "load")),
)
for method in ASKING:
    assert method.__kwdefaults__["timeout"] == 1.0
    method.__kwdefaults__["timeout"] = PATIENCE


@pytest.fixture(autouse=True)
def every_problem_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    """Verify that the sentence of a refused protocol file says what is wrong, and after a semicolon what to write."""
    add = Problems.add

    def checked(self: Problems, place: Place, sentence: str) -> None:
        assert "; " in sentence, sentence
        add(self, place, sentence)

    monkeypatch.setattr(Problems, "add", checked)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown() -> Iterator[None]:
    """Verify that a test that drives links from Python has restored the engine's."""
    yield
    assert settings_of_links.HAS_ENGINE_PORTS
