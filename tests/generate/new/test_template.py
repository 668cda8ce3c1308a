"""First protocol files: accepted as they are, named after their file, never written over another."""

from __future__ import annotations

from pathlib import Path

import pytest

import wirebond
from wirebond.analysis.check import Severity, lint
from wirebond.errors import UsageError
from wirebond.generate.new import TEMPLATES, write_template
from wirebond.generate.new.write import protocol_name


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


def test_a_file_that_exists_is_left_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("precious")
    with pytest.raises(UsageError, match="exists already, and is left as it is"):
        write_template(path, "native")
    assert path.read_text() == "precious"


def test_an_unknown_template_names_those_there_are(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="there are native, fixed, length"):
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
