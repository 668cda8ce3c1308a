"""The command line as a user meets it: output, exit codes, sentences instead of tracebacks."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import wirebond
from tests.command import run
from tests.shared import PROTOCOLS, ROOT, codec
from tests.waiting import PATIENCE, let_pass, moments, wait_until
from wirebond.cli.main import main
from wirebond.sim.pty_port import PtyPort

pytestmark = pytest.mark.live

COMMAND = [str(Path(sys.executable).with_name("wirebond"))]
DIFFDRIVE = str(PROTOCOLS / "diffdrive.yaml")
NATIVE = str(PROTOCOLS / "native.yaml")


def test_check_finds_no_error_in_the_files_that_come_with_it(capsys: pytest.CaptureFixture[str]) -> None:
    for path in sorted(PROTOCOLS.glob("*.yaml")):
        code = main(["check", str(path)])
        told = capsys.readouterr()
        assert (code, told.err) == (0, "")
        assert f"protocol {path.stem}, " in told.out
    assert "no problem found" in run("check", NATIVE).stdout


def test_check_says_how_weak_a_link_is_and_strict_makes_it_fail() -> None:
    listing = str(PROTOCOLS / "pid_tuner_listing.yaml")
    result = run("check", listing)
    text = " ".join(result.stdout.split())
    assert result.returncode == 0
    assert "2 warnings, 3 notes" in text
    assert "% of those damaged where 1 bit in 10 000 is wrong" in text
    assert "without max_payload it would be 257 bytes, 22.3 ms" in text
    assert run("check", listing, "--strict").returncode == 1
    assert run("check", NATIVE, "--strict").returncode == 0


def test_check_assesses_a_claimed_load() -> None:
    enterprize = str(PROTOCOLS / "enterprize.yaml")
    result = run("check", enterprize, "--traffic", "mcu:47=3992")
    assert result.returncode == 1
    assert "MCU to host takes 103.2 % of the line" in " ".join(result.stdout.split())
    figures = json.loads(run("check", enterprize, "--traffic", "mcu:47=3992", "--json").stdout)["figures"]
    assert figures["line"]["mcu"]["share"] == pytest.approx(1.0319, abs=1e-4)


def test_check_works_the_files_examples_out_again() -> None:
    specification = PROTOCOLS.parent / "tests" / "analysis" / "check" / "diffdrive_specification.yaml"
    result = run("check", str(specification))
    assert result.returncode == 1
    assert "byte 9 (check) is 0xFF, expected 0x0B" in result.stdout
    report = json.loads(run("check", str(specification), "--json").stdout)
    assert report["ok"] is False
    assert [f["line"] for f in report["findings"] if f["rule"] == "example"] == [14, 15, 16]


LAID_OUT = """
wirebond: 1
protocol: laid_out
frame: [magic: 0xA5, id: u8, payload: by_id, check: crc-16/modbus]
messages:
  scan:
    id: 1
    sender: mcu
    fields:
      version: {type: u8, constant: 3}
      state: {bits: {type: u8, fields: {mode: {type: u3}, number: {type: u4}}}}
      points: {group: {count: state.number, max: 15, fields: {x: {type: i16}}}}
      last: {type: u32}
  stop: {id: 2, sender: host}
"""


def test_check_shows_the_layout_of_payloads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "laid_out.yaml"
    path.write_text(LAID_OUT)
    assert main(["check", str(path), "--layout"]) == 0
    assert capsys.readouterr().out.splitlines()[1:] == [
        "",
        "scan: 6 to 36 bytes from the mcu",
        "     at      bytes",
        "      0          1  version   constant 0x03",
        "      1          1  state     bits of u8",
        "                      mode    bits 0 to 2: u3",
        "                      number  bits 3 to 6: u4, counts points",
        "      2    0 to 30  points    up to 15 of struct, as many as state.number says",
        "     +0          2    x       i16",
        "     2…          4  last      u32",
        "",
        "stop: 0 bytes from the host",
    ]
    assert main(["check", str(path), "--layout", "--json"]) == 0
    scan = json.loads(capsys.readouterr().out)["layout"]["scan"]
    assert [(step["step"], step["at"], step["bytes"]) for step in scan] == [
        ("constant", 0, [1, 1]), ("bits", 1, [1, 1]), ("list", 2, [0, 30]), ("number", 2, [4, 4]),
    ]  # fmt: skip
    assert scan[1]["members"][1] == {"name": "number", "type": "u4", "bits": [[3, 4]]}
    assert scan[2]["told"] == [{"by": "state.number", "per": 1}]


def test_check_names_file_line_and_column_and_exits_with_1(tmp_path: Path) -> None:
    file = tmp_path / "wrong.yaml"
    file.write_text(Path(DIFFDRIVE).read_text().replace("type: i16, unit: m/s", "type: i17, unit: m/s"))
    result = run("check", str(file))
    assert result.returncode == 1
    assert f"{file}:22:" in result.stderr
    report = json.loads(run("check", str(file), "--json").stdout)
    assert report["ok"] is False
    assert report["problems"][0]["line"] == 22


def test_encode_prints_hex() -> None:
    result = run("encode", DIFFDRIVE, "velocity", "linear=0.5", "angular=0")
    assert (result.returncode, result.stdout) == (0, "AA 55 01 F4 01 00 00 00 00 0B 0D\n")
    result = run("encode", DIFFDRIVE, "velocity", "linear=-1", "angular=-3.14")
    assert result.stdout == "AA 55 01 18 FC BC F3 00 00 55 0D\n"
    result = run("encode", DIFFDRIVE, "status", "battery=12.345", "errors=right_motor,low_battery", "state=[charging]")
    assert result.stdout == "AA 55 82 39 30 06 02 00 00 70 0D\n"


def test_encode_refuses_what_does_not_fit_with_exit_1() -> None:
    result = run("encode", DIFFDRIVE, "velocity", "linear=2.5", "angular=0")
    assert (result.returncode, result.stdout) == (1, "")
    assert "velocity.linear = 2.5 m/s is outside -2 ... 2 m/s" in result.stderr


def test_decode_prints_a_json_line_a_message_and_statistics_on_stderr() -> None:
    result = run("decode", DIFFDRIVE, "--hex", "AA 55 01 F4 01 00 00 00 00 0B 0D ff", "--sender", "host")
    message = json.loads(result.stdout)
    assert message["message"] == "velocity"
    assert message["fields"] == {"linear": 0.5, "angular": 0.0}
    assert "12 bytes: 1 frames (11 bytes), 1 discarded as no_start" in result.stderr


def test_decode_reads_captures_and_stdin(tmp_path: Path) -> None:
    capture = codec("diffdrive").encode("odometry", left_ticks=1, right_ticks=2) * 3
    file = tmp_path / "capture.bin"
    file.write_bytes(capture)
    from_file = run("decode", DIFFDRIVE, str(file))
    from_stdin = run("decode", DIFFDRIVE, "-", stdin=capture)
    assert from_file.stdout == from_stdin.stdout
    assert [json.loads(line)["offset"] for line in from_file.stdout.splitlines()] == [0, 11, 22]


def test_decode_of_refused_bytes_exits_with_1() -> None:
    result = run("decode", DIFFDRIVE, "--hex", "aa5501f40100000000ff0d")
    assert (result.returncode, result.stdout) == (1, "")
    assert "11 discarded as check_mismatch" in result.stderr


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        (["decode", DIFFDRIVE], 2, "give bytes one way"),
        (["decode", DIFFDRIVE, "--hex", "AA 5"], 2, "two digits per byte"),
        (["decode", DIFFDRIVE, "--hex", "GG"], 2, "'G' is not a hex digit"),
        (["decode", DIFFDRIVE, "--hex", "AA", "--sender", "me"], 2, "expected 'mcu' or 'host'"),
        (["decode", DIFFDRIVE, "/proc/nonexistent"], 1, "there is no such file or folder"),
        (["check", "/nonexistent.yaml"], 1, "/nonexistent.yaml"),
        (["check", "/"], 1, "this is a folder"),
        (["check", NATIVE, "--traffic", "state"], 2, "write message=frames per second"),
        (["check", NATIVE, "--traffic", "status=5"], 2, "native has no message 'status'"),
        (["encode", DIFFDRIVE, "speed"], 1, "diffdrive has no message 'speed'; it has velocity"),
        (["encode", DIFFDRIVE, "velocity", "linear"], 2, "write field=value"),
        (["encode", DIFFDRIVE, "velocity", "linear=fast", "angular=0"], 1, "expected a number in m/s"),
        (["encode", DIFFDRIVE, "velocity", "linear=nan", "angular=0"], 1, "not a finite number"),
        (["monitor", DIFFDRIVE, "/dev/null", "--baud", "1_0"], 2, "'1_0' is not a whole number; write digits alone"),
        (["monitor", DIFFDRIVE, "/dev/null", "--seconds", "٣"], 2, "'٣' is not a number from 0 on"),
        (["monitor", DIFFDRIVE, "/dev/null", "--seconds", "nan"], 2, "'nan' is not a number from 0 on"),
        (["monitor", DIFFDRIVE, "/dev/ttyNOPE"], 3, "there is no port /dev/ttyNOPE"),
        (["monitor", DIFFDRIVE, "/dev"], 3, "/dev is a folder, and a serial port is expected; give a tty such as"),
        (["monitor", "/dev", "/dev/ttyNOPE"], 1, "this is a folder, and a protocol file (YAML) is expected"),
        (["send", DIFFDRIVE, "/dev/null", "velocity", "linear=0", "angular=0"], 3, "is not a serial port"),
        (["send", DIFFDRIVE, "/dev/null", "velocity", "linear=9", "angular=0"], 1, "outside -2 ... 2"),
        (
            ["send", DIFFDRIVE, "/dev/null", "velocity", "linear=0", "angular=0", "--rate", "0"],
            2,
            "--rate is 0",
        ),
        (["gen", DIFFDRIVE, "--lang", "cobol", "--out", "/tmp/never"], 2, "expected cpp, c, python"),
        (
            ["gen", DIFFDRIVE, "--lang", "python", "--amalgamate", "--out", "/tmp/never"],
            2,
            "--amalgamate is for --lang cpp and c",
        ),
        (["gen", DIFFDRIVE, "--out", DIFFDRIVE], 2, "is a file"),
        (
            ["gen", DIFFDRIVE, "--port", "avr", "--out", "/tmp/never"],
            2,
            "expected arduino, bare_metal, freertos",
        ),
        (
            ["gen", DIFFDRIVE, "--lang", "c", "--port", "posix", "--out", "/tmp/never"],
            2,
            "there is no --port posix in C, only stm32_hal, stm32_ll; docs/c.md shows",
        ),
        (
            ["gen", DIFFDRIVE, "--lang", "python", "--port", "posix", "--out", "/tmp/never"],
            2,
            "--port is for the C++ of a firmware",
        ),
        (["gen", DIFFDRIVE, "--out", f"{DIFFDRIVE}/below/it"], 2, "diffdrive.yaml is a file; --out names a folder"),
        (["gen", DIFFDRIVE, "--out", "/proc/generated"], 1, "cannot write /proc/generated: No such file or directory"),
        (["send", DIFFDRIVE, "/nowhere", "velocity", "--role", "both"], 2, "--role is both; expected host or mcu"),
        (["monitor", DIFFDRIVE, "/nowhere", "--role", "both"], 2, "role is 'both'; expected 'host' or 'mcu'"),
        (["frobnicate"], 2, "No such command"),
    ],
)
def test_wrong_use_gets_a_sentence_and_an_exit_code(
    arguments: list[str], code: int, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without a process for each: a start takes half a second."""
    found = main(arguments)
    told = capsys.readouterr().err
    assert found == code, told
    assert sentence in " ".join(told.split())


def test_output_into_a_closed_pipe_is_no_error() -> None:
    capture = codec("diffdrive").encode("odometry", left_ticks=1, right_ticks=2) * 5000
    with subprocess.Popen(
        [*COMMAND, "decode", DIFFDRIVE, "-"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:
        assert process.stdin is not None and process.stdout is not None and process.stderr is not None
        process.stdout.close()
        try:
            process.stdin.write(capture)
            process.stdin.close()
        except BrokenPipeError:
            pass
        assert b"Traceback" not in process.stderr.read()


def test_gen_writes_a_folder_and_a_second_run_changes_nothing(tmp_path: Path) -> None:
    first = run("gen", DIFFDRIVE, "--lang", "cpp", "--out", str(tmp_path / "out"))
    assert first.returncode == 0
    times = {path: path.stat().st_mtime_ns for path in (tmp_path / "out").rglob("*.hpp")}
    assert (tmp_path / "out" / "diffdrive.hpp") in times
    run("gen", DIFFDRIVE, "--lang", "cpp", "--out", str(tmp_path / "out"))
    assert times == {path: path.stat().st_mtime_ns for path in (tmp_path / "out").rglob("*.hpp")}


@pytest.mark.parametrize(("language", "files"), [("c", ["link.h", "link.cpp", "link.hpp"]), ("python", ["link.py"])])
def test_gen_prints_the_files_of_each_language(language: str, files: list[str], tmp_path: Path) -> None:
    source = tmp_path / "link.yaml"
    source.write_text(Path(DIFFDRIVE).read_text().replace("protocol: diffdrive", "protocol: link"))
    result = run("gen", str(source), "--lang", language, "--out", str(tmp_path / "out"))
    assert result.returncode == 0
    printed = result.stdout.split()
    assert set(printed) >= {str(tmp_path / "out" / file) for file in files}
    assert all(Path(path).is_file() for path in printed)


class TestWithVirtualMcu:
    @pytest.fixture
    def sim(self, tmp_path: Path):  # type: ignore[no-untyped-def]
        link = tmp_path / "tty"
        with subprocess.Popen(
            [*COMMAND, "sim", NATIVE, "--link", str(link)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
        ) as process:
            assert process.stdout is not None
            assert process.stdout.readline().decode().strip() == str(link)
            yield str(link)
            process.send_signal(signal.SIGINT)
            assert process.wait(PATIENCE) == 0
        assert not link.exists()

    def test_send_prints_the_reply(self, sim: str) -> None:
        result = run("send", NATIVE, sim, "ping", "number=7")
        assert result.returncode == 0
        assert json.loads(result.stdout)["fields"] == {"number": 7}

    def test_parameters_are_kept(self, sim: str) -> None:
        run("send", NATIVE, sim, "parameter_set", "index=3", "value=1.5")
        result = run("send", NATIVE, sim, "parameter_read", "index=3")
        assert json.loads(result.stdout)["fields"] == {"index": 3, "value": 1.5, "result": "ok"}

    def test_monitor_prints_json_lines_and_ends_by_itself(self, sim: str) -> None:
        for _ in moments("a state"):
            result = run("monitor", NATIVE, sim, "--json", "--seconds", "0.5", "-v")
            assert result.returncode == 0
            line, *messages = [json.loads(line) for line in result.stdout.splitlines()]
            if "state" in {message.get("message") for message in messages}:  # others are what the link tells
                break
        assert (line["event"], line["baud"], line["is_exclusive"]) == ("line", codec("native").model.link.baud, True)
        assert "0 discarded" not in result.stderr


def first_bytes(port: PtyPort) -> bytes:
    """Return the first bytes, however slowly the program starts."""
    for _ in moments("bytes at the port"):
        if data := port.read(0.1):
            return data
    raise AssertionError


def rest_of(process: subprocess.Popen[bytes], port: PtyPort) -> bytes:
    """Return all bytes until the program has ended."""
    data = b""
    for _ in moments("the end of the program"):
        has_ended = process.poll() is not None
        came = port.read(0.05)
        data += came
        if has_ended and not came:
            return data
    raise AssertionError


def first_line(process: subprocess.Popen[bytes], port: PtyPort, frame: bytes) -> str:
    """Return the program's first line about a message, for a frame that is sent until it listens: earlier ones are
    stale and dropped."""
    assert process.stdout is not None
    os.set_blocking(process.stdout.fileno(), False)
    for _ in moments("a line of the program"):
        line = process.stdout.readline().decode()
        if line and '"event"' not in line:  # a diagnosis that pauses of the machine ask for
            return line
        port.write(frame)
        let_pass(0.05)
    raise AssertionError


def commands(data: bytes) -> list[dict[str, object]]:
    """The fields of each command in these bytes; a link also says hello."""
    return [m.fields for m in codec("native").decoder("host").feed(data) if m.name == "command"]


def first_command(port: PtyPort) -> bytes:
    """Return the bytes up to a first command: from then on Ctrl-C ends the sending, and not the opening."""
    data = b""
    while not commands(data):
        data += first_bytes(port)
    return data


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_end_a_repeated_send_with_the_emergency_stop(number: signal.Signals) -> None:
    pty = PtyPort()
    command = [*COMMAND, "send", NATIVE, pty.path, "command", "speed=1", "mode=manual", "--rate", "50"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        data = first_command(pty)
        process.send_signal(number)
        data += rest_of(process, pty)
        assert process.returncode == 0
        assert process.stderr is not None
        assert b"then the emergency stop" in process.stderr.read()
    pty.close()
    assert commands(data)[0] == {"speed": 1.0, "mode": "manual"}
    assert commands(data)[-1] == {"speed": 0.0, "mode": "idle"}


@pytest.mark.parametrize(
    ("words", "speeds", "told"),
    [([], [1.0, 0.0], "the safe value of command follows"), (["--hand-over"], [1.0], "")],
)
def test_a_single_command_is_made_safe_unless_it_hands_over(words: list[str], speeds: list[float], told: str) -> None:
    pty = PtyPort()
    result = run("send", NATIVE, pty.path, "command", "speed=1", "mode=manual", *words)
    assert [fields["speed"] for fields in commands(pty.read(0.1))] == speeds
    assert told in result.stderr
    assert bool(told) == bool(result.stderr)
    pty.close()


@pytest.mark.parametrize(
    ("stop", "words", "servo"),
    [
        ("{message: move,", ["--header", "servo=3"], 3),
        ("{message: move, header: {servo: 0xFE},", ["--header", "servo=3"], 3),  # the file's stop is for everybody
        ("{message: move, header: {servo: 0xFE},", ["--header", "servo=0xFE"], 0xFE),
        ("{message: move, header: {servo: 0xFE},", [], 1),  # the default
    ],
)
def test_a_repeated_send_ends_with_the_safe_value_to_the_address_that_it_commanded(
    stop: str, words: list[str], servo: int, tmp_path: Path
) -> None:
    file = tmp_path / "servo_options.yaml"
    text = (ROOT / "tests" / "formats" / "servo_options.yaml").read_text()
    file.write_text(text.replace("emergency_stop: {message: move,", f"emergency_stop: {stop}"))
    pty = PtyPort()
    command = [*COMMAND, "send", str(file), pty.path, "move", "angle=0.5", *words, "--rate", "50", "--seconds", "0.3"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        data = first_bytes(pty)
        data += rest_of(process, pty)
        assert process.returncode == 0 and process.stderr is not None
        assert f", then the safe value to servo {servo}\n" in process.stderr.read().decode()
    pty.close()
    messages = wirebond.load(file).decoder("host").feed(data)
    assert {m.header["servo"] for m in messages} == {servo}
    assert [m.fields["angle"] for m in messages][-2:] == [0.5, 0.0]
    assert [m.fields["angle"] for m in messages].count(0.0) == 1


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_send_at_a_rate_that_no_line_carries(number: signal.Signals) -> None:
    """The queue is full, and the far end does not read until the signal has come."""
    pty = PtyPort()
    command = [*COMMAND, "send", NATIVE, pty.path, "command", "speed=1", "mode=manual", "--rate", "10000"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        data = first_command(pty)
        let_pass(1.5)
        process.send_signal(number)
        data += rest_of(process, pty)
        assert process.returncode == 0
    pty.close()
    speeds = [fields["speed"] for fields in commands(data)]
    assert speeds[-1] == 0
    assert 1.0 not in speeds[speeds.index(0.0) :]


def test_sigterm_ends_the_demo_with_the_safe_value(tmp_path: Path) -> None:
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path)}
    with subprocess.Popen(
        [*COMMAND, "demo", "--terminal"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment
    ) as process:
        assert process.stdout is not None and process.stderr is not None
        while re.search(rb"driving.*; [1-9]\d* frames", process.stdout.readline()) is None:
            assert process.poll() is None
        process.send_signal(signal.SIGTERM)
        told = process.stdout.read().decode()
        assert process.wait(PATIENCE) == 0, process.stderr.read()
    assert "ended by" in told and "Traceback" not in told
    assert "by message" in told  # the account


def test_demo_drives_the_rover_and_prints_a_summary(tmp_path: Path) -> None:
    environment = os.environ | {"XDG_CACHE_HOME": str(tmp_path)}
    for _ in moments("odometry"):
        result = subprocess.run(
            [*COMMAND, "demo", "--terminal", "--seconds", "2"],
            capture_output=True,
            text=True,
            timeout=2 * PATIENCE,
            check=False,
            env=environment,
        )
        assert "Traceback" not in result.stderr
        if "odometry" in result.stdout:
            break
    assert result.returncode == 0, result.stderr
    assert "line use" in result.stdout


def test_log_lines_are_shown_as_their_text(tmp_path: Path) -> None:
    file = tmp_path / "logged.yaml"
    told = '  status:\n    log: "[battery] at {battery} V"\n    level: warning\n'
    file.write_text(Path(DIFFDRIVE).read_text(encoding="utf-8").replace("  status:\n", told), encoding="utf-8")
    frame = codec("diffdrive").encode("status", battery=12.25, errors=[], state=[])
    (line,) = run("decode", str(file), "--hex", frame.hex()).stdout.splitlines()
    assert json.loads(line)["log"] == {"level": "warning", "text": "[battery] at 12.250 V"}
    assert "log" not in json.loads(run("decode", DIFFDRIVE, "--hex", frame.hex()).stdout)
    pty = PtyPort()
    command = [*COMMAND, "monitor", str(file), pty.path, "--seconds", "600"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        shown = first_line(process, pty, frame)
        process.send_signal(signal.SIGINT)
        process.wait(PATIENCE)
    pty.close()
    assert shown.partition(" ")[2] == "warning: [battery] at 12.250 V\n"


def test_monitor_lives_on_when_its_port_goes_away(tmp_path: Path) -> None:
    pty = PtyPort()
    name = tmp_path / "tty"
    name.symlink_to(pty.path)
    command = [*COMMAND, "monitor", DIFFDRIVE, str(name), "--seconds", "600", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stderr is not None
        line = first_line(process, pty, codec("diffdrive").encode("odometry", left_ticks=1, right_ticks=2))
        assert json.loads(line)["message"] == "odometry"
        name.unlink()  # before its number is free: another pty may get it
        pty.close()
        told = process.stderr.readline().decode()
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 0
        told += process.stderr.read().decode()
        assert "Waiting for it.\n" in told and str(name) in told.splitlines()[0]
        assert told.endswith(f"; {name} was away at the end\n")


def test_monitor_waits_for_a_port_that_is_not_there_yet(tmp_path: Path) -> None:
    name = tmp_path / "tty"
    assert "there is no port" in run("monitor", DIFFDRIVE, str(name)).stderr
    command = [*COMMAND, "monitor", DIFFDRIVE, str(name), "--wait", "--json"]
    pty = PtyPort()
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stderr is not None
        assert process.stderr.readline().decode().startswith(f"there is no port {name}; ")
        name.symlink_to(pty.path)
        line = first_line(process, pty, codec("diffdrive").encode("odometry", left_ticks=1, right_ticks=2))
        assert json.loads(line)["message"] == "odometry"
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 0
    pty.close()


def open_files(pid: int) -> list[str]:
    """Their names; of a pty that was closed with a word behind it."""
    names = []
    for file in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):
            names.append(str(file.readlink()))
    return names


def test_a_repeated_send_whose_port_goes_away_says_that_it_could_not_stop(tmp_path: Path) -> None:
    pty = PtyPort()
    name = tmp_path / "tty"
    name.symlink_to(pty.path)
    words = ["command", "speed=1", "mode=manual", "--rate", "50"]
    with subprocess.Popen([*COMMAND, "send", NATIVE, str(name), *words], stderr=subprocess.PIPE) as process:
        first_command(pty)
        port = pty.path
        name.unlink()
        pty.close()
        wait_until(lambda: port not in open_files(process.pid), "the program gives the port up")
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 3
        assert process.stderr is not None
        assert f"{name} is away, and the emergency stop could not be sent\n" in process.stderr.read().decode()


def test_messages_of_the_mcu_are_refused_before_a_port_is_touched() -> None:
    result = run("send", DIFFDRIVE, "/nowhere", "odometry", "left_ticks=1", "right_ticks=2")
    assert (result.returncode, result.stderr) == (1, "wirebond: odometry is sent by the mcu, not by the host\n")
    result = run("send", DIFFDRIVE, "/nowhere", "velocity", "--role", "mcu")
    assert (result.returncode, result.stderr) == (1, "wirebond: velocity is sent by the host, not by the mcu\n")


def test_send_and_monitor_play_the_mcu() -> None:
    pty = PtyPort()
    decoder = codec("diffdrive").decoder("mcu")
    odometry = ["odometry", "left_ticks=1", "right_ticks=2", "--role", "mcu", "--rate", "50", "--seconds", "0.2"]
    result = run("send", DIFFDRIVE, pty.path, *odometry)
    assert (result.returncode, result.stderr.split(" times")[0][:13]) == (0, "sent odometry")
    assert {m.name for m in decoder.feed(pty.read(1))} == {"odometry"}
    command = [*COMMAND, "monitor", DIFFDRIVE, pty.path, "--role", "mcu", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        line = first_line(process, pty, codec("diffdrive").encode("velocity", linear=0.5, angular=0))
        assert json.loads(line)["message"] == "velocity"
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 0
    pty.close()


def test_one_header_is_not_written_into_a_generated_folder(tmp_path: Path) -> None:
    assert run("gen", DIFFDRIVE, "--out", str(tmp_path)).returncode == 0
    result = run("gen", DIFFDRIVE, "--out", str(tmp_path), "--amalgamate")
    assert result.returncode == 2
    assert "name another --out" in result.stderr


@pytest.mark.parametrize("name", ["there", "no/folder"])
def test_a_link_that_cannot_be_made_is_named(name: str, tmp_path: Path) -> None:
    (tmp_path / "there").touch()
    result = run("sim", NATIVE, "--link", str(tmp_path / name), "--seconds", "0.1")
    assert result.returncode == 2
    assert result.stderr.startswith(f"wirebond: cannot make the link {tmp_path / name}: ")


SERVO_BUS = str(ROOT / "tests" / "formats" / "servo_options.yaml")


class TestHeader:
    def test_encode_takes_header_values(self) -> None:
        result = run("encode", SERVO_BUS, "move", "angle=0.5", "torque=9", "--header", "servo=3")
        assert result.stdout == "FF FF 03 06 03 00 F4 01 09 F5\n"
        words = ["--header", "servo=4", "--header", "options=registered", "--header", "stamp=1.5", "--json"]
        told = json.loads(run("encode", SERVO_BUS, "ask", *words).stdout)
        assert told["header"] == {"servo": 4, "options": ["registered"], "stamp": 1.5}
        assert told["bytes"] == "FF FF 04 05 02 02 05 DC 11"

    @pytest.mark.parametrize(
        ("file", "words", "sentence"),
        [
            (SERVO_BUS, ["servo=300"], "header.servo = 300 does not fit its 8-bit wire type"),
            (SERVO_BUS, ["servos=3"], "header has no field 'servos'; it has servo, options, stamp"),
            (SERVO_BUS, ["servo"], "'servo' is not an assignment; write field=value"),
            (SERVO_BUS, ["stamp=1"], "no form of the frame has the header fields stamp together"),
            (DIFFDRIVE, ["servo=3"], "frames of diffdrive have no header fields; remove --header"),
        ],
    )
    def test_the_impossible_is_reported(self, file: str, words: list[str], sentence: str) -> None:
        message = "ask" if file == SERVO_BUS else "status_query"
        result = run("encode", file, message, *(word for one in words for word in ("--header", one)))
        assert result.returncode in (1, 2)
        assert sentence in result.stderr

    def test_decode_shows_header_values(self) -> None:
        line = json.loads(run("decode", SERVO_BUS, "--hex", "FF FF 04 05 02 02 05 DC 11").stdout)
        assert line["header"] == {"servo": 4, "options": ["registered"], "stamp": 1.5}

    def test_two_servos_on_one_bus_are_distinguished(self, tmp_path: Path) -> None:
        link = tmp_path / "tty"
        command = [*COMMAND, "sim", SERVO_BUS, "--link", str(link), "--address", "3", "--address", "7"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            try:
                assert process.stdout is not None
                process.stdout.readline()
                for servo in (3, 7):
                    result = run("send", SERVO_BUS, str(link), "ask", "--header", f"servo={servo}")
                    assert json.loads(result.stdout)["header"]["servo"] == servo
                silent = run("send", SERVO_BUS, str(link), "ask", "--header", "servo=4")
                assert (silent.returncode, silent.stdout) == (1, "")
            finally:
                process.send_signal(signal.SIGINT)
                process.wait(PATIENCE)


def test_help_is_a_word_too() -> None:
    assert "Usage: wirebond param get" in run("help", "param", "get").stdout
    assert "wirebond help COMMAND" in run("help").stdout
    assert run("help", "nonsense").returncode == 2
