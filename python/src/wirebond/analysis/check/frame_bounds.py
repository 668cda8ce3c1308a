"""The largest frame of each end, and the memory that its receiver needs for it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from wirebond.analysis.check.frame_facts import senders
from wirebond.protocol.model import End, Protocol, Stuffing


@dataclass(frozen=True)
class FrameBound:
    """``workspace_bytes``: of the receiver, as ``workspace_bytes`` of ``wirebond/stream_deframer.hpp`` has it."""

    sender: End
    wire_bytes: int
    workspace_bytes: int

    def as_dict(self) -> dict[str, Any]:
        return {"wire_bytes": self.wire_bytes, "workspace_bytes": self.workspace_bytes}


def frame_bounds(protocol: Protocol) -> list[FrameBound]:
    """Return the bounds for each end that sends."""
    copies = 2 if protocol.format.stuffing == Stuffing.NONE else 3
    found = []
    for end in senders(protocol):
        largest = protocol.max_wire_bytes(sender=end)
        found.append(FrameBound(end, largest, copies * largest))
    return found
