"""The core's description of a frame: offsets, tests and rows of messages (``wirebond/format.hpp``), as plain values.

``planning`` makes it. The engine is filled from it and the generated C++ prints it, so both ends have one meaning.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from wirebond.protocol.model import (
    Algorithm,
    ByteOrder,
    Escapes,
    HeaderField,
    Insertion,
    MatchOf,
    PayloadRule,
    Stuffing,
    Subject,
)
from wirebond.protocol.model.forms import Choice
from wirebond.protocol.payload_rules import PayloadRules

MAX_CONSTANTS = 16
MAX_CHECKS = 4
MAX_ALGORITHMS = 4
MAX_FORMS = 8
MAX_HEADER_FIELDS = 16
MAX_ESCAPES = 6
MAX_EXCLUSIONS = 24
MAX_INSERTION = 4
NO_ID = 0xFFFFFFFF  # means "none" where some frames of a sender have an id and others do not


@dataclass(frozen=True)
class Position:
    """``offset`` from the frame's first byte or, negative with ``from_end``, from one past its last."""

    offset: int
    from_end: bool = False


@dataclass(frozen=True)
class Constant:
    at: Position
    value: int
    mask: int = 0xFF


@dataclass(frozen=True)
class Number:
    at: Position
    bytes: int
    order: ByteOrder
    shift: int
    mask: int


@dataclass(frozen=True)
class CheckRule:
    algorithm: int
    ranges: tuple[tuple[Position, Position], ...]  # from and to, in the order of the check
    at: Position
    bytes: int
    order: ByteOrder
    shift: int
    seeded: bool
    as_hex: bool
    on_wire: bool  # over the bytes as they are sent, after stuffing
    continues: int  # index of an earlier check, or -1
    run: Number | None  # where it has only some bits of its bytes
    covers_run: bool  # a range holds the bytes of ``run``, whose bits count as zeros

    @property
    def bits(self) -> int:
        """Return how many bits of a frame it determines."""
        return 8 * self.bytes if self.run is None else self.run.mask.bit_length()


@dataclass(frozen=True)
class HeaderNumber:
    """The place of a header field in a form. Numbers are bits on the wire."""

    name: str
    number: Number
    default: int  # of this sender
    place: int  # in ``Plan.header``
    fixed_mask: int = 0  # bits of the number that distinguish this form from others,
    fixed_value: int = 0  # and their value
    is_magic: bool = False  # any form will do where no magic is asked for


@dataclass(frozen=True)
class Exclusion:
    """A frame is not of this form if a number is from ``low`` to ``high``; ``number.mask`` selects its bits.

    ``number`` is where a receiver finds it; None: the payload's size.
    """

    subject: Subject
    place: int  # of a header field
    number: Number | None
    low: int
    high: int
    on_receive: bool  # False: it only chooses the sender's form


@dataclass(frozen=True)
class FormChoice:
    """A choice of the form, with the place of its number; None: the payload's size."""

    choice: Choice
    number: Number | None


@dataclass(frozen=True)
class Form:
    """A shape that a frame can take: fixed bytes, the payload, fixed bytes; places are counted from either end."""

    prefix: int
    suffix: int
    payload: PayloadRule
    fixed_payload: int
    trims_zeros: bool
    length: Number | None
    length_unit: int
    length_bias: int
    id: Number | None
    constants: tuple[Constant, ...]
    prefix_constants: int
    checks: tuple[CheckRule, ...]
    header_checks: int
    header: tuple[HeaderNumber, ...]
    choices: tuple[FormChoice, ...] = ()
    exclusions: tuple[Exclusion, ...] = ()
    payload_unit: int = 1  # a check over words refuses payloads whose size, divided by this, does not leave
    payload_rest: int = 0  # this rest
    id_mask: int = 0  # bits of the id that distinguish this form from others,
    id_value: int = 0  # and their value

    @property
    def most_payload(self) -> int:
        """The longest payload that its length can express. Without the length that other forms have it carries none."""
        if self.payload == PayloadRule.FIXED:
            return self.fixed_payload
        if self.payload != PayloadRule.BY_LENGTH:
            return 0xFFFF
        return 0 if self.length is None else self.length.mask * self.length_unit + self.length_bias

    def carries(self, payload: int) -> bool:
        """Check whether its length can give a payload of this size, and no check refuses it."""
        if not 0 <= payload <= self.most_payload or payload % self.payload_unit != self.payload_rest:
            return False
        counted = payload - self.length_bias
        return self.length is None or (counted >= 0 and counted % self.length_unit == 0)


@dataclass(frozen=True)
class MatchTest:
    """A number of a frame: its bits of ``mask`` are from ``low`` to ``high``; with ``or_next`` or the next test holds.

    ``place``: of a header field, in ``Plan.header``. ``at`` to ``shift``: of a number of the payload.
    """

    of: MatchOf
    mask: int
    low: int
    high: int
    or_next: bool
    is_one: bool  # the whole number has one value, which a sender gives it by itself
    name: str  # of the header field, or of the field of the payload
    place: int = 0
    at: int = 0
    bytes: int = 0
    order: ByteOrder = ByteOrder.LITTLE
    shift: int = 0


@dataclass(frozen=True)
class MessageRow:
    """``index`` is the message's place in ``Protocol.messages``."""

    id: int
    index: int
    min_payload: int
    max_payload: int
    seed: int
    only_expected: bool  # shares its id with others of its sender: it is meant where its request has gone out
    rules: PayloadRules  # those that a receiver applies
    tests: tuple[MatchTest, ...] = ()  # all conditions of the message's frames, if ids do not identify all messages


class Framing(StrEnum):
    """How the start and end of a frame in a stream are found."""

    BY_START = "by_start"  # by its first constant and its size
    DELIMITED = "delimited"  # between two equal delimiters
    BRACKETED = "bracketed"  # between an opening and a closing delimiter that differ
    SILENCE = "silence"  # between two silences of the line
    SIZED = "sized"  # stuffed: by its first constant, and its length gives its end


@dataclass(frozen=True)
class Plan:
    """One end's view: how frames from ``sender`` look, and which messages they carry.

    A sender takes the first form that its header values allow, that has every field whose value was given, and that can
    carry the message. With the defaults of ``header`` these are among the ``own_forms`` first ones.
    """

    framing: Framing
    opening: bytes
    closing: bytes
    sends_opening: bool
    stuffing: Stuffing
    escapes: Escapes | None
    starts: int  # the first this many bytes of ``escapes`` begin frames that their length ends
    insertion: Insertion | None
    length_on_wire: bool  # the length counts the bytes as they are sent, after stuffing
    deliver_unknown: bool
    skips_failed: bool
    plain_front: int  # bytes before the stuffed ones, sent as they are
    plain_back: int  # bytes after them
    decimal_bytes: int  # of the check that is sent in decimal digits; 0: none is
    max_payload: int
    no_id: int  # id of the message of a frame without an id
    own_forms: int
    forms: tuple[Form, ...]
    header: tuple[HeaderField, ...]  # of all forms, in the order of the parts and of their bits
    address: int | None  # place in ``header`` of the field that says for whom a frame of this sender is
    broadcast: tuple[int, ...]  # values of that field, as bits on the wire, that mean every receiver
    peer: int | None  # place of the field that says who sent the frame
    sequence: int | None  # place of the number that counts a sender's frames; None: a receiver has nothing to count by
    sequence_per_message: bool  # it counts the frames of each message
    algorithms: tuple[Algorithm, ...]
    matches: bool  # a message of this sender needs more than one id to be identified
    matches_late: bool  # a test needs bytes that are not before the payload
    id_place: int | None  # place in ``header`` of the id, where a message has several
    messages: tuple[MessageRow, ...]  # by rising id; of one id those that are only expected first
