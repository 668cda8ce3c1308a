"""Computes the cost of a soak for the MCU's processor from counted instructions. Nothing is measured."""

from __future__ import annotations

from typing import Any

CLOCK_HZ = 170e6  # of the Cortex-M4 in the overload experiment

# Counted for enterprize on an emulated Cortex-M4, -O2, by `make bench ONLY=m4_runtime`: the figures named there.
PROTOCOL = "enterprize"
SEND = 397.0  # m4_send_instructions, a frame
RUN = 651.0  # m4_on_transmitted_instructions, a run of four frames
PENDED = 35.0  # m4_on_pended_instructions
RECEIVE_EVENT = 19.0  # m4_on_received_instructions
POLL = 162.0  # m4_poll_instructions, without a frame
RECEIVE = 581.0 - POLL  # m4_receive_instructions, a frame
SOURCE = "instructions counted by `make bench ONLY=m4_runtime`, one a cycle, without waits for flash"


def mcu_cpu_percent(result: dict[str, Any]) -> float | None:
    """Return the share of a processor of 170 MHz; None if the protocol's instructions were not counted. A refused send
    counts as a whole one."""
    if result["protocol"] != PROTOCOL or not result["virtual_seconds"]:
        return None
    work = result["mcu_work"]
    instructions = (
        result["to_host"]["offered"] * (SEND + PENDED)
        + work["runs"] * RUN
        + work["polls"] * POLL
        + work["receive_events"] * RECEIVE_EVENT
        + result["to_mcu"]["delivered"] * RECEIVE
    )
    return 100 * float(instructions) / (float(result["virtual_seconds"]) * CLOCK_HZ)
