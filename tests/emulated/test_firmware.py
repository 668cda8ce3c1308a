"""The firmwares on the emulated board, under FreeRTOS, against the host's engine."""

from __future__ import annotations

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

import wirebond
from tests.emulated.build import HERE, build, without_silence
from tests.emulated.machine import Machine
from tests.shared import ROOT, codec, codec_without_latest
from tests.waiting import PATIENCE, moments

pytestmark = pytest.mark.live

FIRMWARE = ROOT / "firmware"


def program(name: str, protocol: str, *definitions: str, optimise: str = "-O2") -> Path:
    source = HERE / "programs" / f"{name}.cpp"
    return build(source, protocol, includes=[FIRMWARE / name], definitions=definitions, optimise=optimise)


def messages(link: wirebond.Link) -> Iterator[wirebond.Message]:
    """All that comes, for as long as it takes."""
    while True:
        for _ in moments("a message of the machine"):
            if came := link.receive(0.1):
                break
        yield from came


def answer(came: Iterator[wirebond.Message], name: str) -> dict[str, Any]:
    """The fields of the next message of this name."""
    return next(m.fields for m in came if m.name == name)


def discarded(link: wirebond.Link) -> int:
    """Return how many bytes the host discarded. Tests that read messages until one fits would not miss them."""
    return sum(link.stats.receive.discarded_bytes.values())


# Of each mistake the first words of what a link says: by its port's answer about the settings, and by what happened,
# for a port that knows no setting.
NOTHING = "nothing is known to be wrong"
MISTAKES = {
    "none": (NOTHING, NOTHING),
    "interrupt off": ("the UART's interrupt is off", "the UART's interrupt was pended and `on_pended` was not called"),
    "no line for pends": ("the UART's interrupt was pended and `on_pended` was not called",) * 2,
    "DMA in normal mode": ("the receive DMA is in normal mode", "reception ends by itself"),
    "no receive DMA": ("the UART has no receive DMA", "the port does not start reception"),
    "no transmit DMA": ("the UART has no transmit DMA", "nothing that is sent leaves"),
    "wrong baud rate": ("the UART has another baud rate", "bytes come, and no frame is among them"),
    "tick below the UART": ("the HAL's tick cannot interrupt", NOTHING),
    "UART not initialised": ("the UART is not initialised", "no valid frame comes"),
}


def test_a_board_with_a_mistake_says_what_it_is_in_cpp_and_c() -> None:
    programs = HERE / "programs"
    small = [f"ENTERPRIZE_LINK_{what}" for what in (f"COUNT={len(MISTAKES)}", "RECEIVE_BYTES=256", "SEND_BYTES=256")]
    elf = build(
        programs / "mistakes.cpp",
        "enterprize",
        in_c=programs / "mistakes_in_c.c",
        includes=[FIRMWARE / "echo"],
        definitions=small,
    )
    with Machine(elf) as machine:
        for mistake, (by_settings, by_running) in MISTAKES.items():
            for language in ("C++", "C"):
                said = machine.line().split(" | ")
                assert said[:2] == [mistake, language]
                assert said[2].startswith(by_settings), said
                assert said[3].startswith(by_running), said


# The emulated UART has no baud rate: bytes come as fast as they are taken, and what the ring cannot hold is lost where
# the processor is busy. Without optimisation it is; then no more are sent at once than the ring holds.
@pytest.mark.parametrize(
    ("optimise", "at_once"),
    [
        ("-O0", 10),
        ("-Os", 200),
        ("-O2", 200),
        *(pytest.param(level, 200, marks=pytest.mark.long) for level in ("-Og", "-O1", "-O3")),
    ],
)
def test_echo_sends_back_what_came_on_two_links_at_once(optimise: str, at_once: int) -> None:
    commands = [{"x_vel": float(n), "y_vel": 0.5 * n, "w_vel": -1.0 * n} for n in range(200)]
    others = [command | {"w_vel": 7.0} for command in commands]
    enterprize = without_silence(codec_without_latest("enterprize"))  # each of many sent at once leaves
    with (
        Machine(program("echo", "enterprize", optimise=optimise)) as machine,
        wirebond.open(enterprize, machine.ports[0]) as first,
        wirebond.open(enterprize, machine.ports[1]) as second,
    ):
        came = [messages(first), messages(second)]
        for begin in range(0, len(commands), at_once):
            group = slice(begin, begin + at_once)
            for command, other in zip(commands[group], others[group], strict=True):
                first.send("chassis_cmd", command)
                second.send("chassis_cmd", other)
            assert [next(came[0]).fields for _ in commands[group]] == commands[group]
            assert [next(came[1]).fields for _ in others[group]] == others[group]
        for link in (first, second):
            assert link.stats.receive.bytes == link.stats.receive.frame_bytes


@pytest.mark.parametrize(
    "frames", [pytest.param(500, id="short"), pytest.param(20_000, id="long", marks=pytest.mark.long)]
)
def test_four_tasks_of_the_gimbal_send_at_1_khz_and_every_frame_arrives(frames: int) -> None:
    aim = {"main_target_yaw": 0.5, "main_target_pitch": -0.25, "l_target_yaw": 0.1, "l_target_pitch": 0.2}
    with (
        Machine(program("gimbal", "enterprize", f"FRAMES={frames}U")) as machine,
        wirebond.open(without_silence(codec("enterprize")), machine.ports[0]) as link,
    ):
        link.send("sentry_gimbal_cmd", r_target_yaw=0.0, r_target_pitch=0.0, l_shoot_mode=0, r_shoot_mode=0, **aim)
        arrived: list[dict[str, Any]] = []
        with ThreadPoolExecutor(1) as pool:
            told = pool.submit(machine.report, max(PATIENCE, frames / 50))
            while not told.done():  # the host keeps 65 536 messages for a program that does not read
                arrived += [message.fields for message in link.receive(0.05)]
        report = told.result()
        came = messages(link)
        arrived += [next(came).fields for _ in range(report["sent"] - len(arrived))]
        assert link.receive(0.2) == []
        assert link.stats.dropped_messages == 0
        assert link.stats.receive.bytes == link.stats.receive.frame_bytes
    assert report["offered"] == 4 * frames == report["accepted"] + report["refused"]
    assert report["accepted"] == report["sent"]
    for sender in range(4):
        counts = [fields["target_color"] for fields in arrived if fields["cur_cv_mode"] == sender]
        steps = [(after - before) % 256 for before, after in pairwise(counts)]
        assert 0 not in steps, "a message came twice"
        assert sum(steps) < frames
    assert arrived[-1]["big_q"][0] == pytest.approx(math.cos(0.25) * math.cos(0.125), abs=1e-6)
    assert arrived[-1]["small_q"][3] == pytest.approx(math.sin(0.05) * math.cos(0.1), abs=1e-6)


def test_balance_bot_stands_once_it_is_tuned_over_the_link() -> None:
    with (
        Machine(program("balance", "pid_tuner")) as machine,
        wirebond.open(without_silence(codec("pid_tuner")), machine.ports[0]) as link,
    ):
        came = messages(link)
        assert answer(came, "motors") == {"left": 0.0, "right": 0.0}
        before = discarded(link)  # the machine was sending when the port was opened
        for gains in ({"idx": 0, "p": 10.0, "i": 0.1, "d": 0.3}, {"idx": 1, "p": 0.2, "i": 9.0, "d": 9.0}):
            link.send("pid", gains)
            assert answer(came, "acknowledge") == {"of": 1, "result": "accepted"}
        link.send("read_gains", idx=1)
        assert answer(came, "gains")["i"] == pytest.approx(0.2 / 200)

        next(m for m in came if m.name == "motors" and m.fields["left"] != 0.0)
        next(m for m in came if m.name == "attitude" and abs(m.fields["pitch"]) > 1e-4)
        still = 0
        for message in came:
            if message.name != "attitude":
                continue
            still = still + 1 if abs(message.fields["pitch"]) < 0.01 else 0
            if still == 100:  # two seconds of the bot's
                break
        assert discarded(link) == before


def events_until(machine: Machine, last: str) -> list[tuple[str, int]]:
    """Return the rover's reports, up to the first event of this name, in milliseconds of its own clock."""
    events = []
    while not events or events[-1][0] != last:
        name, _, when = machine.line().rpartition(" ")
        events.append((name, int(when)))
    return events


def test_rover_drives_on_command_and_silence_stops_it_on_time() -> None:
    with (
        Machine(program("rover", "diffdrive")) as machine,
        wirebond.open(without_silence(codec("diffdrive")), machine.ports[0]) as link,
    ):
        came = messages(link)
        answer(came, "odometry")
        before = discarded(link)  # the machine was sending when the port was opened
        # Silence counts from start-up, by the machine's clock; its poll may be some milliseconds late.
        (stop, stopped), (safe_mode, safe) = events_until(machine, "safe_mode")
        assert (stop, safe_mode) == ("stop", "safe_mode")
        assert 1000 <= stopped < 1100
        assert 3000 <= safe < 3100

        # The machine's time is faster than ours: seconds of silence may pass between two commands.
        for _ in moments("the rover turns"):
            link.send("parameter", name="clear_safe_mode", value=0)
            link.send("velocity", linear=0.0, angular=1.0)
            if any(
                m.name == "odometry" and m.fields["left_ticks"] < -10 < 10 < m.fields["right_ticks"]
                for m in link.receive(0.02)
            ):
                break
        *_, (stop, stopped), (_, safe) = events_until(machine, "safe_mode")
        assert stop == "stop"
        assert 1900 <= safe - stopped < 2100  # both count from the last velocity

        link.send("velocity", linear=0.5, angular=0.0)  # held back
        link.send("status_query")
        answer(came, "status")
        odometry = (message.fields for message in came if message.name == "odometry")
        assert [next(odometry) for _ in range(5)] == [{"left_ticks": 0, "right_ticks": 0}] * 5
        link.send("status_query")
        assert answer(came, "status")["errors"] == ["comm_timeout"]
        assert discarded(link) == before
