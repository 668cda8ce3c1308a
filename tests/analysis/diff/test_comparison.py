"""The sentences of `wirebond diff`, and its exit codes."""

from __future__ import annotations

import itertools
import json
import random
from pathlib import Path

import pytest

from wirebond.analysis.diff import Change, Verdict, compare
from wirebond.cli.main import main
from wirebond.protocol import End, load, loads, protocol_hash

FOLDER = Path(__file__).parents[3] / "protocols"
PROTOCOLS = sorted([*FOLDER.glob("*.yaml"), *(FOLDER / "contrib").glob("*.yaml")])
FRAME = "[magic: 0xA5, length: u8, id: u8, payload: by_length, check: crc-16/modbus]"
BASE = f"""
wirebond: 1
protocol: robot
link: {{baud: 115200, stop_bits: 2}}
frame: {FRAME}
max_payload: 8
messages:
  drive: {{id: 1, sender: host, every: 100 ms, fields: {{speed: {{type: i16, unit: m/s, scale: 0.001}}}}}}
  state: {{id: 2, sender: mcu, every: 1 s, fields: {{volt: {{type: u16, description: of the battery}}}}}}
  ask:   {{id: 3, sender: host, reply: state}}
  ping:  {{id: 4, sender: host, reply: pong, fields: {{number: {{type: u8}}}}}}
  pong:  {{id: 5, sender: mcu, fields: {{number: {{type: u8}}}}}}
deadlines:
  - {{message: drive, at: mcu, after: 500 ms, then: stop}}
services: {{ping: {{request: ping, reply: pong}}}}
emergency_stop: {{message: drive, speed: 0}}
"""


def changes(old: str, new: str) -> list[Change]:
    assert old in BASE
    return list(compare(loads(BASE), loads(BASE.replace(old, new, 1))).changes)


def told(old: str, new: str) -> dict[str, str]:
    """Return the sentence of the only change, and each effect by its direction."""
    [change] = changes(old, new)
    rows = {"": f"{change.verdict}: {change.what}: {change.sentence}"}
    return rows | {str(e.flow): ("breaks: " if e.breaks else "") + e.sentence for e in change.effects}


def test_a_scale_is_explained_by_a_value() -> None:
    assert told("scale: 0.001", "scale: 0.01") == {
        "": "breaks: drive.speed: scale 0.001 became 0.01",
        "new host to old MCU": "breaks: 1 m/s arrives as 0.1 m/s",
        "old host to new MCU": "breaks: 1 m/s arrives as 10 m/s",
    }


def test_another_unit_is_another_quantity() -> None:
    same = "the same number means another quantity there; if only the spelling was corrected, nothing breaks"
    assert told("unit: m/s", "unit: km/h") == {
        "": "breaks: drive.speed: unit m/s became km/h",
        "new host to old MCU": f"breaks: {same}",
        "old host to new MCU": f"breaks: {same}",
    }
    assert {change.verdict for change in changes("unit: m/s, ", "")} == {Verdict.COMPATIBLE}


def test_a_stop_that_the_other_end_does_not_know_breaks() -> None:
    """A new message can wait until both ends know it; a stop cannot."""
    with_halt = BASE.replace("  ask: ", "  halt: {id: 6, sender: host}\n  ask: ").replace(
        "{message: drive, speed: 0}", "{message: halt}"
    )
    found = [change for change in compare(loads(BASE), loads(with_halt)).changes if change.what == "emergency_stop"]
    assert [str(change.verdict) for change in found] == ["breaks"]
    assert [(str(e.flow), e.sentence) for e in found[0].effects] == [
        ("new host to old MCU", "the old MCU does not know halt, and moves on")
    ]
    renamed = BASE.replace("  drive:", "  travel:").replace("message: drive", "message: travel")
    assert not [c for c in compare(loads(BASE), loads(renamed)).changes if c.what == "emergency_stop" and c.effects]


def test_a_slower_sender_breaks_the_old_deadline() -> None:
    with_longer = BASE.replace("every: 100 ms", "every: 600 ms").replace("after: 500 ms", "after: 2 s")
    found = compare(loads(BASE), loads(with_longer))
    assert [c.sentence for c in found.changes if c.verdict == Verdict.BREAKS] == ["every 100 ms became 600 ms"]
    assert not found.works(End.HOST)
    assert found.works(End.MCU)


def test_a_shorter_deadline_breaks_with_the_old_sender() -> None:
    quick = BASE.replace("every: 100 ms", "every: 20 ms").replace("after: 500 ms", "after: 80 ms")
    found = compare(loads(BASE), loads(quick))
    assert found.works(End.HOST)
    assert not found.works(End.MCU)


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("every: 1 s", "every: 2 s", "state: every 1 s became 2 s"),
        ("of the battery", "at the motor", "state.volt: has another description"),
        ("protocol: robot", "protocol: rover", "protocol: robot became rover: generated code has other names"),
        ("speed: 0}", "speed: 0.1}", "emergency_stop: has other messages, values or header fields"),
        ("after: 500 ms", "after: 700 ms", "deadline of drive: after 500 ms became 700 ms"),
        ("{message: drive, at: mcu", "{message: ask, at: mcu", ""),
        (
            "stop_bits: 2}",
            "stop_bits: 2, echo: true}",
            "link: an end does not hear its own bytes became: an end hears its own bytes",
        ),
        ("services", "idle: 1 s\nservices", "idle: none became 1 s"),
    ],
)
def test_changes_of_no_byte_are_harmless(old: str, new: str, what: str) -> None:
    found = changes(old, new)
    assert {change.verdict for change in found} == {Verdict.HARMLESS}
    assert not what or [f"{change.what}: {change.sentence}" for change in found] == [what]


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("baud: 115200", "baud: 57600", "baud 115200 became 57600"),
        ("stop_bits: 2", "stop_bits: 1", "stop_bits 2 became 1"),
        ("services: {ping: {request: ping, reply: pong}}", "", "is gone"),
        ("reply: state", "reply: pong", "reply state became pong"),
        ("  ask:   {id: 3, sender: host, reply: state}\n", "", "is gone"),
        ("ask:   {id: 3,", "demand: {id: 3, fields: {x: {type: u8}},", "is new, from the host"),
        ("id: u8", "id: u16", "`id: u8` became `id: u16`"),
        ("length: u8", "length: {type: u8, counts: rest}", "`length: u8` became `length: {type: u8, counts: rest}`"),
        (
            FRAME,
            "[id: u8, payload: rest, check: crc-16/modbus, delimiter: 0x0A]",
            "frames without delimiters became frames in 0x0A",
        ),
    ],
)
def test_changes_that_an_old_end_misreads_are_breaking(old: str, new: str, sentence: str) -> None:
    assert sentence in [change.sentence for change in changes(old, new) if change.verdict == Verdict.BREAKS]


ADDRESSED = BASE.replace("magic: 0xA5,", "magic: 0xA5, {field: arm, type: u8, default: 1},").replace(
    "default: 1}", "default: 1, address: mcu, broadcast: 0xFE}"
)
NUMBERED = BASE.replace("magic: 0xA5,", "magic: 0xA5, {sequence: u8},")


@pytest.mark.parametrize(
    ("base", "old", "new", "effects"),
    [
        (
            ADDRESSED,
            "default: 1,",
            "default: 2,",
            {
                "new host to old MCU": "breaks: its frames are for address 2, and the MCU listens to 1",
                "new MCU to old host": "breaks: its replies come from address 2, and the host asks 1",
                "old host to new MCU": "breaks: its frames are for address 1, and the MCU listens to 2",
                "old MCU to new host": "breaks: its replies come from address 1, and the host asks 2",
            },
        ),
        (
            ADDRESSED,
            ", address: mcu, broadcast: 0xFE",
            "",
            {"old host to new MCU": "breaks: the MCU acts on frames for every address"},
        ),
        (
            ADDRESSED,
            ", broadcast: 0xFE",
            "",
            {"old host to new MCU": "breaks: the MCU takes a broadcast to 254 for a frame for another"},
        ),
        (
            ADDRESSED,
            "broadcast: 0xFE",
            "broadcast: [0xFE, 0xFF]",
            {"new host to old MCU": "breaks: the MCU takes a broadcast to 255 for a frame for another"},
        ),
        (
            ADDRESSED,
            "broadcast: 0xFE",
            "broadcast: [0xFE, 2]",
            {"new host to old MCU": "breaks: the MCU takes a broadcast to 2 for a frame for another"},
        ),
        (
            ADDRESSED,
            "address: mcu, broadcast: 0xFE",
            "address: sender",
            {"old host to new MCU": "breaks: the MCU acts on frames for every address"},
        ),
        (
            NUMBERED,
            "{sequence: u8}",
            "{sequence: u8, per: message}",
            {
                "new host to old MCU": "the numbers count each message, so the old MCU counts gaps, repeats and "
                "restarts that are none",
                "new MCU to old host": "the numbers count each message, so the old host counts gaps, repeats and "
                "restarts that are none",
                "old host to new MCU": "the numbers count all messages together, so the new MCU counts gaps, repeats "
                "and restarts that are none",
                "old MCU to new host": "the numbers count all messages together, so the new host counts gaps, repeats "
                "and restarts that are none",
            },
        ),
        (
            NUMBERED,
            "{sequence: u8}",
            "{reserved: 1}",
            {
                "new host to old MCU": "the old MCU counts repeats and gaps in numbers that are not raised there",
                "new MCU to old host": "the old host counts repeats and gaps in numbers that are not raised there",
            },
        ),
    ],
)
def test_addresses_and_sequence_numbers(base: str, old: str, new: str, effects: dict[str, str]) -> None:
    assert old in base
    [change] = compare(loads(base), loads(base.replace(old, new, 1))).changes
    told = {str(e.flow): ("breaks: " if e.breaks else "") + e.sentence for e in change.effects}
    assert told == effects


def test_a_new_message_is_compatible_and_a_new_deadline_on_it_is_not() -> None:
    more = BASE.replace("  pong:", "  lamp: {id: 9, sender: host}\n  pong:")
    assert compare(loads(BASE), loads(more)).works(End.MCU)
    watched = more.replace("services", "  - {message: lamp, at: mcu, after: 1 s, then: stop}\nservices")
    assert not compare(loads(BASE), loads(watched)).works(End.MCU)
    assert compare(loads(BASE), loads(watched)).works(End.HOST)


@pytest.mark.parametrize("pairs", [60, pytest.param(10_000, marks=pytest.mark.long)])
def test_a_file_does_not_differ_from_itself_and_another_hash_is_never_harmless(pairs: int) -> None:
    models = [load(path) for path in PROTOCOLS]
    for model in models:
        assert not compare(model, model).changes
    every_pair = list(itertools.permutations(models, 2))
    for one, other in random.Random(1).sample(every_pair, min(pairs, len(every_pair))):
        found = compare(one, other)
        if protocol_hash(one) != protocol_hash(other):
            assert any(change.verdict != Verdict.HARMLESS for change in found.changes), (one.path, other.path)


def test_exit_codes_and_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    old, new, wrong = (tmp_path / name for name in ("old.yaml", "new.yaml", "wrong.yaml"))
    old.write_text(BASE)
    new.write_text(BASE.replace("{type: u16,", "{type: u16, scale: 0.1,").replace("every: 1 s", "every: 2 s"))
    wrong.write_text("wirebond: 1\n")
    assert main(["diff", str(old), str(old)]) == 0
    assert capsys.readouterr().out.splitlines()[0] == f"{old} to {old}: no change"
    assert main(["diff", str(old), str(new), "--json"]) == 1
    facts = json.loads(capsys.readouterr().out)
    assert (facts["ok"], facts["works"]) == (False, {"new_host_with_old_mcu": False, "new_mcu_with_old_host": False})
    assert facts["hash"]["old"] != facts["hash"]["new"]
    assert [(c["verdict"], c["what"], c["line"]) for c in facts["changes"]] == [
        ("breaks", "state.volt", 9),
        ("harmless", "state", 9),
    ]
    assert main(["diff", str(old), str(wrong)]) == 1
    assert "wrong.yaml:1:1" in capsys.readouterr().err
    assert main(["diff", str(old), str(wrong), "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["problems"]
    assert main(["diff", str(old), str(new), "--updated", "both"]) == 2


def test_one_end_may_be_the_first_to_change(tmp_path: Path) -> None:
    old, new = tmp_path / "old.yaml", tmp_path / "new.yaml"
    old.write_text(BASE)
    new.write_text(BASE.replace("of the battery}", "of the battery}, more: {type: u8}"))
    assert main(["diff", str(old), str(new), "--updated", "mcu"]) == 0  # the old host ignores it
    assert main(["diff", str(old), str(new), "--updated", "host"]) == 1  # the old MCU's frames are too short
    assert main(["diff", str(old), str(new)]) == 1


WITH_HEADER = """
wirebond: 1
protocol: bus
frame:
  - magic: {host: 0xA5, mcu: {any: [0xA6, 0xA7]}}
  - {field: servo, type: u8, default: 1, address: mcu}
  - {field: mode, type: u8, enum: {off: 0, on: 1}}
  - {field: heat, type: i8, scale: 0.5, unit: °C}
  - bits: u8
    fields: {parts: {bits: 4, flags: {route: 0, stamp: 1}}, rest: 4}
  - length: u8
  - id: u8
  - {reserved: 2, name: route, when: parts & 0x01}
  - payload: by_length
  - check: xor8
messages:
  ask: {id: 1, sender: host, match: {kind: 1}, fields: {kind: {type: u8}}}
  answer: {id: 1, sender: mcu, fields: {spare: {type: padding, size: 1, must_be_zero: true}}}
"""


def header_rows(old: str, new: str) -> dict[str, str]:
    assert old in WITH_HEADER
    found = compare(loads(WITH_HEADER), loads(WITH_HEADER.replace(old, new, 1))).changes
    rows: dict[str, str] = {}
    for change in found:
        rows[f"{change.what}: {change.sentence}"] = change.verdict.value
        rows |= {f"{change.what} {e.flow}": ("breaks: " if e.breaks else "") + e.sentence for e in change.effects}
    return rows


@pytest.mark.parametrize(
    ("old", "new", "where", "sentence"),
    [
        ("{off: 0, on: 1}", "{off: 1, on: 0}", "header mode = off", "off arrives as on"),
        ("route: 0, stamp: 1", "route: 1, stamp: 0", "header parts = route", "route arrives as stamp"),
        ("scale: 0.5", "scale: 0.25", "header heat", "1 °C arrives as 0.5 °C"),
        ("type: i8", "type: u8", "header heat", "numbers outside 0 to 127 on the wire are read as others"),
        ("unit: °C", "unit: K", "header heat", "the same number means another quantity there; if only the spelling was "
         "corrected, nothing breaks"),
        ("{field: mode, type: u8, enum: {off: 0, on: 1}}\n  - {field: heat, type: i8, scale: 0.5, unit: °C}",
         "{field: heat, type: i8, scale: 0.5, unit: °C}\n  - {field: mode, type: u8, enum: {off: 0, on: 1}}", "frame",
         "its mode is read as heat"),
    ],
)  # fmt: skip
def test_the_meaning_of_header_fields_is_compared(old: str, new: str, where: str, sentence: str) -> None:
    assert header_rows(old, new)[f"{where} old host to new MCU"] == f"breaks: {sentence}"


def test_a_form_that_header_values_ask_for_cannot_go() -> None:
    lost = "its frames with other header values than the defaults are not found, or are read at other places"
    rows = header_rows("reserved: 2", "reserved: 1")
    assert rows["frame old host to new MCU"] == f"breaks: {lost}"
    rows = header_rows("0xA7", "0xA8")
    assert rows["frame old MCU to new host"] == f"breaks: {lost}"
    assert rows["frame new MCU to old host"] == lost  # a program need not send it before the host knows it
    assert "frame old host to new MCU" not in rows


def test_one_byte_has_no_byte_order() -> None:
    assert header_rows("protocol: bus", "protocol: bus\nbyte_order: big") == {}
