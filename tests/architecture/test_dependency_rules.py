"""The dependency rules refuse what the design page does not allow, and the design page names packages that exist."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.architecture import dependency_rules
from tests.architecture.dependency_rules import (
    PACKAGE,
    ROOT,
    Rules,
    circle_problems,
    cpp_problems,
    length_problems,
    order_problems,
    private_problems,
    python_problems,
    read_rules,
)

RULES = read_rules((ROOT / "docs" / "DESIGN.md").read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("place", "header"),
    [
        ("core/include/wirebond/first.hpp", "wirebond/mcu/link.hpp"),
        ("core/include/wirebond/mcu/first.hpp", "wirebond/host/fast_crc.hpp"),
        ("core/include/wirebond/host/first.hpp", "wirebond/mcu/atomics.hpp"),
        ("ports/posix/include/wirebond/posix/first.hpp", "wirebond/host/fast_crc.hpp"),
        ("firmware/rover/first.hpp", "wirebond/host/fast_crc.hpp"),
        ("python/native/first.hpp", "wirebond/mcu/link.hpp"),
    ],
)
def test_an_include_that_no_row_allows_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str, header: str
) -> None:
    for name, text in {place: f'#include "{header}"\n', f"core/include/{header}": ""}.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.setattr(dependency_rules, "ROOT", tmp_path)
    assert [p.split(";")[0] for p in cpp_problems(RULES)] == [
        f"{place}:1: {dependency_rules.cpp_folder(RULES, place)} must not include {header}"
    ]


def package_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, files: dict[str, str]) -> None:
    """Check these files instead of the package."""
    for name, text in files.items():
        (tmp_path / "wirebond" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "wirebond" / name).write_text(text)
    monkeypatch.setattr(dependency_rules, "ROOT", tmp_path)
    monkeypatch.setattr(dependency_rules, "PACKAGE", tmp_path / "wirebond")


@pytest.mark.parametrize(
    ("module", "line"),
    [
        ("protocol/first.py", "from wirebond.codec import Codec"),
        ("analysis/first.py", "from wirebond import _engine"),
        ("analysis/check/first.py", "from wirebond.generate.code import cpp"),
        ("link/first.py", "from wirebond.recording import Recording"),
        ("link/first.py", "import wirebond.cli.main"),
        ("nowhere/first.py", ""),
        ("codec.py", "import tests.reference"),
    ],
)
def test_an_import_that_no_row_allows_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, line: str
) -> None:
    others = {"recording/__init__.py": "", "generate/code/cpp.py": "", "cli/main.py": ""}
    package_of(tmp_path, monkeypatch, others | {module: f"{line}\n"})
    assert len(python_problems(RULES)) == 1


def test_a_package_may_not_use_one_of_a_row_below_its_own() -> None:
    upwards = Rules({}, {"low": {"high"}, "high": {"_engine"}})
    [problem] = order_problems(upwards)
    assert problem.startswith("docs/DESIGN.md: low may use high")
    assert order_problems(Rules({}, {"high": {"_engine"}, "low": {"high"}})) == []


def test_a_circle_of_more_than_three_files_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def circle(size: int) -> dict[str, str]:
        return {f"link/f{i}.py": f"from wirebond.link.f{(i + 1) % size} import x\n" for i in range(size)}

    package_of(tmp_path / "small", monkeypatch, circle(3))
    assert circle_problems() == []
    package_of(tmp_path / "large", monkeypatch, circle(4))
    [problem] = circle_problems()
    assert problem.startswith("4 files import each other in a circle: link/f0, link/f1")


def test_a_private_name_of_another_package_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = {
        "link/link.py": "class Link:\n    def _leave(self): ...\n    def other(self, link): link._leave()\n",
        "server/commands.py": "import os\ndef send(link):\n    link._leave()\n    os._exit(1)\n",
    }
    package_of(tmp_path, monkeypatch, files)
    assert private_problems(RULES) == [
        "wirebond/server/commands.py:3: _leave is private to another package; make it public there, or do without it"
    ]


def test_the_page_has_a_row_for_each_package_and_no_other() -> None:
    assert all((PACKAGE / package).is_dir() or (PACKAGE / f"{package}.py").is_file() for package in RULES.python)
    assert all((ROOT / folder).is_dir() for folder in RULES.cpp)


def test_a_long_file_says_why_it_is_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert length_problems() == []
    monkeypatch.setattr(dependency_rules, "ROOT", tmp_path)
    (tmp_path / "python").mkdir()
    long = tmp_path / "python" / "long.py"
    long.write_text("x = 1\n" * 450)
    assert length_problems() == []
    long.write_text("x = 1\n" * 451)
    assert "python/long.py has 451 lines" in length_problems()[0]
    long.write_text('"""One file: it is a table."""\n' + "x = 1\n" * 451)
    assert length_problems() == []
