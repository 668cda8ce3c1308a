"""Frames whose checks hold and which no message is: `match` or a size is named as the rule that failed."""

from __future__ import annotations

import pytest

from wirebond.analysis.checksum import checksum
from wirebond.analysis.explain import explain
from wirebond.analysis.explain.report import Stretch
from wirebond.protocol import loads
from wirebond.protocol.algorithms import ALGORITHMS
from wirebond.protocol.model import End

BY_NUMBER = """
  stop: {id: 3, sender: host, match: {command: 1}, fields: {command: {type: u8}}}
  run: {id: 3, sender: host, match: {command: [2, 5..9]}, fields: {command: {type: u8}, speed: {type: i16}}}
"""
BY_SIZE = """
  ask: {id: 2, sender: host, match: {size: 2}, fields: {item: {type: u16}}}
  set: {id: 2, sender: host, match: {size: 4}, fields: {item: {type: u16}, value: {type: u16}}}
"""
BY_HEADER = """
  read: {id: 1, sender: host, match: {kind: 0}, fields: {index: {type: u8}}}
  write: {id: 1, sender: host, match: {kind: 1}, fields: {value: {type: u16}}}
"""
LENGTH = "[magic: 0xA5, length: u8, id: u8, payload: by_length, check: crc-8/smbus]"
KIND = "[{magic: 0xA5}, {field: kind, type: u8}, {id: u8}, {payload: by_id}, {check: crc-8/smbus}]"
FIXED = "[magic: 0xA5, id: u8, payload: 4, check: crc-8/smbus]"


def explained(frame: str, messages: str, body: str) -> Stretch:
    model = loads(f"wirebond: 1\nprotocol: demo\nframe: {frame}\nmessages:\n{messages}")
    data = bytes.fromhex(body)
    data += bytes([checksum(ALGORITHMS["crc-8/smbus"], data)])
    (stretch,) = explain(model, data, End.HOST).stretches
    return stretch


@pytest.mark.parametrize(
    ("frame", "messages", "body", "summary"),
    [
        (LENGTH, BY_NUMBER, "A5 03 03 04 01 00",
         "match: expected stop (command 1), run (command 2, 5..9), found command 4"),
        (LENGTH, BY_NUMBER, "A5 00 03",
         "match: expected stop (command 1), run (command 2, 5..9), found no command"),
        (
            LENGTH,
            BY_SIZE,
            "A5 03 02 04 01 00",
            "match: expected ask (payload size 2), set (payload size 4), found payload size 3",
        ),
        (KIND, BY_HEADER, "A5 05 01 09", "match: expected read (kind 0), write (kind 1), found kind 5"),
    ],
)  # fmt: skip
def test_a_match_that_fails_is_the_rule_that_is_named(frame: str, messages: str, body: str, summary: str) -> None:
    stretch = explained(frame, messages, body)
    assert (stretch.cause, stretch.summary) == ("unknown_message", summary)
    assert [(rule.rule, rule.holds) for rule in stretch.rules][-2:] == [("id", True), ("match", False)]
    names = " and ".join(line.split(":")[0].strip() for line in messages.strip().splitlines())
    (guess,) = stretch.guesses
    assert guess.what.startswith("Everything holds, but of the messages with the id 0x0")
    assert guess.remedy == f"Compare the `match` of {names} with the sender's code."


def test_a_size_beyond_all_messages_of_the_id_gives_no_advice_to_add_one() -> None:
    stretch = explained(LENGTH, BY_SIZE, "A5 09 02" + "00" * 9)
    assert stretch.summary == "length: expected 0 to 4, found 9"
    assert [guess.remedy for guess in stretch.guesses] == ["Compare the `match` of ask and set with the sender's code."]


def test_a_payload_that_the_frame_cannot_have_gives_no_advice_to_change_the_check() -> None:
    stretch = explained(FIXED, "  a: {id: 1, sender: host, fields: {x: {type: u32}}}\n", "A5 01 01 02 03 04 05 06")
    (guess,) = stretch.guesses
    assert guess.what == (
        "Everything holds if the payload has 6 bytes, not 4: the frames are 2 bytes longer than the file says."
    )
    assert guess.remedy == "Write `- payload: 6`, and compare the fields of a with the sender's code."


def test_an_id_that_no_message_has_is_still_the_rule_that_fails() -> None:
    stretch = explained(LENGTH, BY_NUMBER, "A5 01 09 04")
    assert stretch.summary == "id: expected the id of a known message, found 0x09"
    assert [guess.remedy for guess in stretch.guesses] == [
        "Add a message with `id: 0x09` and `sender: host` to the file."
    ]
