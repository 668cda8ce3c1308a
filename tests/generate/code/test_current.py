"""``wirebond gen --check`` names what is not current, and writes nothing."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from wirebond.cli.main import main

PROTOCOLS = Path(__file__).parents[3] / "protocols"
OPTIONS = [
    [],
    ["--port", "stm32_hal", "--port", "freertos"],
    ["--amalgamate"],
    ["--amalgamate", "--port", "bare_metal"],
    ["--lang", "c"],
    ["--lang", "c", "--amalgamate"],
    ["--lang", "python"],
    ["--lang", "ros2"],
]


@pytest.fixture
def protocol(tmp_path: Path) -> Path:
    return shutil.copy(PROTOCOLS / "diffdrive.yaml", tmp_path / "diffdrive.yaml")


def content(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("options", OPTIONS, ids=" ".join)
def test_generated_code_is_current_until_the_file_changes(
    protocol: Path, tmp_path: Path, options: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    command = ["gen", str(protocol), "--out", str(out), *options]
    assert main([*command, "--check"]) == 1
    assert not out.exists()
    named = [line for line in capsys.readouterr().out.splitlines() if line.startswith("missing: ")]
    assert main(command) == 0
    written = capsys.readouterr().out.splitlines()
    assert [line.removeprefix("missing: ") for line in named] == written
    assert main([*command, "--check"]) == 0
    assert main(command) == 0  # also a second time
    protocol.write_text(protocol.read_text().replace("scale: 0.001", "scale: 0.002", 1))
    before = content(out)
    capsys.readouterr()
    assert main([*command, "--check"]) == 1
    changed = [line for line in capsys.readouterr().out.splitlines() if line]
    assert changed
    assert all(line.startswith("changed: ") for line in changed)
    assert not any("wirebond/" in line for line in changed)  # only what depends on the protocol
    assert content(out) == before


def test_files_of_an_older_version_are_superfluous(
    protocol: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    command = ["gen", str(protocol), "--out", str(out)]
    assert main(command) == 0
    others = tmp_path / "others.yaml"
    others.write_text(protocol.read_text().replace("protocol: diffdrive", "protocol: others"))
    assert main(["gen", str(others), "--out", str(out), "--port", "posix"]) == 0
    (out / "main.cpp").write_text("int main() {}\n")
    (out / "own.hpp").write_text("// mine\n")
    assert main(["gen", str(protocol), "--out", str(out), "--lang", "python"]) == 0
    (out / "CMakeLists.txt").unlink()
    (out / "wirebond" / "gone.hpp").write_text("// of an older version\n")
    protocol.write_text(protocol.read_text().replace("protocol: diffdrive", "protocol: rover"))
    capsys.readouterr()
    assert main([*command, "--check"]) == 1
    assert capsys.readouterr().out.splitlines() == [
        f"missing: {out}/CMakeLists.txt",
        f"superfluous: {out}/diffdrive.hpp",
        f"superfluous: {out}/diffdrive_link.hpp",
        f"missing: {out}/rover.hpp",
        f"missing: {out}/rover_link.hpp",
        f"superfluous: {out}/wirebond/gone.hpp",
    ]
