"""Generates the C++ that distinguishes messages by more than their ids, for receivers and for checks of the sender."""

from __future__ import annotations

from wirebond.generate.code.cpp_field import bool_literal
from wirebond.protocol.model import End, MatchOf, Message, Protocol
from wirebond.protocol.plan import MatchTest, MessageRow
from wirebond.protocol.planning import plan_for


def _asked(test: MatchTest) -> str:
    """Return a test as a question to a frame (``wirebond/match.hpp``)."""
    bounds = f"0x{test.mask:X}U, 0x{test.low:X}U, 0x{test.high:X}U"
    if test.of == MatchOf.HEADER:
        return f"asked.header({test.place}, {bounds})"
    if test.of == MatchOf.PAYLOAD:
        return f"asked.payload({test.at}, {test.bytes}, wirebond::ByteOrder::{test.order}, {test.shift}, {bounds})"
    return f"asked.{test.of}({bounds})"


def _groups(tests: tuple[MatchTest, ...]) -> list[list[MatchTest]]:
    """Group tests that are joined by ``or_next``."""
    groups: list[list[MatchTest]] = []
    joins = False
    for test in tests:
        if joins:
            groups[-1].append(test)
        else:
            groups.append([test])
        joins = test.or_next
    return groups


def match_lines(row: MessageRow) -> list[str]:
    """Return the condition that a frame is this message, one line for each that must hold."""
    expected = [f"expected == {row.index}"] if row.only_expected else []
    texts = []
    for group in _groups(row.tests):
        text = " || ".join(_asked(test) for test in group)
        texts.append(text if len(group) == 1 else f"({text})")
    return [*expected, *texts] or ["true"]


def sent_tests(protocol: Protocol, message: Message) -> tuple[str, ...]:
    """Return the tests that say something to a sender: of header fields, and of what a value of the message can
    break."""
    plan = plan_for(protocol, End.HOST if message.sent_by(End.HOST) else End.MCU)
    row = next(row for row in plan.messages if protocol.messages[row.index] is message)
    found: list[str] = []
    for group in _groups(row.tests):
        of, is_one = group[0].of, group[0].is_one
        says_nothing = {
            MatchOf.ID: plan.id_place is None or not message.has_id,
            MatchOf.HEADER: False,
            MatchOf.PAYLOAD: is_one,  # a constant of the payload
            MatchOf.SIZE: message.min_payload == message.max_payload,
        }[of]
        for test in () if says_nothing else group:
            place = plan.id_place if of == MatchOf.ID else test.place
            numbers = f"{test.bytes}, wirebond::ByteOrder::{test.order}, {test.shift}, {test.at}"
            bounds = f"0x{test.mask:X}U, 0x{test.low:X}U, 0x{test.high:X}U"
            joined = f"{bool_literal(test.or_next)}, {bool_literal(is_one)}"
            found.append(f"{{wirebond::MatchOf::{of}, {place}, {joined}, {numbers}, {bounds}}}")
    return tuple(found)
