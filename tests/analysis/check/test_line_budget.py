"""The share of the line that schedules and claimed loads take."""

from __future__ import annotations

import pytest
from tests.analysis.check.files import made, shipped

from wirebond.analysis.check.findings import Severity
from wirebond.analysis.check.line_budget import Budget, assess, budgets, parse_traffic, scheduled_loads
from wirebond.analysis.check.places import Places
from wirebond.errors import UsageError
from wirebond.protocol.model import End, Protocol


def by_sender(model: Protocol, traffic: str | None = None) -> dict[End, Budget]:
    loads = scheduled_loads(model) if traffic is None else parse_traffic(model, traffic)
    return {budget.sender: budget for budget in budgets(model, loads)}


def test_the_schedule_of_a_file() -> None:
    """1000 frames of 45 bytes at 11 bits a byte and 2 Mbaud."""
    line = by_sender(shipped("enterprize").model)
    assert line[End.MCU].share == pytest.approx(0.2475)
    assert line[End.HOST].share == 0


def test_the_seeds_published_figures_do_not_fit_the_line() -> None:
    """Baseline, section 3: 3992 frames of 47 bytes a second, and 10 000 frames of 20.2 bytes the other way."""
    model = shipped("enterprize").model
    host = "gimbal_cmd=2000,chassis_cmd=2000,action_cmd=2000,sentry_gimbal_cmd=2000,sentry_cv_cmd=2000"
    line = by_sender(model, f"{host},mcu:47=3992")
    assert line[End.MCU].capacity == pytest.approx(181_818, abs=1)
    assert line[End.MCU].share == pytest.approx(187_624 / 181_818, abs=1e-4)
    assert line[End.HOST].share == pytest.approx(1.111, abs=1e-4)
    findings = assess(model, list(line.values()), Places())
    assert [finding.severity for finding in findings] == [Severity.ERROR, Severity.ERROR]
    sentences = {finding.sentence for finding in findings}
    assert (
        "MCU to host takes 103.2 % of the line: 187 624 of 181 818 bytes/s; at most 3 868/s of 47-byte frames fit"
        in sentences
    )
    assert any("Host" not in s and s.startswith("host to MCU takes 111.1 %") for s in sentences)


def test_the_published_struct_fills_the_line_to_the_brim() -> None:
    model = shipped("enterprize").model
    line = by_sender(model, "sentry_gimbal_msg=3992")
    assert line[End.MCU].share == pytest.approx(0.988, abs=5e-4)
    findings = assess(model, list(line.values()), Places())
    assert [finding.severity for finding in findings] == [Severity.WARNING]
    assert "4 040/s" in findings[0].sentence
    assert "3 000 000" in findings[0].remedy


def test_the_reply_to_a_scheduled_request_is_counted() -> None:
    model = shipped("diffdrive").model
    line = by_sender(model)
    assert {load.name: load.frames for load in line[End.MCU].loads} == {"status": 1.0, "odometry": 20.0}


def test_parity_stop_bits_and_stuffing_are_counted() -> None:
    text = "{state: {id: 1, sender: both, every: 100 ms, fields: {x: {type: i32}}}}"
    frame = "[delimiter: 0x00, cobs: [id: u8, payload: rest, check: crc-16/ibm-sdlc], delimiter: 0x00]"
    plain = by_sender(made(frame, text).model)
    # 1 + 4 + 2 bytes, one of COBS, two delimiters; ten bits each
    assert plain[End.MCU].share == pytest.approx(10 * 10 * 10 / 115200)
    assert plain[End.HOST].share == plain[End.MCU].share


@pytest.mark.parametrize(
    ("traffic", "sentence"),
    [
        ("sentry_gimbal_msg", "is not a load; write message=frames per second"),
        ("sentry_gimbal_msg=fast", "is not a load"),
        ("sentry_gimbal_msg=0", "is not a load"),
        ("sentry_gimbal_msg=nan", "is not a load"),
        ("", "is not a load"),
        ("sentry=1000", "no message 'sentry'; did you mean "),
        ("robot:47=1000", "write host:47 or mcu:47"),
        ("mcu:-1=1000", "write host:47 or mcu:47"),
    ],
)
def test_a_load_that_cannot_be_read_is_refused_in_a_sentence(traffic: str, sentence: str) -> None:
    with pytest.raises(UsageError, match="--traffic") as refused:
        parse_traffic(shipped("enterprize").model, traffic)
    assert sentence in str(refused.value)
