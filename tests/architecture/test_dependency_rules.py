"""The dependency rules refuse what the design page does not allow, and the design page names packages that exist."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.architecture import dependency_rules
from tests.architecture.dependency_rules import PACKAGE, ROOT, cpp_problems, python_problems, read_rules

RULES = read_rules((ROOT / "docs" / "DESIGN.md").read_text(encoding="utf-8"))


def test_this_tree_keeps_them() -> None:
    assert cpp_problems(RULES) + python_problems(RULES) == []


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


@pytest.mark.parametrize(
    ("module", "line"),
    [
        ("protocol/text/first.py", "from wirebond.protocol.meaning import frames"),
        ("explain/first.py", "from wirebond import _engine"),
        ("check/first.py", "from wirebond.link import Link"),
        ("check/view.py", "from wirebond.gen.cpp import generate_cpp"),
        ("link/first.py", "import wirebond.cli.main"),
        ("nowhere/first.py", ""),
        ("codec.py", "import tests.reference"),
    ],
)
def test_an_import_that_no_row_allows_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, line: str
) -> None:
    package = tmp_path / "wirebond"
    for directory in ("protocol/meaning", "protocol/text", "gen", "cli"):
        (package / directory).mkdir(parents=True)
    for name in ("protocol/meaning/frames.py", "gen/cpp.py", "cli/main.py"):
        (package / name).write_text("")
    (package / module).parent.mkdir(parents=True, exist_ok=True)
    (package / module).write_text(f"{line}\n")
    monkeypatch.setattr(dependency_rules, "ROOT", tmp_path)
    monkeypatch.setattr(dependency_rules, "PACKAGE", package)
    assert len(python_problems(RULES)) == 1


def test_the_page_has_a_row_for_each_package_and_no_other() -> None:
    packages = {package for package in RULES.python if not package.startswith("*")}
    assert all((PACKAGE / package).is_dir() or (PACKAGE / f"{package}.py").is_file() for package in packages)
    assert all((ROOT / folder).is_dir() for folder in RULES.cpp)
