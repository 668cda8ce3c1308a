"""Generates the C++ that fills the counters service from the MCU's link."""

from __future__ import annotations

from wirebond.generate.code.cpp_shape import Shape
from wirebond.protocol.counters import COUNTERS
from wirebond.protocol.model import Service

_CAUSES = (
    "no_start", "constant_mismatch", "length_out_of_range", "unknown_message", "header_check_mismatch",
    "check_mismatch", "bad_stuffing", "incomplete",
)  # fmt: skip
_BYTES = "link.receiver().account().discarded_bytes[static_cast<std::size_t>(wirebond::Cause::{})]"
SOURCES = {
    "frames": "link.receiver().account().frames",
    "unknown_frames": "link.receiver().account().unknown_frames",
    **{cause: _BYTES.format(cause) for cause in _CAUSES},
    "lapped": "link.receive_account().lapped",
    "dropped": "link.receive_account().dropped",
    **{name: f"link.counters().{name}" for name in ("foreign", "unlisted", "late", "held_back")},
    "rejected": "link.receiver().violations().rejected",
    **{
        name: f"link.counters().{name}" for name in ("line_errors", "collisions", "receive_restarts", "reception_stops")
    },
    "sent": "link.send_account().sent",
    "send_refused": "link.send_account().refused()",
    "send_expired": "link.send_account().expired",
    "send_aborted": "link.send_account().aborted",
}


def counter_lines(service: Service | None, shapes: dict[str, Shape]) -> list[str]:
    """Return the assignments to the members of ``message``, each cut to the bits of its field."""
    name = None if service is None else service.message("message")
    if name is None:
        return []
    lines = []
    for member in shapes[name].members:
        if member.spec.name not in COUNTERS or not member.name:
            continue
        mask = f" & 0x{(1 << member.spec.width) - 1:X}U" if member.spec.width < 32 else ""
        value = SOURCES[member.spec.name] + mask
        lines.append(f"message.{member.name} = static_cast<decltype(message.{member.name})>({value});")
    return lines
