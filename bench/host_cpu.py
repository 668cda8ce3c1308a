"""Measures the cost of a full line of 2 Mbaud for the host: the processor time of one Python program that uses a link.

In come about 4 350 frames a second, each given to a handler in Python; out go about 9 000, each by its own ``send``.
That is what 8N2 carries in both directions. Processor time is that of all threads, by the system's account.
"""

from __future__ import annotations

import subprocess
import sys
import threading
import time

import wirebond
from bench import every_command
from bench.figures import Figure

SECONDS = 10.0
ROUNDS = 3
LINE_USE = 0.995
TICK = 0.001
COMMAND = "make bench ONLY=host_cpu"
GOAL = 25.0


def measure() -> list[Figure]:
    rows = sorted(load(SECONDS, LINE_USE) for _ in range(ROUNDS))
    spent, sent, handled, _ = rows[len(rows) // 2]
    return [
        Figure("host_cpu_2mbaud", 100 * spent, "% of a core", GOAL, COMMAND),
        Figure("host_cpu_frames_in_per_s", handled, "frames/s", None, COMMAND),
        Figure("host_cpu_frames_out_per_s", sent, "frames/s", None, COMMAND),
        Figure("host_cpu_lost", max(row[3] for row in rows), "frames", 0, COMMAND),
    ]


def load(seconds: float, line_use: float) -> tuple[float, float, float, int]:
    """The share of a core that was spent, frames that went out and came in per second, and frames that were lost."""
    command = [sys.executable, "-m", "bench.busy_peer", str(seconds), str(line_use)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as peer:
        assert peer.stdout is not None
        with wirebond.open(every_command.codec(), peer.stdout.readline().strip()) as link:
            counts = dict.fromkeys(("sentry_gimbal_msg", "gimbal_msg", "field_msg"), 0)
            checks = 0.0

            def handle(message: wirebond.Message) -> None:
                nonlocal checks
                counts[message.name] += 1
                checks += message.fields["remain_time" if message.name == "field_msg" else "bullet_speed"]

            for name in counts:
                link.on(name)(handle)
            before = time.process_time()
            began = time.monotonic()
            sender = threading.Thread(target=_send, args=(link, began + seconds, line_use))
            sender.start()
            sender.join()
            spent = time.process_time() - before
            took = time.monotonic() - began
            number, refused_bytes, heard = map(int, peer.stdout.readline().split())
            time.sleep(0.2)
            stats = link.stats
    lost = number - sum(counts.values()) + stats.send.offered - stats.send.sent
    if refused_bytes or heard != stats.send.sent_bytes:
        lost += 1
    return spent / took, stats.send.sent / took, sum(counts.values()) / took, lost


def _send(link: wirebond.Link, until: float, line_use: float) -> None:
    """Four messages in turn, as many as this share of the line carries."""
    line = link.codec.model.link
    rate = line_use * line.baud / line.bits_per_byte
    began = time.monotonic()
    sent = number = 0
    while (now := time.monotonic()) < until:
        while sent < (now - began) * rate:
            match number % 4:
                case 0:
                    link.send("action_cmd", scan=True, spin_vel=0.5, cv_enable=True)
                case 1:
                    link.send("gimbal_cmd", target_pitch=0.1, target_yaw=0.2, shoot_mode=1)
                case 2:
                    link.send("chassis_cmd", x_vel=0.1, y_vel=0.2, w_vel=0.3)
                case _:
                    link.send(
                        "sentry_gimbal_cmd",
                        l_target_pitch=0.1,
                        l_target_yaw=0.2,
                        l_shoot_mode=1,
                        r_target_pitch=0.1,
                        r_target_yaw=0.2,
                        r_shoot_mode=1,
                        main_target_pitch=0.1,
                        main_target_yaw=0.2,
                    )
            sent += (13, 16, 19, 33)[number % 4]
            number += 1
        time.sleep(TICK)
