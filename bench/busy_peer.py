"""The MCU's end for ``bench/host_cpu.py``: it sends as much as a line of 2 Mbaud carries, and reads all that comes.

``python -m bench.busy_peer SECONDS SHARE`` fills this share of the line. It prints its pty's path, and begins with the
first byte that it hears. At the end it prints how many frames it sent, how many bytes the pty refused, and how many
bytes it heard.
"""

from __future__ import annotations

import sys
import time

import wirebond
from bench.collateral import PROTOCOL
from wirebond.sim.pty_port import PtyPort

TICK = 0.001


def main(seconds: float, share: float) -> None:
    codec = wirebond.load(PROTOCOL)
    q = [0.5, -0.5, 0.5, 0.5]
    gimbals = codec.encode("sentry_gimbal_msg", cur_cv_mode=1, target_color=2, bullet_speed=28.5, small_q=q, big_q=q)
    gimbal = codec.encode("gimbal_msg", cur_cv_mode=1, target_color=2, bullet_speed=28.5, q=q)
    field = codec.encode(
        "field_msg",
        {
            "game_state": 4,
            "remain_time": 300,
            "bullet_remain": 200,
            "team": 1,
            "red_hp": [600] * 8,
            "blue_hp": [600] * 8,
        }
        | dict.fromkeys(("in_combat", "bullet_supply_available", "shooter_locked"), True),
    )
    frames = [gimbals, field, gimbals, gimbal]
    port = PtyPort()
    print(port.path, flush=True)
    rate = share * codec.model.link.baud / codec.model.link.bits_per_byte
    while not (heard := len(port.read(0.1))):
        pass
    began = time.monotonic()
    sent = number = 0
    while (now := time.monotonic()) < began + seconds:
        batch = []
        while sent < (now - began) * rate:
            batch.append(frames[number % len(frames)])
            sent += len(batch[-1])
            number += 1
        port.write(b"".join(batch))
        heard += len(port.read(TICK))
        time.sleep(TICK)
    while more := len(port.read(0.2)):
        heard += more
    print(number, port.lost_bytes, heard, flush=True)


if __name__ == "__main__":
    main(float(sys.argv[1]), float(sys.argv[2]))
