"""The settings that the driver of a serial port really uses for a link. Values and sentences; opens nothing."""

from __future__ import annotations

import os
from dataclasses import dataclass
from enum import StrEnum
from typing import Any


class LowLatency(StrEnum):
    """The driver's answer to the low-latency flag, with which it delivers bytes as they arrive."""

    ACCEPTED = "accepted"
    REFUSED = "refused"  #: it refuses the flag, or does not keep it
    NOT_OFFERED = "not_offered"  #: it knows no such flag, as a pty's or a network's


_SAID = {
    LowLatency.ACCEPTED: "low latency accepted by the driver",
    LowLatency.REFUSED: "low latency refused by the driver",
    LowLatency.NOT_OFFERED: "low latency not offered by the driver",
}


@dataclass(frozen=True)
class LatencyTimer:
    """The latency timer of an FTDI adapter: how long it holds received bytes back.

    :ivar before_ms: milliseconds, before the link opened the port.
    :ivar now_ms: after the opening; the link sets 1.
    :ivar why: a sentence where it is still longer than that: why, and what to do; empty else.
    """

    before_ms: int
    now_ms: int
    why: str = ""

    def __str__(self) -> str:
        if self.why:
            return f"latency timer {self.now_ms} ms: {self.why}"
        if self.before_ms == self.now_ms:
            return f"latency timer {self.now_ms} ms"
        return f"latency timer {self.before_ms} ms before, {self.now_ms} ms now"


@dataclass(frozen=True)
class Line:
    """The settings that the driver of a serial port really uses for a link. As ``str`` it is one line for a person.

    :ivar baud: bits per second that the driver really uses, as far as it says so.
    :ivar asked_baud: bits per second that the link asked for.
    :ivar data_bits: as the driver has it.
    :ivar parity: ``none``, ``even`` or ``odd``.
    :ivar stop_bits: as the driver has it.
    :ivar is_exclusive: no other program that asks for a port alone can open it now.
    :ivar low_latency: what the driver said to that flag.
    :ivar latency_timer: of an FTDI adapter; None: the port has none.
    """

    baud: int
    asked_baud: int
    data_bits: int
    parity: str
    stop_bits: int
    is_exclusive: bool
    low_latency: LowLatency
    latency_timer: LatencyTimer | None = None

    def __str__(self) -> str:
        asked = "" if self.baud == self.asked_baud else f" ({self.asked_baud} were asked for)"
        stop = "1 stop bit" if self.stop_bits == 1 else f"{self.stop_bits:g} stop bits"
        parts = [
            f"{self.baud} baud{asked}",
            f"{self.data_bits} data bits",
            f"parity {self.parity}",
            stop,
            "exclusive" if self.is_exclusive else "not exclusive",
            _SAID[self.low_latency],
        ]
        return ", ".join(parts) + ("" if self.latency_timer is None else f"; {self.latency_timer}")

    def as_dict(self) -> dict[str, Any]:
        """Return it as a dictionary for JSON.

        :returns: the attributes by name.
        """
        timer = self.latency_timer
        return {
            **vars(self),
            "low_latency": str(self.low_latency),
            "latency_timer": None if timer is None else dict(vars(timer)),
        }


def line_from(raw: dict[str, Any]) -> Line:
    """Return it for the values from the engine."""
    timer = raw.pop("latency_timer", None)
    found = None if timer is None else latency_timer(*timer)
    return Line(**{**raw, "low_latency": LowLatency(raw["low_latency"])}, latency_timer=found)


def latency_timer(path: str, before_ms: int, now_ms: int, code: int) -> LatencyTimer:
    """Describe a latency timer. ``path``: of the file; ``code``: the error of writing it, 0 if there was none."""
    why = ""
    if now_ms > 1:
        reason = os.strerror(code) if code else "the driver keeps its value"
        why = (
            f"it cannot be set to 1 ms ({reason}), so received bytes may come that much later; "
            f"`echo 1 | sudo tee {path}` sets it until the adapter is unplugged"
        )
    return LatencyTimer(before_ms, now_ms, why)
