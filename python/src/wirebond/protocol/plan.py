"""Lowering: a frame's parts become the offsets that the core works with (``wirebond/format.hpp``).

The engine is filled from this plan and the generated C++ prints it, so that both ends have one meaning.
"""

from __future__ import annotations

from dataclasses import dataclass

from wirebond.protocol.model import (
    Algorithm,
    ByteOrder,
    End,
    LengthCounts,
    Message,
    Part,
    PartKind,
    PayloadRule,
    Protocol,
)

MAX_CONSTANTS = 16
MAX_CHECKS = 4
MAX_ALGORITHMS = 4


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
    shift: int = 0
    mask: int = 0xFFFFFFFF


@dataclass(frozen=True)
class CheckRule:
    algorithm: int
    start: Position
    stop: Position
    at: Position
    bytes: int
    order: ByteOrder
    shift: int
    continues: int  # index of an earlier check, or -1


@dataclass(frozen=True)
class Layout:
    prefix: int
    suffix: int
    payload: PayloadRule
    fixed_payload: int
    length: Number | None
    length_unit: int
    length_bias: int
    id: Number | None
    constants: tuple[Constant, ...]
    prefix_constants: int
    checks: tuple[CheckRule, ...]
    header_checks: int


@dataclass(frozen=True)
class MessageRow:
    """``index`` is the message's place in ``Protocol.messages``."""

    id: int
    index: int
    min_payload: int
    max_payload: int


@dataclass(frozen=True)
class Plan:
    """One end's view: how frames from ``sender`` look, and which messages they carry."""

    delimiter: int | None
    stuffing: str
    deliver_unknown: bool
    max_payload: int
    layouts: tuple[Layout, ...]
    algorithms: tuple[Algorithm, ...]
    messages: tuple[MessageRow, ...]  # by rising id


def plan_for(protocol: Protocol, sender: End | None) -> Plan:
    """The plan for frames that ``sender`` sends; None: from either end (their ids must then differ)."""
    frame = protocol.frame
    algorithms: list[Algorithm] = []
    for part in frame.parts:
        if part.algorithm is not None and part.algorithm not in algorithms:
            algorithms.append(part.algorithm)
    rows = [
        MessageRow(m.id, index, m.min_payload, m.max_payload)
        for index, m in enumerate(protocol.messages)
        if m.sent_by(sender)
    ]
    return Plan(
        delimiter=frame.delimiter,
        stuffing=frame.stuffing,
        deliver_unknown=frame.deliver_unknown,
        max_payload=frame.max_payload,
        layouts=(_layout(frame.parts, algorithms),),
        algorithms=tuple(algorithms),
        messages=tuple(sorted(rows, key=lambda row: row.id)),
    )


def ids_collide(protocol: Protocol) -> list[tuple[Message, Message]]:
    """Pairs of messages of different senders that share an id: such streams need ``sender`` to be told apart."""
    by_id: dict[int, Message] = {}
    pairs = []
    for message in protocol.messages:
        other = by_id.setdefault(message.id, message)
        if other is not message:
            pairs.append((other, message))
    return pairs


def _layout(parts: tuple[Part, ...], algorithms: list[Algorithm]) -> Layout:
    payload_index = next(i for i, p in enumerate(parts) if p.kind == PartKind.PAYLOAD)
    payload = parts[payload_index]
    prefix = sum(p.size for p in parts[:payload_index])
    suffix = sum(p.size for p in parts[payload_index + 1 :])

    def start_of(index: int) -> Position:
        if index <= payload_index:
            return Position(sum(p.size for p in parts[:index]))
        return Position(-sum(p.size for p in parts[index:]), from_end=True)

    def end_of(index: int) -> Position:
        if index < payload_index:
            return Position(sum(p.size for p in parts[: index + 1]))
        return Position(-sum(p.size for p in parts[index + 1 :]), from_end=True)

    before: list[Constant] = []
    after: list[Constant] = []
    length: Number | None = None
    length_bias = 0
    message_id: Number | None = None
    checks: list[tuple[bool, int, Part]] = []
    for index, part in enumerate(parts):
        at = start_of(index)
        if part.kind in (PartKind.MAGIC, PartKind.CONSTANT, PartKind.TAIL):
            place = before if index < payload_index else after
            place.extend(Constant(Position(at.offset + i, at.from_end), byte) for i, byte in enumerate(part.value))
        elif part.kind == PartKind.LENGTH:
            length = Number(at, part.size, part.order)
            follows = sum(p.size for p in parts[index + 1 :])
            counted_beside_payload = {
                LengthCounts.PAYLOAD: 0,
                LengthCounts.REST: follows,
                LengthCounts.SELF_AND_REST: part.size + follows,
                LengthCounts.FRAME: prefix + suffix,
            }[part.counts]
            length_bias = -counted_beside_payload - part.length_offset
        elif part.kind == PartKind.ID:
            message_id = Number(at, part.size, part.order)
        elif part.kind == PartKind.CHECK:
            in_header = index < payload_index and part.last < payload_index
            checks.append((not in_header, index, part))
    checks.sort(key=lambda entry: entry[:2])

    rules: list[CheckRule] = []
    for _, index, part in checks:
        assert part.algorithm is not None
        algorithm = algorithms.index(part.algorithm)
        start, stop = start_of(part.first), end_of(part.last)
        continues = -1
        for earlier_index, earlier in enumerate(rules):
            same = earlier.algorithm == algorithm and earlier.start == start
            # Both ends count from the start, or this one lies behind the payload: the earlier range is inside.
            inside = not earlier.stop.from_end and (stop.from_end or earlier.stop.offset <= stop.offset)
            if same and inside:
                continues = earlier_index
        rules.append(
            CheckRule(algorithm, start, stop, start_of(index), part.size, part.order, part.shift, continues)
        )
    return Layout(
        prefix=prefix,
        suffix=suffix,
        payload=payload.payload,
        fixed_payload=payload.fixed_payload,
        length=length,
        length_unit=1,
        length_bias=length_bias,
        id=message_id,
        constants=tuple(before + after),
        prefix_constants=len(before),
        checks=tuple(rules),
        header_checks=sum(1 for late, _, _ in checks if not late),
    )
