"""The result of the examination of one candidate: the outcome, and each applied rule."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from wirebond.analysis.explain.layout import payload_index
from wirebond.protocol.model import Message, Part


class Outcome(StrEnum):
    FRAME = "frame"
    INCOMPLETE = "incomplete"  # nothing is wrong yet, and more bytes must come
    REFUSED = "refused"


class Cause(StrEnum):
    """Why bytes are discarded, in the decoder's words and their order."""

    NONE = ""  # they are not: a frame
    NO_START = "no_start"
    CONSTANT_MISMATCH = "constant_mismatch"
    LENGTH_OUT_OF_RANGE = "length_out_of_range"
    UNKNOWN_MESSAGE = "unknown_message"
    HEADER_CHECK_MISMATCH = "header_check_mismatch"
    CHECK_MISMATCH = "check_mismatch"
    BAD_STUFFING = "bad_stuffing"
    INCOMPLETE = "incomplete"


class Question(StrEnum):
    """The question that a rule asks."""

    CONSTANT = "constant"
    CONDITION = "condition"  # a `when` of the form
    LENGTH = "length"
    MESSAGE = "message"
    MATCH = "match"  # which of the messages with its id it is
    SIZE = "size"
    FIELD = "field"  # a constant among the message's fields
    CHECK = "check"


@dataclass(frozen=True)
class Rule:
    """A rule that was applied. ``part`` indexes the verdict's parts; None: the frame as a whole."""

    question: Question
    part: int | None
    holds: bool
    expected: str
    found: str


@dataclass(frozen=True)
class Verdict:
    """``cause`` is the decoder's word where the outcome is not a frame. ``extent``: the frame's size; or this many of
    the candidate's bytes the refusal was about; or this many are needed to go on. ``parts``: those that are there, of a
    format whose frames differ. ``payload`` is its place in the frame, where its size is known."""

    outcome: Outcome
    cause: Cause
    extent: int
    parts: tuple[Part, ...]
    rules: tuple[Rule, ...]
    id: int | None = None
    message: Message | None = None  # with this id, even where the payload does not fit it
    payload: tuple[int, int] | None = None

    @property
    def is_frame(self) -> bool:
        return self.outcome == Outcome.FRAME

    @property
    def failed(self) -> Rule | None:
        return next((rule for rule in self.rules if not rule.holds), None)

    @property
    def payload_size(self) -> int | None:
        return None if self.payload is None else self.payload[1] - self.payload[0]

    @property
    def seed(self) -> int:
        return self.message.seed or 0 if self.message is not None else 0

    @property
    def trims_zeros(self) -> bool:
        return self.parts[payload_index(self.parts)].trims_zeros

    @property
    def delivered_as(self) -> str:
        """The message's name, or "unknown": no such id, or a payload too short for it."""
        message = self.message
        long_enough = message is not None and (self.trims_zeros or (self.payload_size or 0) >= message.min_payload)
        return message.name if message is not None and long_enough else "unknown"

    def payload_of(self, data: bytes) -> bytes:
        """Return the payload in the frame's bytes, with the zeros that were not sent."""
        start, stop = self.payload or (0, 0)
        payload = data[start:stop]
        return payload.ljust(self.message.min_payload, b"\0") if self.message and self.trims_zeros else payload
