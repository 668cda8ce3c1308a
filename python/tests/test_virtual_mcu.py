"""The virtual MCU: its deadlines, which hold messages back as those of a firmware do."""

from __future__ import annotations

from tests.shared import PROTOCOLS

import wirebond
from wirebond.sim.virtual_mcu import VirtualMcu

CODEC = wirebond.load(PROTOCOLS / "diffdrive.yaml")
VELOCITY = CODEC.encode("velocity", linear=0.5, angular=0.0)


def run(mcu: VirtualMcu, begin: float, end: float) -> list[str]:
    """What it tells meanwhile, polled every 10 ms."""
    for step in range(round((end - begin) * 100)):
        mcu.tick(begin + step / 100)
    told = [event for event in mcu.events if "velocity" in event]
    mcu.events.clear()
    return told


def test_an_explicit_deadline_holds_its_message_back_until_somebody_recovers() -> None:
    mcu = VirtualMcu(CODEC, 0.0)
    assert run(mcu, 0.0, 5.0) == ["no velocity for 1 s: stop", "no velocity for 3 s: safe_mode"]
    mcu.feed(VELOCITY, 5.0)  # it never came before: nothing is held back
    assert mcu.held_back == 0
    assert run(mcu, 5.0, 5.5) == ["velocity is back: stop ends", "velocity is back: safe_mode ends"]
    assert run(mcu, 5.5, 9.0) == ["no velocity for 1 s: stop", "no velocity for 3 s: safe_mode"]
    mcu.feed(VELOCITY, 9.0)
    assert mcu.held_back == 1
    assert run(mcu, 9.0, 9.5) == []
    mcu.recover("safe_mode", 9.5)
    mcu.feed(VELOCITY, 9.6)
    assert mcu.held_back == 1
    assert run(mcu, 9.6, 10.5) == []
    assert run(mcu, 10.5, 13.0) == ["no velocity for 1 s: stop", "no velocity for 3 s: safe_mode"]
