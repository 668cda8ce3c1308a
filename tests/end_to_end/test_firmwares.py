"""The firmwares as processes on ptys, as a user runs them on a desk, against the host's engine.

The rover has its own file. The time of these passes as their line moves, so that no machine is too slow for them; no
bound here depends on a fast one.
"""

from __future__ import annotations

import math
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

import wirebond
from tests.compilers import CXX
from tests.shared import PROTOCOLS, ROOT, codec
from tests.waiting import moments, wait_until
from wirebond.generate.code import generate_cpp
from wirebond.sim.process import FirmwareProcess

pytestmark = pytest.mark.live

FIRMWARE = ROOT / "firmware"
FLAGS = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-Wshadow", "-Wconversion", "-O0", "-pthread"]

Running = tuple[FirmwareProcess, wirebond.Link]


@pytest.fixture
def start(tmp_path: Path) -> Callable[[str, str], Any]:
    """Compiles a firmware for this machine, runs it, and opens its tty."""

    @contextmanager
    def started(name: str, protocol: str) -> Iterator[Running]:
        generate_cpp(wirebond.load(PROTOCOLS / f"{protocol}.yaml").model, tmp_path)
        folders = [tmp_path, FIRMWARE, FIRMWARE / name, ROOT / "ports" / "posix" / "include"]
        source, program = FIRMWARE / name / "host" / "main.cpp", tmp_path / name
        command = [CXX, *FLAGS, *(f"-I{folder}" for folder in folders), str(source), "-o", str(program)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        with FirmwareProcess(program, name) as process, wirebond.open(codec(protocol), process.port) as link:
            yield process, link

    return started


def messages(link: wirebond.Link) -> Iterator[wirebond.Message]:
    """Yield the received messages, without a time limit."""
    for _ in moments("the message that the test waits for"):
        yield from link.receive(0.1)


def answer(link: wirebond.Link, name: str) -> dict[str, Any]:
    """The fields of the next message of this name."""
    return next(m.fields for m in messages(link) if m.name == name)


def wait_for_event(process: FirmwareProcess, name: str) -> None:
    wait_until(
        lambda: any(line.partition(" ")[2] == name for line in process.events(timeout=0.2)),
        f"the event {name} of the firmware",
    )


def test_echo_sends_back_what_came(start: Callable[[str, str], Any]) -> None:
    with start("echo", "enterprize") as (_, link):
        for n in range(50):
            command = {"x_vel": float(n), "y_vel": 0.5 * n, "w_vel": -1.0 * n}
            link.send("chassis_cmd", command)
            assert answer(link, "chassis_msg") == command


def tune(link: wirebond.Link, idx: int, p: float, i: float, d: float) -> None:
    link.send("pid", idx=idx, p=p, i=i, d=d)
    assert answer(link, "acknowledge") == {"of": 1, "result": "accepted"}


def wait_until_it_stands(link: wirebond.Link) -> None:
    still = 0
    for message in messages(link):
        if message.name == "attitude":
            still = still + 1 if abs(message.fields["pitch"]) < 0.01 else 0
            if still == 50:  # a second of the bot's
                return


def test_balance_bot_stands_once_it_is_tuned_and_its_motors_stop_when_gains_change(
    start: Callable[[str, str], Any],
) -> None:
    with start("balance", "pid_tuner") as (process, link):
        assert answer(link, "motors") == {"left": 0.0, "right": 0.0}
        assert process.events() == []
        tune(link, 0, 10.0, 0.1, 0.3)
        wait_for_event(process, "motors run")
        tune(link, 1, 0.2, 9.0, 9.0)
        link.send("read_gains", idx=1)
        gains = answer(link, "gains")
        assert (gains["p"], gains["i"], gains["d"]) == pytest.approx((0.2, 0.2 / 200, 0.0))
        wait_until_it_stands(link)

        for idx in (0, 1):  # it stands, so only a change of gains stops its motors
            process.tell("push")
            next(m for m in messages(link) if m.name == "attitude" and abs(m.fields["pitch"]) > 0.02)
            process.events()
            tune(link, idx, *((12.0, 0.1, 0.4) if idx == 0 else (0.18, 0.0, 0.0)))
            wait_for_event(process, "motors rest")
            wait_until_it_stands(link)


def test_four_threads_of_the_gimbal_send_at_their_rhythm_and_nothing_is_lost(start: Callable[[str, str], Any]) -> None:
    aim = {"main_target_yaw": 0.5, "main_target_pitch": -0.25, "l_target_yaw": 0.1, "l_target_pitch": 0.2}
    with start("gimbal", "enterprize") as (process, link):
        came = messages(link)
        before = next(came).fields
        assert before["big_q"] == before["small_q"] == pytest.approx([1.0, 0.0, 0.0, 0.0])
        discarded = link.stats.receive.discarded_bytes  # the first frame may have come in part
        link.send("sentry_gimbal_cmd", r_target_yaw=0.0, r_target_pitch=0.0, l_shoot_mode=1, r_shoot_mode=0, **aim)
        wait_for_event(process, "shoots")
        arrived = [next(came).fields for _ in range(4000)]
        stats = link.stats
        assert stats.receive.discarded_bytes == discarded and not stats.dropped_messages, stats
    for sender in range(4):
        counts = [fields["target_color"] for fields in arrived if fields["cur_cv_mode"] == sender]
        assert len(counts) > 256
        assert {(after - count) % 256 for count, after in pairwise(counts)} == {1}, stats
    assert arrived[-1]["big_q"][0] == pytest.approx(math.cos(0.25) * math.cos(0.125), abs=1e-6)
    assert arrived[-1]["small_q"][3] == pytest.approx(math.sin(0.05) * math.cos(0.1), abs=1e-6)
