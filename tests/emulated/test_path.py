"""The emulated board itself: bytes go from the host's engine to a task of FreeRTOS and back, and none is lost."""

from __future__ import annotations

import time

import wirebond
from tests.emulated.build import HERE, build
from tests.emulated.machine import PATIENCE, Machine
from tests.shared import codec

COMMANDS = 300


def receive(link: wirebond.Link, count: int) -> list[wirebond.Message]:
    messages: list[wirebond.Message] = []
    end = time.monotonic() + PATIENCE
    while len(messages) < count and time.monotonic() < end:
        messages += link.receive(0.1)
    return messages


def test_commands_come_back_from_a_task_on_the_emulated_board() -> None:
    program = build(HERE / "programs" / "path.cpp", "enterprize")
    with Machine(program) as machine:
        assert machine.line() == "ready"
        with wirebond.open(codec("enterprize"), machine.ports[0]) as link:
            commands = [{"x_vel": float(n), "y_vel": 0.5 * n, "w_vel": -1.0 * n} for n in range(COMMANDS - 1)]
            commands.append({"x_vel": -1.0, "y_vel": 0.0, "w_vel": 0.0})  # the last, by its value
            for command in commands:
                link.send("chassis_cmd", command)
            assert [m.fields for m in receive(link, COMMANDS)] == commands
            report = machine.report()
            assert report.pop("words of stack left") > 100
            assert report == {"bytes": COMMANDS * 19, "in frames": COMMANDS * 19, "echoed": COMMANDS}
            assert link.stats.receive.bytes == link.stats.receive.frame_bytes == COMMANDS * 19
