"""The rules that read the file alone, and the two that measure little: each finds its case and stays silent else."""

from __future__ import annotations

import dataclasses

import pytest
from tests.analysis.check.files import DEFAULT_FRAME, made, rules, shipped

from wirebond.analysis.check import (
    cut_frames,
    given,
    identity,
    line_budget,
    schedule,
    shared_line,
    stuffing,
    urgent_wait,
)
from wirebond.analysis.check.findings import Finding, Severity
from wirebond.analysis.check.places import Places
from wirebond.analysis.check.wording import percent
from wirebond.protocol.model import End, Protocol

NOWHERE = Places()
DRIVE = "{drive: {id: 1, sender: host, every: 50 ms, fields: {speed: {type: i16}}}}"
STOP = "emergency_stop: {message: drive, speed: 0}"


def waits(model: Protocol) -> list[Finding]:
    directions = line_budget.budgets(model, line_budget.scheduled_loads(model))
    return urgent_wait.assess(model, [urgent_wait.urgent_wait(model, budget) for budget in directions], NOWHERE)


# ---- an urgent frame


def test_an_urgent_frame_waits_for_one_millisecond_of_line_or_the_longest_frame() -> None:
    fast, slow = shipped("native").model, shipped("pid_tuner").model
    for model, expected in ((fast, 0.001), (slow, 18 * 10 / 115200)):
        directions = line_budget.budgets(model, [])
        assert urgent_wait.urgent_wait(model, directions[0]).seconds == pytest.approx(expected)
        assert waits(model) == []


@pytest.mark.parametrize(("max_run", "expected"), [("500 us", 0.0005), ("5 ms", 0.005), ("20 us", 11 * 10 / 921600)])
def test_an_urgent_frame_of_the_mcu_waits_for_a_run_that_was_begun(max_run: str, expected: float) -> None:
    """As long as the file lets a run be, or the longest frame if that takes longer."""
    messages = "{state: {id: 1, sender: mcu, queue: urgent, fields: {x: {type: u16, count: 2}}}}"
    frame = "[magic: 0xAA 0x55, length: u8, id: u8, payload: by_length, check: crc-16/modbus, tail: 0x0D]"
    model = made(frame, messages, baud=921600, max_run=max_run).model
    (of_mcu,) = [each for each in line_budget.budgets(model, []) if each.sender == End.MCU]
    assert urgent_wait.urgent_wait(model, of_mcu).seconds == pytest.approx(expected)


def test_a_run_that_is_longer_than_a_period_is_a_warning() -> None:
    messages = "{fast: {id: 1, sender: mcu, every: 4 ms, fields: {x: {type: i16}}}}"
    (finding,) = waits(made(DEFAULT_FRAME, messages, max_run="5 ms").model)
    assert "waits up to 5 ms after the frames of a run" in finding.sentence
    assert finding.remedy == "lower `link: max_run`"
    assert waits(made(DEFAULT_FRAME, messages, max_run="4 ms").model) == []


def test_a_long_frame_in_the_way_of_a_fast_one_is_a_warning() -> None:
    messages = (
        "{fast: {id: 1, sender: mcu, every: 10 ms, fields: {x: {type: i16}}}, "
        "dump: {id: 2, sender: mcu, fields: {rows: {type: bytes, max: 240}}}}"
    )
    finding = waits(made(DEFAULT_FRAME, messages).model)[0]
    assert (finding.rule, finding.severity) == ("urgent-wait", Severity.WARNING)
    assert "waits up to 21.3 ms after `dump`" in finding.sentence
    assert "`fast` is due every 10 ms" in finding.reason


# ---- an inserted zero


@pytest.mark.parametrize(("check", "share"), [("crc-16/xmodem", 1), ("crc-16/mcrf4xx", 0.5), ("crc-16/ibm-sdlc", 0)])
def test_a_crc_without_final_xor_accepts_an_inserted_zero(check: str, share: float) -> None:
    # A register that begins with zero does not see one in front either.
    order = ", byte_order: big" if check == "crc-16/xmodem" else ""
    parts = f"id: u8, payload: rest, check: {{type: {check}{order}}}"
    frame = f"[delimiter: 0x00, cobs: [{parts}], delimiter: 0x00]"
    codec = made(frame)
    measured = stuffing.measure_inserted_zero(codec, 1)
    assert measured is not None
    assert measured.any_size.share == pytest.approx(share, abs=0.01)
    assert measured.own.accepted == 0  # every payload has two bytes, and the file bounds them by that
    roomy = stuffing.measure_inserted_zero(made(frame, rest="max_payload: 8"), 1)
    assert roomy is not None
    assert roomy.own == roomy.any_size == measured.any_size
    found = stuffing.assess(codec.model, measured, NOWHERE)
    if share:
        assert (found[0].rule, found[0].severity) == ("inserted-zero", Severity.WARNING)
        assert f"with {check} {percent(share)} of frames pass after a zero byte was inserted" in found[0].sentence
    else:
        assert found == []


def test_frames_without_stuffing_have_no_such_figure() -> None:
    assert stuffing.measure_inserted_zero(shipped("enterprize"), 1) is None


# ---- deadlines


def deadlines(after: str, message: str = DRIVE) -> list[Finding]:
    rest = f"deadlines: [{{message: drive, at: mcu, after: {after}, then: stop}}]"
    return schedule.assess_deadlines(made(DEFAULT_FRAME, message, rest).model, NOWHERE)


def test_a_deadline_that_one_lost_frame_trips_is_a_warning() -> None:
    finding = deadlines("80 ms")[0]
    assert (finding.rule, finding.severity) == ("tight-deadline", Severity.WARNING)
    assert "(80 ms) is 1.6 times its period (50 ms)" in finding.sentence
    assert "after: 150 ms" in finding.remedy
    assert deadlines("100 ms") == []


def test_a_deadline_that_own_frames_may_feed_is_a_warning() -> None:
    finding = deadlines("1 s", DRIVE.replace("sender: host", "sender: both"))[0]
    assert (finding.rule, finding.severity) == ("deadline-on-both", Severity.WARNING)
    assert "`drive` has a deadline at the MCU, which sends `drive` as well" in finding.sentence
    assert "`sender: host`" in finding.remedy


def test_on_a_line_that_is_known_to_echo_own_frames_feed_nothing() -> None:
    rest = "deadlines: [{message: drive, at: mcu, after: 1 s, then: stop}]"
    model = made(DEFAULT_FRAME, DRIVE.replace("sender: host", "sender: both"), rest).model
    echoes = dataclasses.replace(model, link=dataclasses.replace(model.link, echo=True))
    assert schedule.assess_deadlines(echoes, NOWHERE) == []


def test_a_deadline_without_a_schedule_is_a_note_once() -> None:
    finding = deadlines("1 s", DRIVE.replace("every: 50 ms, ", ""))[0]
    assert (finding.rule, finding.severity) == ("unscheduled-deadline", Severity.NOTE)
    assert "every: 200 ms" in finding.remedy


def test_the_reply_to_a_scheduled_request_has_a_schedule() -> None:
    model = shipped("diffdrive").model
    assert schedule.period_of(model, "status") == 1.0
    assert schedule.assess_deadlines(model, NOWHERE) == []


# ---- silence and stop


def test_commands_that_nobody_watches_or_stops_are_notes() -> None:
    found = schedule.assess_safety(made(DEFAULT_FRAME, DRIVE).model, NOWHERE)
    assert rules(found) == ["no-deadline", "no-emergency-stop"]
    assert {finding.severity for finding in found} == {Severity.NOTE}
    watched = f"{STOP}\ndeadlines: [{{message: drive, at: mcu, after: 1 s, then: stop}}]"
    assert schedule.assess_safety(made(DEFAULT_FRAME, DRIVE, watched).model, NOWHERE) == []


def test_a_command_that_the_stop_does_not_hold_back_is_a_note() -> None:
    grip = "grip: {id: 9, sender: host, fields: {opening: {type: u8, unit: mm}}}"
    rest = f"{STOP}\ndeadlines: [{{message: drive, at: mcu, after: 1 s, then: stop}}]"
    [found] = schedule.assess_safety(made(DEFAULT_FRAME, f"{DRIVE[:-1]}, {grip}}}", rest).model, NOWHERE)
    assert (found.rule, found.severity) == ("outside-the-stop", Severity.NOTE)
    assert "does not hold back `grip`, and any program may send it" in found.sentence
    light = f"{DRIVE[:-1]}, {grip.replace(', unit: mm', '')}}}"  # a number without a unit: a mode, a colour
    assert schedule.assess_safety(made(DEFAULT_FRAME, light, rest).model, NOWHERE) == []
    listed = rest.replace(STOP, STOP.replace("{message", "[{message") + ", {message: grip, opening: 0}]")
    assert schedule.assess_safety(made(DEFAULT_FRAME, f"{DRIVE[:-1]}, {grip}}}", listed).model, NOWHERE) == []


LINES = "[{delimiter: 0x0A}, {id: u8}, {payload: rest}, {check: sum8}, {delimiter: 0x0A}]"


@pytest.mark.parametrize(
    ("field", "value", "why"),
    [
        (
            "type: text, max: 4",
            '"a\\nb"',
            "say.a has at its byte 1 the bytes that end or begin a frame on the wire (0x0A)",
        ),
        ("type: u8, count: 2", "[0x0A, 1]", "a receiver finds no message in its frame"),
    ],
)
def test_a_stop_that_no_receiver_gets_is_an_error(field: str, value: str, why: str) -> None:
    say = f"{{say: {{id: 1, sender: host, fields: {{a: {{{field}}}}}}}}}"
    deadline = "deadlines: [{message: say, at: mcu, after: 1 s, then: stop, recover: explicit}]"
    [found] = given.assess(made(LINES, say, f"emergency_stop: {{message: say, a: {value}}}\n{deadline}"), NOWHERE)
    assert (found.rule, found.severity) == ("given-values", Severity.ERROR)
    assert f"the emergency stop cannot be sent: {why}" in found.sentence
    assert given.assess(made(DEFAULT_FRAME, DRIVE, STOP), NOWHERE) == []


def test_requests_and_services_command_nothing() -> None:
    assert schedule.assess_safety(shipped("pid_tuner").model, NOWHERE) == []
    ping = "{ping: {id: 1, sender: host, reply: pong, fields: {n: {type: u8}}}, pong: {id: 2, sender: mcu}}"
    assert schedule.assess_safety(made(DEFAULT_FRAME, ping).model, NOWHERE) == []


# ---- ids and magic


def test_an_id_with_two_meanings_is_a_note() -> None:
    both = "{ask: {id: 1, sender: host, reply: tell}, tell: {id: 1, sender: mcu, fields: {x: {type: u8}}}}"
    finding = identity.assess_ids(made(DEFAULT_FRAME, both).model, NOWHERE)[0]
    assert (finding.rule, finding.severity) == ("shared-id", Severity.NOTE)
    assert "id 0x01 is `ask` from the host and `tell` from the mcu" in finding.sentence
    assert identity.assess_ids(shipped("native").model, NOWHERE) == []


@pytest.mark.parametrize(("magic", "found"), [("0x00", 1), ("0xFF 0xFF", 1), ("0xFF 0x00", 0), ("0xA5", 0)])
def test_start_bytes_that_values_are_full_of_are_a_warning(magic: str, found: int) -> None:
    codec = made(DEFAULT_FRAME.replace("0xA5", magic))
    assert len(identity.assess_magic(codec.model, NOWHERE)) == found


# ---- delimiters among bytes that are not stuffed


def test_frames_that_a_delimiter_within_cuts_are_a_warning() -> None:
    frame = "[delimiter: 0x24, id: u8, payload: rest, check: crc-16/xmodem, delimiter: 0x0A]"
    (finding,) = cut_frames.assess(made(frame), 1, NOWHERE)
    assert (finding.rule, finding.severity) == ("cut-frame", Severity.WARNING)
    assert "of frames with random values hold a delimiter, and no receiver finds them" in finding.sentence
    stuffed = "[delimiter: 0x00, cobs: [id: u8, payload: rest, check: crc-16/xmodem], delimiter: 0x00]"
    assert cut_frames.assess(made(stuffed), 1, NOWHERE) == []


# ---- a line that echoes


def shared(messages: str, rest: str = "", *, baud: int = 115200, echo: bool = True) -> list[Finding]:
    model = made(messages=messages, rest=rest, baud=baud, echo=echo).model
    return shared_line.assess(model, line_budget.budgets(model, line_budget.scheduled_loads(model)), NOWHERE)


BOTH_BEGIN = (
    "{drive: {id: 1, sender: host, every: 50 ms, fields: {speed: {type: i16}}}, "
    "state: {id: 2, sender: mcu, every: 20 ms, fields: {volt: {type: u16}}}}"
)


def test_where_both_ends_begin_on_a_line_that_echoes_they_collide() -> None:
    (finding,) = shared(BOTH_BEGIN)
    assert finding.severity == Severity.WARNING
    assert "`drive` is due every 50 ms, and `state` every 20 ms" in finding.sentence
    assert "make `state` the `reply` of a request" in finding.remedy
    assert "its manual" in shared(BOTH_BEGIN, "fixed: mcu")[0].remedy
    assert shared(BOTH_BEGIN, echo=False) == []


def test_a_line_that_echoes_carries_both_directions() -> None:
    asked = (
        "{ask: {id: 1, sender: host, every: 2 ms, reply: state, fields: {volt: {type: u16}}}, "
        "state: {id: 2, sender: mcu, fields: {volt: {type: u16}}}}"
    )
    assert shared(asked) == []
    (finding,) = shared(asked, baud=80_000)
    assert finding.severity == Severity.WARNING
    assert finding.sentence == f"both directions together take {percent(14 * 500 / 8000)} of the line"
    (finding,) = shared(asked, baud=60_000)
    assert finding.severity == Severity.ERROR
