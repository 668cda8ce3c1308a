"""An engine that was built from other Python code is refused with a sentence; a comment needs no new engine."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import wirebond
from tests.shared import PROTOCOLS, ROOT
from tests.waiting import PATIENCE
from wirebond import engine_interface

OLD_ENGINE = """
import sys, wirebond
wirebond._engine.interface = ("", "")
del wirebond._engine
from wirebond.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


def package(folder: Path) -> Path:
    for name in engine_interface.FILES:
        (folder / name).parent.mkdir(exist_ok=True, parents=True)
        shutil.copy(Path(wirebond.__file__).parent / name, folder / name)
    return folder


def edit(path: Path, before: str, after: str) -> None:
    text = path.read_text()
    assert before in text
    path.write_text(text.replace(before, after, 1))


def engine(interface: tuple[str, str] | None) -> ModuleType:
    found = ModuleType("_engine")
    found.__file__ = "/somewhere/_engine.so"
    if interface is not None:
        found.interface = interface  # type: ignore[attr-defined]
    return found


@pytest.mark.parametrize("interface", [None, ("", ""), ("1", "2")])
def test_an_engine_of_other_python_code_is_refused(interface: tuple[str, str] | None) -> None:
    with pytest.raises(wirebond.EngineError, match=r"/somewhere/_engine.so.* another version .* run `make setup`"):
        engine_interface.verify(engine(interface))


@pytest.mark.parametrize(
    ("name", "before", "after"),
    [
        ("link/engine_settings.py", "    baud: int\n", "    baud: float\n"),
        ("link/engine_settings.py", "    baud: int\n", ""),
        ("protocol/model/fields.py", '    TEXT = "text"', '    TEXT = "string"'),
        ("protocol/tables.py", '"is_variable": field', '"varies": field'),
        ("_engine.pyi", "def begin_close(self)", "def begin_close(self, now: int)"),
    ],
)
def test_another_field_needs_another_engine(tmp_path: Path, name: str, before: str, after: str) -> None:
    built = engine_interface.digest_of_shapes(package(tmp_path))
    edit(tmp_path / name, before, after)
    assert engine_interface.digest_of_shapes(tmp_path) != built


def test_comments_and_functions_of_python_need_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    built = engine_interface.digest_of_shapes(package(tmp_path))
    edit(tmp_path / "link/engine_settings.py", "  # of silence that ends a frame", "")
    edit(tmp_path / "protocol/model/fields.py", '"""', '"""More. ')
    edit(tmp_path / "protocol/plan.py", "return ", "return None or ")
    monkeypatch.setattr(engine_interface, "_PACKAGE", tmp_path)
    engine_interface.verify(engine(("other bytes", built)))


@pytest.mark.live
def test_a_command_says_so() -> None:
    arguments = [sys.executable, "-c", OLD_ENGINE, "check", str(PROTOCOLS / "diffdrive.yaml")]
    ended = subprocess.run(arguments, capture_output=True, text=True, cwd=ROOT, timeout=PATIENCE, check=False)
    assert ended.returncode == 1
    assert "run `make setup`" in ended.stderr
    assert "Traceback" not in ended.stderr
