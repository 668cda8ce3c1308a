"""The effects that `wirebond diff` names do happen: frames of one file are decoded with the other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pytest

from wirebond.analysis.diff import Flow, compare
from wirebond.codec import Codec
from wirebond.protocol import End, Message, Protocol, loads

BASE = """
wirebond: 1
protocol: robot
frame:
  - magic: 0xAA 0x55
  - reserved: 1
  - {field: station, type: u8, default: 1}
  - length: u8
  - id: u8
  - payload: by_length
  - check: crc-16/modbus
max_payload: 40
messages:
  drive:
    id: 1
    sender: host
    fields:
      speed: {type: i16, unit: m/s, scale: 0.001, range: [-2, 2]}
      turn:  {type: u16, scale: 0.01}
      mode:  {type: u8, enum: {off: 0, slow: 1, fast: 2}}
      spare: {type: padding, size: 2}
      level: {type: u8}
  state:
    id: 2
    sender: mcu
    fields:
      volt:  {type: u16, scale: 0.1}
      bits:  {bits: {type: u8, fields: {hot: {type: bool}, gear: {type: u3}}}}
      flags: {type: u8, flags: {low: 0, high: 1}}
      count: {type: u8}
      items: {type: u8, count: count, max: 4}
"""
WIDE = BASE.replace("items: {type: u8", "items: {type: u16")
SPEED, TURN = (line.strip() for line in BASE.splitlines() if line.strip().startswith(("speed:", "turn:")))
LEVEL = "level: {type: u8}"
VALUES = {
    "drive": {"speed": 1, "turn": 0.5, "mode": "slow", "level": 7},
    "state": {"volt": 12, "bits": {"hot": True, "gear": 5}, "flags": ["low"], "items": [1, 2, 3, 4]},
}
HOST_NEW, MCU_OLD = Flow(End.HOST, from_new=True), Flow(End.MCU, from_new=False)
HOST_OLD, MCU_NEW = Flow(End.HOST, from_new=False), Flow(End.MCU, from_new=True)
FROM_HOST, FROM_MCU = {HOST_NEW, HOST_OLD}, {MCU_NEW, MCU_OLD}
ALL = FROM_HOST | FROM_MCU


@dataclass(frozen=True)
class Case:
    name: str
    old: str
    new: str
    breaks: set[Flow]
    base: str = BASE


def weak(text: str) -> str:
    return text.replace("crc-16/modbus", "sum8")


CASES = [
    Case("nothing", "", "", set()),
    Case("a scale", "scale: 0.001", "scale: 0.01", FROM_HOST),
    Case("an offset", "scale: 0.1}", "scale: 0.1, offset: 5}", FROM_MCU),
    Case("a wider type", "turn:  {type: u16", "turn:  {type: u32", FROM_HOST),
    Case("a byte order", "turn:  {type: u16", "turn:  {type: u16be", FROM_HOST),
    Case("a range", "range: [-2, 2]", "range: [-1, 1]", set()),
    Case("an enum value more", "fast: 2", "fast: 2, turbo: 3", set()),
    Case("an enum value that moved", "slow: 1, fast: 2", "slow: 2, fast: 1", FROM_HOST),
    Case("an enum value less", "slow: 1, fast: 2", "fast: 2", {HOST_OLD}),
    Case("a flag that moved", "low: 0, high: 1", "low: 1, high: 0", FROM_MCU),
    Case("a bit field that grew", "gear: {type: u3}", "gear: {type: u4}", set()),
    Case("a bit field that shrank", "gear: {type: u3}", "gear: {type: u2}", {MCU_OLD}),
    Case("a bit field that moved", "hot: {type: bool}, gear: {type: u3}", "gear: {type: u3}, hot: {type: bool}",
         FROM_MCU),
    Case("a bit field more", "gear: {type: u3}", "gear: {type: u3}, cold: {type: bool}", set()),
    Case("a value where padding was", "spare: {type: padding, size: 2}", "spare: {type: u16, default: 3}", set()),
    Case("padding where a value was", "turn:  {type: u16, scale: 0.01}", "turn: {type: padding, size: 2}",
         {HOST_NEW}),
    Case("padding that must be zero", "padding, size: 2", "padding, size: 2, must_be_zero: true", set()),
    Case("padding that became a constant", "{type: padding, size: 2}", "{type: u16, constant: 7}", {HOST_OLD}),
    Case("a field at the end", LEVEL, LEVEL + "\n      more: {type: u8, default: 1}", {HOST_OLD}),
    Case("the last field gone", "      level: {type: u8}\n", "", {HOST_NEW}),
    Case("a field in the middle", "      mode:", "      more: {type: u8, default: 1}\n      mode:", FROM_HOST),
    Case("a longer list", "max: 4", "max: 6", set()),
    Case("a shorter list", "max: 4", "max: 3", {MCU_OLD}),
    Case("a text's end", "ends_with: 0x00", "ends_with: 0x0D", FROM_HOST,
         BASE.replace("      level:", "      name: {type: text, max: 4, ends_with: 0x00}\n      level:")),
    Case("an id", "id: 1\n", "id: 3\n", FROM_HOST),
    Case("a match that the default has not", "id: 1\n", "id: 1\n    match: {station: 2}\n", {HOST_OLD}),
    Case("a match of its only size", "id: 1\n", "id: 1\n    match: {size: 8}\n", set()),
    Case("a message's new name", "  drive:", "  go:", set()),
    Case("a field's new name", "turn: ", "turning: ", set()),
    Case("two fields swapped", f"{SPEED}\n      {TURN}", f"{TURN}\n      {SPEED}", FROM_HOST),
    Case("a check", "crc-16/modbus", "crc-16/xmodem", ALL),
    Case("a magic", "0xAA 0x55", "0xAA 0x56", ALL),
    Case("a second magic", "magic: 0xAA 0x55", "magic: {any: [0xAA 0x55, 0xAA 0x66]}", set()),
    Case("another first magic", "magic: 0xAA 0x55", "magic: {any: [0xAA 0x66, 0xAA 0x55]}", {HOST_NEW, MCU_NEW}),
    Case("a header field's default", "default: 1}", "default: 2}", set()),
    Case("a header field where zeros were", "- reserved: 1", "- {field: seen, type: u8}", set()),
    Case("a reserved byte more", "- reserved: 1", "- reserved: 2", ALL),
    Case("what the length counts", "length: u8", "length: {type: u8, counts: rest}", ALL),
    Case("a sender of both", "id: 1\n    sender: host", "id: 1\n    sender: both", set()),
    Case("a smaller max_payload", "max_payload: 40", "max_payload: 10", set()),
    Case("a field at the end, weak check", LEVEL, LEVEL + "\n      more: {type: u8, default: 1}",
         FROM_HOST, weak(BASE)),
    Case("a count of elements of one byte tells bytes", "count: count", "count: {bytes: count}", set()),
    Case("a count tells bytes", "count: count", "count: {bytes: count}", FROM_MCU, WIDE),
    Case("a second count, of bytes", "items: {type: u16, count: count", "size: {type: u8}\n      "
         "items: {type: u16, count: {elements: count, bytes: size}", FROM_MCU, WIDE),
    Case("a field behind a list", "max: 4}", "max: 4}\n      more: {type: u8, default: 1}", {MCU_OLD}),
]  # fmt: skip


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_says_what_happens(case: Case) -> None:
    assert case.old in case.base
    old, new = loads(case.base), loads(case.base.replace(case.old, case.new, 1) if case.old else case.base)
    found = compare(old, new)
    told = {effect.flow for change in found.changes for effect in change.effects if effect.breaks}
    assert told == case.breaks
    happened = {flow for flow in ALL if _is_lost(old, new, flow)}
    assert happened == case.breaks


def _is_lost(old: Protocol, new: Protocol, flow: Flow) -> bool:
    """Does a frame of the one file reach the other otherwise than it was sent?"""
    sender, receiver = (Codec(model) for model in ((new, old) if flow.from_new else (old, new)))
    for message in sender.model.messages:
        base = "state" if message.name == "state" else "drive"
        if not message.sent_by(flow.sender) or (base == "drive" and flow.sender == End.MCU):
            continue  # a second sender is new, and can wait
        values = _values(message, VALUES[base])
        decoder = receiver.decoder(flow.sender)
        frame = sender.encode(message.name, values, sender=flow.sender)
        got = [*decoder.feed(frame), *decoder.finish()]
        if [m.name for m in got] == ["unknown"] or len(got) != 1 or got[0].violations:
            return True
        sent, read = ({_NAMES.get(n, n): v for n, v in one.items()} for one in (values, got[0].fields))
        for name in VALUES[base].keys() & read.keys():
            if name not in sent or not _same(read[name], sent[name]):
                return True
    return False


_NAMES = {"turning": "turn"}


def _values(message: Message, known: dict[str, Any]) -> dict[str, Any]:
    """Return values for the fields that both files have; fields that are new to the sender keep their defaults."""
    values: dict[str, Any] = {}
    for field in message.fields:
        name = _NAMES.get(field.name, field.name)
        if name not in known or not field.has_value:
            continue
        values[field.name] = known[name]
        if name == "mode" and "slow" not in dict(field.enum):
            values[name] = "fast"
        if name == "items":
            values[name] = known[name][: field.max_count]
        if name == "bits":
            widths = {f.name: f.width for f in field.fields}
            values[name] = {n: min(known[name].get(n, 0), 2**width - 1) for n, width in widths.items()}
    return values


def _same(read: Any, sent: Any) -> bool:
    if isinstance(sent, dict) and isinstance(read, dict):
        return all(read[name] == value for name, value in sent.items() if name in read)
    return read == pytest.approx(sent)


def test_ids_that_a_message_gained_or_lost_break_the_end_that_does_not_know_them() -> None:
    several = BASE.replace("id: 1\n", "id: 0x01..0x05\n")
    matched = BASE.replace("id: 1\n", "id: 1\n    match: {station: 1..3}\n")
    fewer = BASE.replace("id: 1\n", "id: [1, 3]\n")
    for old, new, breaks, sentence in (
        (BASE, several, {HOST_NEW}, "id 0x01 became 0x01..0x05"),
        (several, BASE, {HOST_OLD}, "id 0x01..0x05 became 0x01"),
        (several, fewer, {HOST_OLD}, "id 0x01..0x05 became 0x01, 0x03"),
        (several, several, set(), ""),
        (matched, BASE, {HOST_NEW}, "id 0x01 with station 1..3 became 0x01"),
    ):
        changes = compare(loads(old), loads(new)).changes
        assert {e.flow for change in changes for e in change.effects if e.breaks} == breaks
        assert not sentence or any(sentence in str(change) for change in changes), changes
