"""First protocol files: accepted as they are, named after their file, never written over another."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import pytest

import wirebond
from wirebond.analysis.check import Severity, lint
from wirebond.cli.main import main
from wirebond.errors import UsageError
from wirebond.generate.new import PARTS, TEMPLATES, parts_of, shipped_formats, template_text, write_template
from wirebond.generate.new.template import MOST_JOINTS
from wirebond.generate.new.write import protocol_name
from wirebond.protocol import loads


@pytest.mark.parametrize("template", TEMPLATES)
def test_a_template_is_a_file_that_the_lint_accepts(tmp_path: Path, template: str) -> None:
    path = tmp_path / "my-robot.yaml"
    write_template(path, template)
    codec = wirebond.load(path)
    assert codec.name == "my_robot"
    report = lint(codec)
    assert [f for f in report.findings if f.severity in (Severity.ERROR, Severity.WARNING)] == []


@pytest.mark.parametrize("template", TEMPLATES)
def test_a_template_explains_itself(tmp_path: Path, template: str) -> None:
    path = tmp_path / "x.yaml"
    write_template(path, template)
    lines = path.read_text().splitlines()
    assert lines[0].startswith("# ")
    assert sum("#" in line for line in lines) >= 10


def chosen_parts() -> list[str]:
    return [",".join(parts) for n in range(len(PARTS) + 1) for parts in combinations(PARTS, n)]


EXTREMES = ["", ",".join(PARTS), "joints=1", f"base,joints={MOST_JOINTS}"]
CHOICES = [("native", has) for has in dict.fromkeys([*chosen_parts(), *EXTREMES])]
CHOICES += [("length", has) for has in EXTREMES]


@pytest.mark.parametrize(
    ("template", "has"),
    [*CHOICES, *(pytest.param("length", has, marks=pytest.mark.long) for has in chosen_parts() if has not in EXTREMES)],
)
def test_each_choice_of_parts_is_a_file_that_the_lint_accepts(template: str, has: str) -> None:
    text = template_text(template, "robot", parts_of(has))
    report = lint(wirebond.Codec(loads(text)))
    assert [f for f in report.findings if f.severity in (Severity.ERROR, Severity.WARNING)] == []
    assert max(map(len, text.splitlines())) <= 120


def test_a_first_file_has_what_people_need() -> None:
    model = loads(template_text("native", "robot", parts_of("base,joints=12,imu,battery")))
    fields = {message.name: {field.name: field for field in message.fields} for message in model.messages}
    assert fields["imu"]["acceleration"].count == 3
    assert fields["joint_states"]["joints"].count == 12
    assert fields["odometry"]["measured"].clock
    assert fields["parameter_set"]["index"].enum == (("kp", 0), ("ki", 1), ("kd", 2))
    assert model.message("overheated").log
    assert [s.name for s in model.services] == ["hello", "ping", "clock", "log", "parameter", "counters"]
    assert [entry.message for entry in model.emergency_stop] == ["velocity", "joint_mode"]


@pytest.mark.parametrize(
    ("has", "sentence"),
    [
        ("wheels", "a robot's parts are base, joints, imu, battery, and not `wheels`"),
        ("joints=0", "`joints=0` is not a number of joints; write `joints=12`, with 1 to 32"),
        ("joints=33", "`joints=33` is not a number of joints"),
        ("joints=", "`joints=` is not a number of joints"),
        ("base=2", "`base=2` is not a number of joints"),
    ],
)
def test_wrong_parts_are_a_sentence(has: str, sentence: str) -> None:
    with pytest.raises(UsageError) as raised:
        parts_of(has)
    assert sentence in str(raised.value)


def test_frames_of_one_size_have_no_parts() -> None:
    with pytest.raises(UsageError, match="the template fixed has no choice of parts"):
        template_text("fixed", "robot", parts_of("base"))


@pytest.mark.parametrize("template", shipped_formats())
def test_a_copy_of_a_public_format_is_that_format(tmp_path: Path, template: str) -> None:
    path = tmp_path / "mine.yaml"
    write_template(path, template)
    copy, original = wirebond.load(path), wirebond.load(shipped_formats()[template])
    assert (copy.name, copy.hash) == ("mine", original.hash)
    with pytest.raises(UsageError, match=f"the template {template} has no choice of parts"):
        template_text(template, "robot", parts_of("base"))


TFMINI = [
    *("59 59 2C 01 64 00 00 00 43", "59 59 30 01 70 00 00 00 53"),
    *("59 59 2E 01 6A 00 00 00 4B", "59 59 2B 01 61 00 00 00 3F"),
]


def test_the_command_for_a_copy_is_the_one_that_identify_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["identify", "--hex", " ".join(TFMINI)]) == 0
    command = "wirebond new tfmini.yaml --template tfmini"
    assert command in capsys.readouterr().out
    assert main(command.split()[1:]) == 0
    shown = capsys.readouterr().out
    assert "tfmini.yaml: a copy of Wirebond's file for tfmini. Next:" in shown
    assert "wirebond serve tfmini.yaml /dev/ttyUSB0 --web  # the device itself" in shown
    assert wirebond.load("tfmini.yaml").name == "tfmini"


def test_a_file_that_exists_is_left_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("precious")
    with pytest.raises(UsageError, match="exists already, and is left as it is"):
        write_template(path, "native")
    assert path.read_text() == "precious"


def test_an_unknown_template_names_those_there_are(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="there are native, length, fixed, and the formats"):
        write_template(tmp_path / "x.yaml", "nativ")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("rover.yaml", "rover"),
        ("My-Robot v2.yaml", "my_robot_v2"),
        ("2wheels.yaml", "wheels"),
        ("class.yaml", "my_protocol"),
        ("std.yml", "my_protocol"),
        ("上位机.yaml", "my_protocol"),
        ("a.b.c", "a"),
    ],
)
def test_a_protocol_is_named_after_its_file_where_that_is_a_name(file: str, name: str) -> None:
    assert protocol_name(Path("some/folder") / file) == name
