"""This end's knowledge of the deadlines at the MCU, compared with a simulated MCU that gets the same frames."""

from __future__ import annotations

import random

from tests.shared import codec
from wirebond.protocol.model import End
from wirebond.recording.history.mcu_deadlines import McuDeadlines
from wirebond.recording.history.source import Source
from wirebond.sim.virtual_mcu import VirtualMcu

DIFFDRIVE = codec("diffdrive")
VELOCITY = DIFFDRIVE.encode("velocity", linear=0.5, angular=0)
RECOVER = DIFFDRIVE.encode("parameter", name="clear_safe_mode", value=0)
OTHER = DIFFDRIVE.encode("parameter", name="max_linear", value=0)
STOP, SAFE_MODE = 0, 1  # places in the file


def struck(source: Source, now: float) -> dict[int, bool]:
    return {state["deadline"]: state["since"] is not None for state in source.mcu_deadlines.states(now)}


def test_sent_messages_show_which_deadlines_have_struck_at_the_mcu() -> None:
    for seed in range(20):
        chance = random.Random(seed)
        mcu, source = VirtualMcu(DIFFDRIVE, 0.0), Source(DIFFDRIVE, End.HOST, 0.02)
        now, pending, times = 0.0, [VELOCITY], [0.0]
        mcu.feed(VELOCITY, now)
        for _ in range(40):
            now = round(now + chance.choice([0.05, 0.5, 1.1, 2.95, 3.1, 7.0]), 3)
            mcu.tick(now)
            frame = chance.choice([VELOCITY, VELOCITY, VELOCITY, RECOVER, OTHER])
            mcu.feed(frame, now)
            pending.append(frame)
            times.append(now)
            if chance.random() < 0.5:  # the history gets several frames at once
                source.feed(End.HOST, pending, times)
                pending, times = [], []
                (device,) = mcu._devices.values()
                wanted = {place: watch.struck for place, watch in enumerate(device.watches)}
                assert struck(source, now) == wanted, (seed, now)


def test_before_the_first_message_nothing_is_known() -> None:
    source = Source(DIFFDRIVE, End.HOST, 0.02)
    assert source.mcu_deadlines.states(100.0) == [
        {"deadline": STOP, "since": None, "unknown": True},
        {"deadline": SAFE_MODE, "since": None, "unknown": True},
    ]
    source.feed(End.HOST, [VELOCITY], [100.0])
    assert [state["since"] for state in source.mcu_deadlines.states(102.0)] == [101.0, None]
    assert [state["since"] for state in source.mcu_deadlines.states(104.0)] == [101.0, 103.0]
    source.feed(End.HOST, [VELOCITY], [105.0])  # it is held back, and ends nothing
    assert [state["since"] for state in source.mcu_deadlines.states(105.1)] == [101.0, 103.0]


def test_a_protocol_without_deadlines_at_the_mcu_has_none() -> None:
    assert McuDeadlines(codec("enterprize").model).states(1.0) == []
