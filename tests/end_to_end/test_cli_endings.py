"""The ends of commands: Ctrl-C at any moment, pipes that close, streams that are closed or full, terminals of odd
kinds."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import wirebond
from tests.shared import PROTOCOLS
from tests.waiting import PATIENCE, let_pass, moments, wait_until

pytestmark = pytest.mark.live

COMMAND = str(Path(sys.executable).with_name("wirebond"))
FILE = str(PROTOCOLS / "diffdrive.yaml")
FRAME = wirebond.load(FILE).encode("status_query")


def start(*arguments: str, **options: Any) -> subprocess.Popen[str]:
    return subprocess.Popen([COMMAND, *arguments], stderr=subprocess.PIPE, text=True, **options)


def shell(line: str) -> subprocess.CompletedProcess[str]:
    result = subprocess.run(
        ["/bin/bash", "-c", line], capture_output=True, text=True, timeout=PATIENCE, check=False,
        env={**os.environ, "WIREBOND": COMMAND, "FILE": FILE},
    )  # fmt: skip
    assert "Traceback" not in result.stderr
    assert "Exception ignored" not in result.stderr
    return result


# Python says which module it has just imported, in the order of the start: from the package's first to the last.
@pytest.mark.parametrize(
    "module",
    ["wirebond.cli.start", "rich.segment", "typer.models", "wirebond.cli.main", "pydantic", "rich.live"],
)
@pytest.mark.parametrize("command", ["monitor", "check"])
def test_ctrl_c_during_the_start_ends_at_once(module: str, command: str) -> None:
    if command == "check" and module == "rich.live":
        pytest.skip("check does not import it")
    leader, follower = os.openpty()
    arguments = (
        ["monitor", FILE, os.ttyname(follower), "--seconds", "20"]
        if command == "monitor"
        else ["check", FILE, "--thorough"]
    )
    process = start(*arguments, stdout=subprocess.DEVNULL, env={**os.environ, "PYTHONPROFILEIMPORTTIME": "1"})
    assert process.stderr is not None
    for line in process.stderr:
        if line.rsplit("|", 1)[-1].strip() == module:
            break
    else:
        pytest.fail(f"{module} was never imported")
    process.send_signal(signal.SIGINT)
    rest = process.stderr.read()
    os.close(leader)
    os.close(follower)
    assert "Traceback" not in rest
    assert "Exception ignored" not in rest
    # monitor may have begun by then, whose normal end is Ctrl-C
    began = command == "monitor" and module == "rich.live"
    assert process.wait(timeout=PATIENCE) in ((0, 130) if began else (130,))


@pytest.mark.parametrize("delay", [0.0, 0.05, 0.1, 0.2, 0.3, 0.5])
def test_ctrl_c_at_any_time_ends_monitor_without_a_traceback(delay: float, tmp_path: Path) -> None:
    """Any time of ours: what an interpreter does with Ctrl-C before it has read a line of the command is its own."""
    leader, follower = os.openpty()
    log = tmp_path / "errors"
    with log.open("w") as told:
        process = subprocess.Popen(
            [COMMAND, "monitor", FILE, os.ttyname(follower), "--seconds", "20"],
            stdout=subprocess.DEVNULL, stderr=told, env={**os.environ, "PYTHONPROFILEIMPORTTIME": "1"},
        )  # fmt: skip
    wait_until(lambda: "wirebond.cli.start" in log.read_text(), "the start of the command")
    let_pass(delay)
    process.send_signal(signal.SIGINT)
    process.wait(timeout=PATIENCE)
    errors = log.read_text()
    os.close(leader)
    os.close(follower)
    assert "Traceback" not in errors
    assert process.returncode in (0, 130)
    assert (process.returncode == 0) == ("0 bytes: 0 frames" in errors), "a normal end has its account"


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_ctrl_c_in_the_middle_of_a_picture_leaves_it_whole(unbuffered: str) -> None:
    leader, follower = os.openpty()
    environment = {**os.environ, "TERM": "xterm-256color", "PYTHONUNBUFFERED": unbuffered}
    process = subprocess.Popen([COMMAND, "monitor", FILE, "sim:"], stdout=follower, stderr=follower, env=environment)
    os.close(follower)
    out = b""
    while "╯".encode() not in out:
        out += os.read(leader, 65536)
    written, looks = 0, 0
    for _ in moments("a picture for which the terminal has no room"):
        now = int(re.findall(r"wchar: (\d+)", Path(f"/proc/{process.pid}/task/{process.pid}/io").read_text())[0])
        written, looks = now, looks + 1 if now == written else 0
        if looks == 10:
            break
        let_pass(0.05)
    process.send_signal(signal.SIGINT)
    with contextlib.suppress(OSError):  # the other end is closed
        while chunk := os.read(leader, 65536):
            out += chunk
    os.close(leader)
    assert process.wait(PATIENCE) == 0
    text = out.decode()
    assert text.count("╭") == text.count("╯") > 1


NATIVE = str(PROTOCOLS / "native.yaml")


MEASURING = [
    ["latency", NATIVE, "sim:", "--seconds", "60", "--json"],
    ["soak", "--virtual", "--minutes", "90", "--json"],
]


@pytest.mark.parametrize(
    ("number", "arguments", "account"),
    [
        (signal.SIGHUP, ["monitor", FILE, "PTY"], "0 bytes: 0 frames"),
        (signal.SIGTERM, ["listen", FILE, "--port", "PTY"], "line: 0 bytes"),
        *(pytest.param(signal.SIGTERM, measuring, "", marks=pytest.mark.long) for measuring in MEASURING),
    ],
)  # fmt: skip
def test_a_supervisors_signal_ends_with_an_account(number: int, arguments: list[str], account: str) -> None:
    leader, follower = os.openpty()
    words = [os.ttyname(follower) if word == "PTY" else word for word in arguments]
    process = start(*words, stdout=subprocess.PIPE)
    for _ in moments("a handler of the signal"):
        assert process.poll() is None
        if handles(process.pid, number):
            break
    process.send_signal(number)
    _, errors = process.communicate(timeout=PATIENCE)
    os.close(leader)
    os.close(follower)
    assert "Traceback" not in errors
    assert process.returncode in (0, 1, 130), errors  # 1: no answer yet; 130: its port was not open yet
    assert process.returncode != 0 or account in errors


def handles(pid: int, number: int) -> bool:
    """Has this process a handler for the signal?"""
    status = Path(f"/proc/{pid}/status").read_text().splitlines()
    caught = next(line for line in status if line.startswith("SigCgt:"))
    return bool(int(caught.split()[1], 16) >> (number - 1) & 1)


def test_a_dump_that_cannot_be_written_takes_nothing_from_the_account() -> None:
    result = shell('"$WIREBOND" monitor "$FILE" sim: --json --seconds 0.1 --dump-on-exit /dev/full >/dev/null; echo $?')
    assert result.stdout == "1\n"
    assert "/dev/full: no space is left" in result.stderr
    assert " frames (" in result.stderr


def test_ctrl_c_ends_decode_with_its_account() -> None:
    process = start("decode", FILE, "-", stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.buffer.write(FRAME)
    process.stdin.buffer.flush()
    assert "status_query" in process.stdout.readline()
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=PATIENCE)
    assert (process.returncode, errors) == (130, "11 bytes: 1 frames (11 bytes)\n")


def test_decode_into_a_pipe_that_closes_gives_its_account_and_is_no_error(tmp_path: Path) -> None:
    capture = tmp_path / "capture"
    capture.write_bytes(FRAME * 20_000)
    result = shell(f'"$WIREBOND" decode "$FILE" {capture} | head -1; echo ${{PIPESTATUS[0]}}')
    message, code = result.stdout.splitlines()
    assert '"message": "status_query"' in message
    assert code == "0"
    assert result.stderr.endswith(" bytes)\n") or "pending" in result.stderr
    assert " frames (" in result.stderr


@pytest.mark.parametrize("as_json", ["", "--json"])
def test_monitor_into_a_pipe_that_closes_gives_its_account_and_is_no_error(as_json: str) -> None:
    leader, follower = os.openpty()
    odometry = wirebond.load(FILE).encode("odometry", left_ticks=1, right_ticks=2)
    process = subprocess.Popen(
        ["/bin/bash", "-c", f"'{COMMAND}' monitor '{FILE}' {os.ttyname(follower)} {as_json} --seconds 20 | head -1; "
         "echo ${PIPESTATUS[0]}"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    for _ in moments("the end of monitor"):
        if process.poll() is not None:
            break
        os.write(leader, odometry)
        let_pass(0.02)
    out, errors = process.communicate()
    os.close(leader)
    os.close(follower)
    assert "odometry" in out.splitlines()[0]
    assert out.splitlines()[1] == "0"
    assert "Traceback" not in errors
    assert " frames (" in errors


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ('"$WIREBOND" --help | true', 0),
        pytest.param('"$WIREBOND" check "$FILE" | true', 0, marks=pytest.mark.long),
        ('"$WIREBOND" doc "$FILE" | head -1', 0),
        ('"$WIREBOND" explain "$FILE" --hex 00 | true', None),
        pytest.param('"$WIREBOND" check nothing.yaml 2>&1 >/dev/null | true', 1, marks=pytest.mark.long),
        ('"$WIREBOND" decode "$FILE" --hex 00 2> >(true)', 1),
        pytest.param('"$WIREBOND" decode "$FILE" --hex 00 2>&-', 1, marks=pytest.mark.long),
        ('"$WIREBOND" check nothing.yaml >&- 2>&-', 1),
        ('"$WIREBOND" encode "$FILE" status_query >&-', 1),
        ('"$WIREBOND" decode "$FILE" - <&-', 1),
        ('"$WIREBOND" encode "$FILE" status_query >/dev/full', 1),
        ('"$WIREBOND" doc "$FILE" >/dev/full', 1),
        pytest.param('"$WIREBOND" check "$FILE" >/dev/full', 1, marks=pytest.mark.long),
        ('"$WIREBOND" --version >/dev/full', 1),
    ],
)
def test_streams_that_are_closed_or_full_end_in_a_sentence_or_quietly(line: str, code: int | None) -> None:
    result = shell(f"{line}; exit ${{PIPESTATUS[0]}}")
    if code is not None:
        assert result.returncode == code
    if "/dev/full" in line:
        assert result.stderr == "wirebond: the output cannot be written: No space left on device\n"


def test_a_closed_stderr_is_not_replaced_by_the_port() -> None:
    """The lowest free number goes to what is opened next: error sentences would go to the robot."""
    leader, follower = os.openpty()
    os.set_blocking(leader, False)
    shell(f'"$WIREBOND" monitor "$FILE" {os.ttyname(follower)} --seconds 0.1 0<&- 1>&- 2>&-')
    with pytest.raises(BlockingIOError):
        os.read(leader, 100)
    os.close(leader)
    os.close(follower)


@pytest.mark.parametrize(
    "setting",
    [
        "COLUMNS=1",
        "LANG=C LC_ALL=C",
        *(pytest.param(s, marks=pytest.mark.long) for s in ("PYTHONIOENCODING=ascii", "TERM=dumb", "HOME=")),
    ],
)
def test_odd_surroundings_change_nothing(setting: str) -> None:
    check = '"$WIREBOND" check "$FILE" && ' if setting == "COLUMNS=1" else ""  # it measures, which takes a while
    result = shell(
        f'export {setting}; {check}"$WIREBOND" explain "$FILE" --hex {FRAME.hex()} '
        '&& "$WIREBOND" doc "$FILE" && "$WIREBOND" --help'
    )
    assert (result.returncode, result.stderr) == (0, "")


def test_arguments_that_are_not_utf_8_are_shown() -> None:
    result = shell('"$WIREBOND" check $\'no\\xffthing\'; "$WIREBOND" encode "$FILE" $\'\\xff\'; '
                   '"$WIREBOND" monitor "$FILE" $\'/dev/\\xff\'; "$WIREBOND" $\'\\xff\'')  # fmt: skip
    assert "no\\xffthing: there is no such file; check the path" in result.stderr
    assert len(result.stderr.splitlines()) >= 4
