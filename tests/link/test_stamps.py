"""The MCU's time stamps through a link, an attached link, a recording, typed modules and the command line."""

from __future__ import annotations

import csv
import importlib.util
import json
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wirebond
from tests.shared import PROTOCOLS, codec
from tests.waiting import wait_until
from wirebond.cli.main import main
from wirebond.generate.code.python import generate_python
from wirebond.server import Server
from wirebond.sim.pty_port import PtyPort
from wirebond.sim.pty_port import run as serve
from wirebond.sim.virtual_mcu import VirtualMcu

pytestmark = pytest.mark.live

AXIS = PROTOCOLS / "linear_axis.yaml"
DRIFT = 400.0  # parts per million


class Mcu:
    """A virtual MCU on a pty, whose clock drifts."""

    def __init__(self) -> None:
        self._pty, self._over = PtyPort(), threading.Event()
        self._mcu = VirtualMcu(codec("linear_axis"), time.monotonic(), clock_drift=DRIFT)
        self.port = self._pty.path
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._over.is_set():
            serve(self._mcu, self._pty, time.monotonic() + 0.05, lambda _: None)

    def true(self, measured: int) -> float:
        """The host's time of a time of its clock."""
        return self._mcu.start + measured / (1e6 + DRIFT)

    def close(self) -> None:
        self._over.set()
        self._thread.join()
        self._pty.close()


@pytest.fixture(scope="module")
def mcu() -> Iterator[Mcu]:
    found = Mcu()
    yield found
    found.close()


def states(link: wirebond.Link, number: int, since: float = 0.0) -> list[wirebond.Message]:
    """At least `number` messages with a stamp that came after `since`, one of them known to 0.1 s.

    On a busy machine an exchange of clock readings can take long, and the stamps are then known less well.
    """
    found: list[wirebond.Message] = []

    def look() -> bool:
        new = [m for m in link.receive(0.05) if m.name == "state" and m.t > since]
        found.extend(m for m in new if m.stamp is not None)
        return len(found) >= number and any((m.stamp_error or 1) < 0.1 for m in found)

    wait_until(look, "states with stamps")
    return found


def untrue(mcu: Mcu, found: list[wirebond.Message]) -> list[tuple[float, float | None]]:
    """Return the stamps whose error exceeds their own bound, with error and bound."""
    off = [(abs((m.stamp or 0) - mcu.true(m["measured"])), m.stamp_error) for m in found]
    return [(by, error) for by, error in off if not 0 <= by <= (error or 0)]


def test_messages_of_a_link_have_their_time_of_measurement(mcu: Mcu) -> None:
    with wirebond.open(AXIS, mcu.port, clock_sync=False) as link:
        wait_until(lambda: link.latest("state") is not None, "a message")
        assert (newest := link.latest("state")) is not None
        assert newest.message.stamp is None  # nobody asks for the MCU's clock
    with wirebond.open(AXIS, mcu.port) as link:
        found = states(link, 20)
        assert untrue(mcu, found) == []
        assert [m.stamp for m in found] == sorted(m.stamp for m in found if m.stamp is not None)
        assert all(m.stamp is None for m in link.receive(0.05) if m.name != "state")


def test_an_attached_link_gives_the_same(mcu: Mcu, tmp_path: Path) -> None:
    path = tmp_path / "axis.sock"
    with wirebond.open(AXIS, mcu.port) as link, Server(link, path):
        wait_until(lambda: link.clock is not None, "the clock")
        with wirebond.open(f"wirebond://{path}") as attached:
            assert untrue(mcu, states(attached, 10)) == []


def test_a_recording_has_them_in_messages_columns_and_exports(mcu: Mcu, tmp_path: Path) -> None:
    file = tmp_path / "run.mcap"
    with wirebond.open(AXIS, mcu.port) as link, link.record(file):
        before = 0 if link.clock is None else link.clock.exchanges  # of these the recording may know nothing
        wait_until(lambda: link.clock is not None and link.clock.exchanges >= before + 6, "six exchanges")
        # The link also stamps what came before the first of them; the recording knows the clock from then on.
        states(link, 10, since=time.monotonic())
    recording = wirebond.recording.open(file)
    table = recording.columns()["state"]
    assert table.t is not None and table.stamp is not None and table.stamp_error is not None
    known = np.isfinite(table.stamp)
    assert known.sum() >= 10
    messages = [m for m in recording.messages("mcu") if m.name == "state"]
    same = [(np.nan if m.stamp is None else m.stamp, m.stamp_error or np.nan) for m in messages]
    np.testing.assert_allclose(np.column_stack([table.stamp, table.stamp_error]), same, rtol=0, atol=1e-9)
    offsets = table.stamp[known] - np.asarray(table["measured"])[known] / (1e6 + DRIFT)  # all of one start
    assert np.ptp(offsets) <= 2 * table.stamp_error[known].max()
    assert recording.columns()["clock_reply"].stamp is None
    assert main(["export", str(file), "--to", "csv", "--out", str(tmp_path)]) == 0
    with (tmp_path / "state.csv").open() as lines:
        rows = list(csv.DictReader(lines))
    assert [row["stamp.t"] != "" for row in rows] == known.tolist()
    assert float(rows[-1]["stamp.t"]) == pytest.approx(table.stamp[-1], abs=1e-6)


def recorded_stamps(file: Path, near: float) -> list[float]:
    """Return how long before its arrival each message with a stamp was measured."""
    states = (m for m in wirebond.recording.open(file).messages("mcu") if m.name == "state" and m.t >= near)
    return [m.t - m.stamp for m in states if m.stamp is not None]


def test_a_replay_has_those_of_the_recording(mcu: Mcu, tmp_path: Path) -> None:
    file = tmp_path / "run.mcap"
    with wirebond.open(AXIS, mcu.port) as link, link.record(file):
        states(link, 70)  # those before the recording's first clock exchange have no stamp in it
    with wirebond.open(AXIS, f"replay:{file}?speed=max") as link:
        replayed = [m.t - m.stamp for m in link if m.name == "state" and m.stamp is not None]
        with pytest.raises(wirebond.UsageError, match="has no MCU to ask"):
            link.host_time(0)
    expected = recorded_stamps(file, 0.0)
    assert len(expected) >= 60
    assert replayed == pytest.approx(expected, abs=2e-6)
    second_half = wirebond.recording.open(file).duration / 2
    expected = recorded_stamps(file, second_half)
    with wirebond.open(AXIS, f"replay:{file}?speed=max&from={second_half}&loop=1") as link:
        looped = states(link, 2 * len(expected) + 1)
    for place, message in enumerate(looped):
        assert message.stamp is not None
        assert message.t - message.stamp == pytest.approx(expected[place % len(expected)], abs=2e-6)


def test_the_command_line_and_typed_messages_have_them(
    mcu: Mcu, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stamped: list[dict[str, Any]] = []

    def watch() -> bool:
        assert main(["monitor", str(AXIS), mcu.port, "--json", "--seconds", "0.4"]) == 0
        stamped.extend(m for m in map(json.loads, capsys.readouterr().out.splitlines()) if "stamp" in m)
        return bool(stamped)

    wait_until(watch, "messages with stamps")
    assert all(abs(m["stamp"] - mcu.true(m["fields"]["measured"])) <= m["stamp_error"] + 1e-6 for m in stamped)
    (path,) = generate_python(codec("linear_axis").model, tmp_path)
    spec = importlib.util.spec_from_file_location("stamped_axis", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["stamped_axis"] = module
    spec.loader.exec_module(module)
    with wirebond.open(AXIS, mcu.port) as link:
        message = states(link, 1)[0]
        typed = module.from_message(message)
    assert (typed.stamp, typed.stamp_error) == (message.stamp, message.stamp_error)
    assert module.from_message(codec("linear_axis").decoder("mcu").feed(typed.encode())[0]).stamp is None
