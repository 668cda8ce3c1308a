"""The counters of an MCU's link, by the names of the counters service's fields."""

from __future__ import annotations

from enum import StrEnum


class Counted(StrEnum):
    """The meaning of a counter."""

    RECEIVED = "received"  #: frames that came whole
    BYTES = "bytes"  #: received bytes that were refused
    MESSAGES = "messages"  #: received messages, or frames, that were refused
    LINE = "line"  #: events of the line
    SENT = "sent"  #: frames that left
    UNSENT = "unsent"  #: frames that somebody wanted to send and that did not leave


# Subject and meaning of each counter. The generator knows how the link provides it: gen/cpp_counters.py.
COUNTERS: dict[str, tuple[Counted, str]] = {
    "frames": (Counted.RECEIVED, "frames that came whole"),
    "unknown_frames": (Counted.RECEIVED, "of these, frames of no message that the MCU knows"),
    "no_start": (Counted.BYTES, "bytes between frames that start nothing"),
    "constant_mismatch": (Counted.BYTES, "bytes of frames with a wrong magic, constant or tail"),
    "length_out_of_range": (Counted.BYTES, "bytes of frames with an impossible length"),
    "unknown_message": (Counted.BYTES, "bytes of frames of an unknown id or size, where `unknown: reject` holds"),
    "header_check_mismatch": (Counted.BYTES, "bytes of frames whose header's check did not hold"),
    "check_mismatch": (Counted.BYTES, "bytes of frames whose check did not hold"),
    "bad_stuffing": (Counted.BYTES, "bytes of frames with impossible stuffing"),
    "incomplete": (Counted.BYTES, "bytes of frames that broke off"),
    "lapped": (Counted.BYTES, "bytes that new ones overwrote before they were read"),
    "dropped": (Counted.BYTES, "bytes that were dropped because poll stalled"),
    "foreign": (Counted.MESSAGES, "frames for another address"),
    "unlisted": (Counted.MESSAGES, "frames of messages that the file does not list"),
    "late": (Counted.MESSAGES, "messages as old as their deadline"),
    "held_back": (Counted.MESSAGES, "messages held back by a deadline with `recover: explicit`"),
    "rejected": (Counted.MESSAGES, "messages with a value that breaks its field's rule"),
    "line_errors": (Counted.LINE, "framing, noise, overrun and DMA errors"),
    "collisions": (Counted.LINE, "runs of frames that were not heard back as they were sent"),
    "receive_restarts": (Counted.LINE, "times that reception began again"),
    "reception_stops": (Counted.LINE, "times that it had ended without an error, as with a DMA in normal mode"),
    "sent": (Counted.SENT, "frames that left"),
    "send_refused": (Counted.UNSENT, "frames that `send` refused"),
    "send_expired": (Counted.UNSENT, "frames that waited for too long"),
    "send_aborted": (Counted.UNSENT, "frames in a run that was stopped"),
}
