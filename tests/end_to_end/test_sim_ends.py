"""The ends of a simulation; and two simulations do not take each other's name."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.shared import PROTOCOLS, codec
from tests.waiting import PATIENCE
from wirebond.cli.main import main
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live

COMMAND = [sys.executable, "-m", "wirebond.cli.main", "sim", "protocols/native.yaml"]
ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    "number",
    [signal.SIGTERM, *(pytest.param(number, marks=pytest.mark.long) for number in (signal.SIGHUP, signal.SIGINT))],
)
def test_a_signal_ends_it_and_its_link_is_gone(tmp_path: Path, number: signal.Signals) -> None:
    link = tmp_path / "mcu"
    process = subprocess.Popen([*COMMAND, "--link", str(link)], stdout=subprocess.PIPE, cwd=ROOT)
    assert process.stdout is not None
    try:
        assert process.stdout.readline().strip() == str(link).encode()
        other = subprocess.run(
            [*COMMAND, "--link", str(link)], capture_output=True, text=True, cwd=ROOT, timeout=PATIENCE, check=False
        )
        assert other.returncode == 2
        assert "which another program serves; end that one, name another link" in other.stderr
        assert link.is_symlink()
        process.send_signal(number)
        assert process.wait(timeout=PATIENCE) == 0
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
    assert not link.is_symlink()


def test_a_link_that_a_killed_one_left_is_taken_over(tmp_path: Path) -> None:
    link = tmp_path / "mcu"
    link.symlink_to(tmp_path / "gone")
    done = subprocess.run(
        [*COMMAND, "--link", str(link), "--seconds", "0.1"],
        capture_output=True,
        cwd=ROOT,
        timeout=PATIENCE,
        check=False,
    )
    assert done.returncode == 0
    assert not link.is_symlink()


@pytest.mark.parametrize("as_json", [False, True])
def test_the_simulation_says_what_it_refused(
    as_json: bool, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    described = codec("diffdrive")
    good = described.encode("velocity", linear=0.5, angular=0)
    reads = iter([b"\x01\x02\x03" + good + good[:-2] + b"\x00\x0d" + good, b"", b""])

    def read(*_: object) -> bytes:
        for data in reads:
            return data
        raise KeyboardInterrupt

    monkeypatch.setattr(PtyPort, "read", read)
    options = ["--stats"] if as_json else []
    assert main(["sim", str(PROTOCOLS / "diffdrive.yaml"), *options]) == 0
    shown = capsys.readouterr()
    if as_json:
        told = json.loads(shown.out.splitlines()[1])
        assert (told["frames"], told["messages"]) == (2, {"velocity": 2})
        assert told["discarded_bytes"] == {"no_start": 3, "check_mismatch": 11}
        assert (told["foreign"], told["held_back"], told["unread_bytes"]) == (0, 0, 0)
    else:
        told = " ".join(shown.err.split())
        assert "the MCU received 36 bytes: 2 frames (22 bytes), 3 discarded as no_start, 11 discarded as" in told
