"""The port ``sim:``: a virtual MCU of the protocol behind the link, as long as the link lives."""

from __future__ import annotations

import gc
import json
import sys
import threading
from typing import Any

import pytest

import wirebond
from tests.shared import PROTOCOLS
from tests.waiting import PATIENCE, wait_until
from wirebond.cli.main import main
from wirebond.errors import UsageError
from wirebond.sim.pty_port import run

pytestmark = pytest.mark.live

FILE = PROTOCOLS / "diffdrive.yaml"


def simulations() -> int:
    return sum(thread.name == "wirebond-sim" for thread in threading.enumerate())


def test_a_virtual_mcu_answers_and_sends_until_the_link_is_closed() -> None:
    before = simulations()
    with wirebond.open(FILE, "sim:") as link:
        assert link.port == "sim:"
        assert simulations() == before + 1
        assert link.request("status_query", timeout=PATIENCE).name == "status"
        assert link.receive(PATIENCE)
        link.send("velocity", linear=0.5, angular=0)
    assert simulations() == before


def test_a_link_that_is_forgotten_takes_its_virtual_mcu_along() -> None:
    before = simulations()
    link = wirebond.open(FILE, "sim:")
    assert link.state != "down"
    del link
    wait_until(lambda: gc.collect() is not None and simulations() == before, "the virtual MCU ends")


def test_a_link_that_the_thread_of_its_virtual_mcu_collects_ends_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    collects = threading.Event()
    failures: list[object] = []

    def run_and_collect(*arguments: Any) -> None:
        run(*arguments)
        if collects.is_set():
            gc.collect()

    monkeypatch.setattr("wirebond.sim.port.run", run_and_collect)
    monkeypatch.setattr(sys, "unraisablehook", failures.append)
    before = simulations()
    link = wirebond.open(FILE, "sim:")
    link.me = link  # type: ignore[attr-defined]
    gc.disable()
    try:
        del link
        collects.set()
        wait_until(lambda: simulations() == before, "the virtual MCU ends")
    finally:
        gc.enable()
    assert not failures


def test_a_virtual_mcu_is_no_host() -> None:
    before = simulations()
    with pytest.raises(UsageError, match="sim: is a virtual MCU, and role 'mcu' is one as well"):
        wirebond.open(FILE, "sim:", role="mcu")
    assert simulations() == before


def test_a_name_after_the_colon_is_refused_with_what_to_write() -> None:
    with pytest.raises(UsageError, match="there is no simulator sim:robot; write sim: alone"):
        wirebond.open(FILE, "sim:robot")


def test_commands_take_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["send", str(FILE), "sim:", "status_query"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[0])["message"] == "status"
