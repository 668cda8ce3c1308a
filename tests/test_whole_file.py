"""Files are written whole or not at all."""

from __future__ import annotations

import errno
import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from tests.waiting import PATIENCE
from wirebond import UsageError
from wirebond.generate.new.write import write_new
from wirebond.whole_file import write_whole

pytestmark = pytest.mark.live

FULL = """
import resource, signal, sys
from pathlib import Path
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
from wirebond.cli.main import main
sys.exit(main(sys.argv[1:]))
"""
PROTOCOL = str(Path(__file__).resolve().parents[1] / "protocols" / "diffdrive.yaml")
HEADER = "".join(f"typedef struct __attribute__((packed)) {{ unsigned char a; }} s{i}_t;\n" for i in range(60))


def limited(*arguments: str) -> subprocess.CompletedProcess[str]:
    """The command, on a system where no file may grow beyond 1000 bytes: as on a full disk, a write fails half-way."""
    return subprocess.run(
        [sys.executable, "-c", FULL, *arguments], capture_output=True, text=True, timeout=PATIENCE, check=False
    )


def test_a_full_disk_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    out = tmp_path / "out.md"
    out.write_text("old")
    result = limited("doc", PROTOCOL, "--out", str(out))
    assert result.returncode == 1
    assert f"{out}: the file would be larger than is allowed here; nothing was changed" in result.stderr
    assert out.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["out.md"]


@pytest.mark.parametrize("command", ["doc", "new", "gen", "import", "schema"])
def test_every_command_that_writes_names_the_file_and_leaves_none(tmp_path: Path, command: str) -> None:
    header = tmp_path / "h.h"
    header.write_text(HEADER)
    folder = tmp_path / "out"
    folder.mkdir()
    arguments = {
        "doc": ["doc", PROTOCOL, "--out", str(folder / "a.md")],
        "new": ["new", str(folder / "a.yaml")],
        "gen": ["gen", PROTOCOL, "--amalgamate", "--out", str(folder)],
        "import": ["import", str(header), "--out", str(folder / "a.yaml")],
        "schema": ["schema", "--out", str(folder / "a.json")],
    }
    result = limited(*arguments[command])
    assert result.returncode == 1
    assert str(folder / ("diffdrive.hpp" if command == "gen" else "a.")) in result.stderr
    assert "Traceback" not in result.stderr
    assert list(folder.iterdir()) == []


def test_permissions_and_links_stay(tmp_path: Path) -> None:
    target = tmp_path / "folder" / "target"
    target.parent.mkdir()
    target.write_text("old")
    target.chmod(0o640)
    link = tmp_path / "link"
    link.symlink_to(target)
    write_whole(link, "new")
    assert link.is_symlink()
    assert target.read_text() == "new"
    assert stat.S_IMODE(target.stat().st_mode) == 0o640
    assert [path.name for path in target.parent.iterdir()] == ["target"]


def test_a_new_file_has_the_permissions_that_the_user_gives_new_files(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_whole(tmp_path / "a", b"x")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == 0o640


def test_devices_and_pipes_are_written_directly(tmp_path: Path) -> None:
    write_whole(Path(os.devnull), "text")
    assert Path(os.devnull).is_char_device()
    with pytest.raises(OSError, match="No space left") as full:
        write_whole(Path("/dev/full"), "text")
    assert (full.value.errno, full.value.filename) == (errno.ENOSPC, "/dev/full")
    with pytest.raises(IsADirectoryError):
        write_whole(tmp_path, "text")


def test_a_link_that_leads_back_to_itself_is_left_as_it_is(tmp_path: Path) -> None:
    link = tmp_path / "link"
    link.symlink_to(link)
    with pytest.raises(OSError, match="Too many levels") as caught:
        write_whole(link, "text")
    assert caught.value.errno == errno.ELOOP
    assert link.is_symlink()


@pytest.mark.parametrize("kind", ["file", "link to nothing", "folder"])
def test_a_new_file_replaces_nothing(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "there"
    if kind == "file":
        path.write_text("old")
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to(tmp_path / "nowhere")
    with pytest.raises(UsageError, match="exists already"):
        write_new(path, "new")
    assert [entry.name for entry in tmp_path.iterdir()] == ["there"]
    assert path.read_text() == "old" if kind == "file" else not (tmp_path / "nowhere").exists()


def test_a_file_that_another_program_makes_in_between_is_not_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "raced"
    real = os.fsync

    def other_program(descriptor: int) -> None:
        real(descriptor)
        path.write_text("theirs")

    monkeypatch.setattr(os, "fsync", other_program)
    with pytest.raises(FileExistsError):
        write_whole(path, "ours", new=True)
    assert path.read_text() == "theirs"
    assert [entry.name for entry in tmp_path.iterdir()] == ["raced"]


def test_nobody_sees_half_a_file_and_an_interrupt_leaves_the_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "file"
    path.write_text("old")

    def interrupted(descriptor: int) -> None:
        assert path.read_text() == "old"  # all is written by now
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_whole(path, "new")
    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]
